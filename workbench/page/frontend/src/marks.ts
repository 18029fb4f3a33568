/** What is drawn over the tiles of a pane: outlines, numbers of cells, cursor, ruler, scale bar, and what is no wall. */

import type { CellPart, Description } from "./description";
import { type Drawing, TracedPath } from "./drawing";
import { drawLandmarks, drawNotes } from "./landmark_marks";
import type { Outlines } from "./source";
import type { State } from "./state";
import { type Sheet, repeats, toPixels, turnOf } from "./sheet";
import { type Place, type Spot, type Wall, roundBelow } from "./wall";

export const INK = "#111";
const HALO = "rgba(255,255,255,0.85)";
/** How opaque what covers the copies of the marked turn is. */
const VEIL = 0.72;
/** Room that a number takes. */
const NUMBER_PX = { digit: 7, high: 13 };
/** How far marks of places reach. */
const REACH_PX = 14;

export type Paths = ReadonlyMap<string, { path: Path2D; colour: string }>;

/** Outlines as paths in turns, made once. */
export function outlinePaths(description: Description, lines: Outlines, wall: Wall): Paths {
  return new Map(
    description.outlines.map((outline) => {
      const path = new TracedPath();
      for (const line of lines[outline.layer] ?? []) {
        for (let k = 0; k + 1 < line.length; k += 2) {
          const { x, y } = wall.turnsOf({ theta_rad: line[k] ?? 0, z_mm: line[k + 1] ?? 0 });
          if (k === 0) path.moveTo(x, y);
          else path.lineTo(x, y);
        }
      }
      return [outline.layer, { path, colour: outline.colour }];
    }),
  );
}

export function drawMarks(
  sheet: Sheet,
  state: State,
  paths: Paths,
  shownLayers: readonly string[],
): void {
  coverBeyond(sheet);
  drawOutlines(sheet, state, paths, shownLayers);
  drawNumbers(sheet, state, shownLayers);
  const side = state.layer(shownLayers[0] ?? "").side;
  const here = (spot: Spot | null): Spot | null => (spot && state.isCommon(spot.side, side) ? spot : null);
  drawCross(sheet, here(state.cursor), "rgba(255,255,255,0.9)", "rgba(0,0,0,0.55)");
  drawCross(sheet, here(state.pinned), "#ffffff", "#d6007a");
  drawLandmarks(sheet, state, side);
  drawNotes(sheet, state, side);
  drawPainting(sheet, state, side);
  drawRuler(sheet, state);
  drawScaleBar(sheet);
}

/** Beyond its ends there is no wall, and beyond one turn there are copies of it, which are dimmed; dots mark 0°. */
function coverBeyond(sheet: Sheet): void {
  const { drawing, width, height, view, wall, paper } = sheet;
  const { left, right, perTurn } = turnOf(sheet);
  const [top, bottom] = [wall.part.top_mm, wall.part.bottom_mm].map((z_mm) => height / 2 + (z_mm - view.z_mm) / view.mm_per_px) as [number, number];
  drawing.fillStyle = `rgb(${paper.colour})`;
  if (top > 0) drawing.fillRect(0, 0, width, Math.min(top, height));
  if (bottom < height) drawing.fillRect(0, Math.max(bottom, 0), width, height - Math.max(bottom, 0));
  drawing.fillStyle = `rgba(${paper.colour},${VEIL})`;
  if (left > 0) drawing.fillRect(0, 0, left, height);
  if (right < width) drawing.fillRect(right, 0, width - right, height);
  const seam = width / 2 - (((((view.theta_rad / (2 * Math.PI)) % 1) + 1.5) % 1) - 0.5) * perTurn;
  drawing.setLineDash([2, 4]);
  for (const x of [seam - perTurn, seam, seam + perTurn]) if (x >= left - 1 && x <= right + 1) line(drawing, x, Math.max(top, 0), x, Math.min(bottom, height), 1);
  drawing.setLineDash([]);
}

function drawOutlines(
  sheet: Sheet,
  state: State,
  paths: Paths,
  shownLayers: readonly string[],
): void {
  const { drawing, width, height, view, wall } = sheet;
  const { left, right, perTurn } = turnOf(sheet);
  const origin = toPixels({ theta_rad: 0, z_mm: wall.part.top_mm }, view, wall, width, height);
  const common = state.description.has_common_places;
  drawing.save();
  drawing.beginPath();
  drawing.rect(Math.max(left, 0), 0, Math.min(right, width) - Math.max(left, 0), height);
  drawing.clip();
  for (const [layer, { path, colour }] of paths) {
    const side = state.layer(layer).side;
    if (!state.outlines.has(layer)) continue;
    if (!common && !shownLayers.some((shown) => state.layer(shown).side === side)) continue;
    for (let x = (((origin.x % perTurn) + perTurn) % perTurn) - 2 * perTurn; x < width; x += perTurn) {
      drawing.save();
      drawing.translate(x, origin.y);
      drawing.scale(perTurn, perTurn);
      drawing.lineJoin = "round";
      drawing.strokeStyle = "rgba(255,255,255,0.75)";
      drawing.lineWidth = 3 / perTurn;
      drawing.stroke(path);
      drawing.strokeStyle = colour;
      drawing.lineWidth = 1.5 / perTurn;
      drawing.stroke(path);
      drawing.restore();
    }
  }
  drawing.restore();
}

/** A pane has the numbers of the side that it shows; the difference those of A, and of B what A does not have. */
function isNumbered(cell: CellPart, state: State, shownLayers: readonly string[]): boolean {
  const side = state.layer(shownLayers[0] ?? "").side;
  const isOfA = cell.side === state.description.sides[0];
  return state.outlines.has(`${cell.side}-cells`) && (side === null ? isOfA || cell.state !== "matched" : side === cell.side);
}

function drawNumbers(sheet: Sheet, state: State, shownLayers: readonly string[]): void {
  const { drawing, view } = sheet;
  drawing.font = "11px system-ui, sans-serif";
  drawing.textAlign = "center";
  drawing.textBaseline = "middle";
  const bar = scaleBar(sheet);
  const free = new FreeRoom({ x: bar.x + bar.wide / 2, y: bar.y - 8, wide: bar.wide, high: 20 });
  // the selected cell first, then the largest: where two numbers would overlap, theirs is the one that is drawn
  const order = (cell: CellPart): number => (cell === state.selected ? Infinity : cell.diameter_mm);
  const isShown = (cell: CellPart): boolean => shownLayers.some((layer) => state.isCommon(cell.side, state.layer(layer).side));
  for (const cell of [...state.description.cells].sort((a, b) => order(b) - order(a))) {
    const chosen = cell === state.selected || (state.ringed.has(cell) && isShown(cell));
    const big = cell.diameter_mm / view.mm_per_px > 15;
    if (!chosen && !(state.numbers && big && isNumbered(cell, state, shownLayers))) continue;
    const radius = Math.max(cell.diameter_mm / view.mm_per_px / 2 + 7, 10);
    if (chosen) for (const { x, y } of repeats(cell, sheet, radius)) drawRing(drawing, x, y, radius);
    for (const { x, y } of repeats(cell, sheet)) if (free.takes(String(cell.id), x, y)) label(drawing, String(cell.id), x, y);
  }
}

function drawRing(drawing: Drawing, x: number, y: number, radius: number): void {
  for (const [colour, wide] of [[HALO, 5], ["#d6007a", 2]] as const) {
    drawing.strokeStyle = colour;
    drawing.lineWidth = wide;
    drawing.beginPath();
    drawing.arc(x, y, radius, 0, 2 * Math.PI);
    drawing.stroke();
  }
}

/** A rectangle about its middle. */
interface Room {
  x: number;
  y: number;
  wide: number;
  high: number;
}

/** Keeps numbers from overlapping each other, and what is `taken` already. */
class FreeRoom {
  private readonly taken: Room[];

  constructor(...taken: Room[]) {
    this.taken = taken;
  }

  /** Take the room of a number about a place; false where a part of it is taken. */
  takes(text: string, x: number, y: number): boolean {
    const wide = NUMBER_PX.digit * text.length + 2;
    const isFree = this.taken.every((other) => Math.abs(other.x - x) >= (other.wide + wide) / 2 || Math.abs(other.y - y) >= (other.high + NUMBER_PX.high) / 2);
    if (isFree) this.taken.push({ x, y, wide, high: NUMBER_PX.high });
    return isFree;
  }
}

function drawCross(sheet: Sheet, place: Place | null, colour: string, edge: string): void {
  if (!place) return;
  const { drawing } = sheet;
  for (const { x, y } of repeats(place, sheet, REACH_PX)) {
    for (const [stroke, wide] of [[edge, 3], [colour, 1]] as const) {
      drawing.strokeStyle = stroke;
      drawing.lineWidth = wide;
      drawing.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
        drawing.moveTo(x + 4 * dx, y + 4 * dy);
        drawing.lineTo(x + 12 * dx, y + 12 * dy);
      }
      drawing.stroke();
    }
  }
}

/** How far `to` lies from `from` on the wall, the shorter way around: around, in the direction of θ, and along. */
export function apartOnWall(from: Place, to: Place, wall: Wall): { around_mm: number; along_mm: number } {
  const turn = 2 * Math.PI;
  const apart = (((to.theta_rad - from.theta_rad + Math.PI) % turn) + turn) % turn - Math.PI;
  return { around_mm: apart * wall.part.radius_mm, along_mm: to.z_mm - from.z_mm };
}

function drawRuler(sheet: Sheet, state: State): void {
  const { drawing, wall } = sheet;
  const to = state.ruler?.to ?? (state.measuring ? state.cursor : null);
  if (!state.ruler || !to) return;
  const { around_mm, along_mm } = apartOnWall(state.ruler.from, to, wall);
  const dx = around_mm / sheet.view.mm_per_px;
  const dy = along_mm / sheet.view.mm_per_px;
  for (const { x, y } of repeats(state.ruler.from, sheet, REACH_PX)) {
    for (const [colour, wide] of [[HALO, 5], [INK, 2]] as const) {
      drawing.strokeStyle = colour;
      drawing.lineWidth = wide;
      drawing.beginPath();
      drawing.moveTo(x, y);
      drawing.lineTo(x + dx, y + dy);
      drawing.stroke();
    }
    drawing.textAlign = "center";
    drawing.textBaseline = "middle";
    label(drawing, `${Math.hypot(around_mm, along_mm).toFixed(3)} mm`, x + dx / 2, y + dy / 2 - 10);
  }
}

/** What is drawn of a mask: its outline as it will be saved, and the stroke under the pointer. */
function drawPainting(sheet: Sheet, state: State, side: string | null): void {
  const { painting } = state;
  if (!painting.active || side !== painting.side) return;
  const { drawing, width, height, view, wall } = sheet;
  const { perTurn } = turnOf(sheet);
  const across = (places: readonly Place[], shift: number): void => {
    drawing.beginPath();
    places.forEach((place, k) => {
      const { x, y } = toPixels(place, view, wall, width, height);
      if (k === 0) drawing.moveTo(x + shift, y);
      else drawing.lineTo(x + shift, y);
    });
  };
  drawing.lineJoin = "round";
  if (drawing instanceof CanvasRenderingContext2D) drawing.lineCap = "round"; // figures show no stroke that is under way
  for (const line of painting.lines) {
    const places = Array.from({ length: line.length / 2 }, (_, k) => ({ theta_rad: line[2 * k] ?? 0, z_mm: line[2 * k + 1] ?? 0 }));
    const first = toPixels(places[0] ?? { theta_rad: 0, z_mm: 0 }, view, wall, width, height).x;
    for (let shift = -Math.floor((first + perTurn) / perTurn) * perTurn; first + shift < width + perTurn; shift += perTurn) {
      for (const [colour, wide] of [[HALO, 4], ["#d6007a", 2]] as const) {
        drawing.strokeStyle = colour;
        drawing.lineWidth = wide;
        across(places, shift);
        drawing.stroke();
      }
    }
  }
  if (!painting.stroke.length) return;
  drawing.strokeStyle = painting.adds ? "rgba(214,0,122,0.45)" : "rgba(40,40,40,0.45)";
  drawing.lineWidth = painting.tool === "brush" ? (2 * painting.radius_mm) / view.mm_per_px : 2;
  across(painting.stroke.length > 1 ? painting.stroke : [...painting.stroke, ...painting.stroke], 0);
  drawing.stroke();
}

interface ScaleBar {
  x: number;
  y: number;
  wide: number;
  text: string;
}

function scaleBar({ width, height, view }: Sheet): ScaleBar {
  const length_mm = roundBelow(0.3 * Math.min(width, 360) * view.mm_per_px);
  const wide = length_mm / view.mm_per_px;
  const text = length_mm < 0.1 ? `${Number((length_mm * 1000).toPrecision(3))} µm` : `${Number(length_mm.toPrecision(3))} mm`;
  return { x: width - 12 - wide, y: height - 12, wide, text };
}

function drawScaleBar(sheet: Sheet): void {
  const { drawing } = sheet;
  const { x, y, wide, text } = scaleBar(sheet);
  line(drawing, x, y, x + wide, y, 3);
  drawing.textAlign = "center";
  drawing.textBaseline = "bottom";
  drawing.font = "11px system-ui, sans-serif";
  label(drawing, text, Math.min(x + wide / 2, sheet.width - 3.4 * text.length), y - 4);
}

export function line(drawing: Drawing, x: number, y: number, toX: number, toY: number, wide: number): void {
  for (const [colour, more] of [[HALO, 2], [INK, 0]] as const) {
    drawing.strokeStyle = colour;
    drawing.lineWidth = wide + more;
    drawing.beginPath();
    drawing.moveTo(x, y);
    drawing.lineTo(toX, toY);
    drawing.stroke();
  }
}

export function label(drawing: Drawing, text: string, x: number, y: number): void {
  drawing.lineJoin = "round";
  drawing.strokeStyle = HALO;
  drawing.lineWidth = 3;
  drawing.strokeText(text, x, y);
  drawing.fillStyle = INK;
  drawing.fillText(text, x, y);
}
