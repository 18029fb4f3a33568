/** What is drawn over the tiles of a pane: axes, scale bar, outlines, numbers of cells, cursor, ruler. */

import type { CellPart, Description } from "./description";
import { type Drawing, TracedPath } from "./drawing";
import { drawLandmarks } from "./landmark_marks";
import type { Outlines } from "./source";
import type { State } from "./state";
import { type Sheet, repeats, toPixels } from "./sheet";
import { type Place, type Spot, type Wall, degrees, roundBelow } from "./wall";

export const INK = "#111";
const HALO = "rgba(255,255,255,0.85)";
const DEGREE_STEPS = [90, 45, 30, 15, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
const LEAST_LABEL_PX = 46;

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
  drawOutlines(sheet, state, paths, shownLayers);
  drawNumbers(sheet, state, shownLayers);
  const side = state.layer(shownLayers[0] ?? "").side;
  const here = (spot: Spot | null): Spot | null => (spot && state.isCommon(spot.side, side) ? spot : null);
  drawCross(sheet, here(state.cursor), "rgba(255,255,255,0.9)", "rgba(0,0,0,0.55)");
  drawCross(sheet, here(state.pinned), "#ffffff", "#d6007a");
  drawLandmarks(sheet, state, side);
  drawRuler(sheet, state);
  drawAxes(sheet);
  drawScaleBar(sheet);
}

function drawOutlines(
  sheet: Sheet,
  state: State,
  paths: Paths,
  shownLayers: readonly string[],
): void {
  const { drawing, width, height, view, wall } = sheet;
  const perTurn = wall.circumference_mm / view.mm_per_px;
  const origin = toPixels({ theta_rad: 0, z_mm: wall.part.top_mm }, view, wall, width, height);
  const common = state.description.has_common_places;
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
  for (const cell of state.description.cells) {
    const chosen = cell === state.selected;
    const big = cell.diameter_mm / view.mm_per_px > 15;
    if (!chosen && !(state.numbers && big && isNumbered(cell, state, shownLayers))) continue;
    for (const { x, y } of repeats(cell, sheet)) {
      if (chosen) {
        const radius = Math.max(cell.diameter_mm / view.mm_per_px / 2 + 7, 10);
        for (const [colour, wide] of [[HALO, 5], ["#d6007a", 2]] as const) {
          drawing.strokeStyle = colour;
          drawing.lineWidth = wide;
          drawing.beginPath();
          drawing.arc(x, y, radius, 0, 2 * Math.PI);
          drawing.stroke();
        }
      }
      if (big || chosen) label(drawing, String(cell.id), x, y);
    }
  }
}

function drawCross(sheet: Sheet, place: Place | null, colour: string, edge: string): void {
  if (!place) return;
  const { drawing } = sheet;
  for (const { x, y } of repeats(place, sheet)) {
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

/** Length on the wall between two places, mm, the shorter way around. */
export function lengthOnWall(from: Place, to: Place, wall: Wall): number {
  const turn = 2 * Math.PI;
  const apart = (((to.theta_rad - from.theta_rad) % turn) + turn) % turn;
  return Math.hypot(Math.min(apart, turn - apart) * wall.part.radius_mm, to.z_mm - from.z_mm);
}

function drawRuler(sheet: Sheet, state: State): void {
  const { drawing, wall } = sheet;
  const to = state.ruler?.to ?? (state.measuring ? state.cursor : null);
  if (!state.ruler || !to) return;
  const turn = 2 * Math.PI;
  const apart = ((((to.theta_rad - state.ruler.from.theta_rad + Math.PI) % turn) + turn) % turn) - Math.PI;
  const end = { theta_rad: state.ruler.from.theta_rad + apart, z_mm: to.z_mm };
  const dx = (apart * wall.part.radius_mm) / sheet.view.mm_per_px;
  const dy = (end.z_mm - state.ruler.from.z_mm) / sheet.view.mm_per_px;
  for (const { x, y } of repeats(state.ruler.from, sheet)) {
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
    label(drawing, `${lengthOnWall(state.ruler.from, end, wall).toFixed(3)} mm`, x + dx / 2, y + dy / 2 - 10);
  }
}

function drawAxes(sheet: Sheet): void {
  const { drawing, width, height, view, wall } = sheet;
  drawing.fillStyle = "rgba(255,255,255,0.5)";
  drawing.fillRect(0, 0, width, 19);
  drawing.fillRect(0, 19, 30, height - 19);
  const pxPerDegree = wall.circumference_mm / view.mm_per_px / 360;
  const step = [...DEGREE_STEPS].reverse().find((value) => value * pxPerDegree >= LEAST_LABEL_PX) ?? 90;
  drawing.font = "10.5px system-ui, sans-serif";
  drawing.textBaseline = "top";
  drawing.textAlign = "center";
  const middle = (view.theta_rad * 180) / Math.PI;
  const reach = width / 2 / pxPerDegree;
  for (let k = Math.ceil((middle - reach) / step); k * step <= middle + reach; k += 1) {
    const x = width / 2 + (k * step - middle) * pxPerDegree;
    const shown = degrees((k * step * Math.PI) / 180);
    const isSeam = Math.abs(shown) < 1e-6 || Math.abs(shown - 360) < 1e-6;
    if (isSeam) {
      drawing.setLineDash([2, 4]);
      line(drawing, x, 0, x, height, 1);
      drawing.setLineDash([]);
    }
    line(drawing, x, 0, x, 5, 1);
    if (x > 34 && x < width - 12) label(drawing, `${isSeam ? 0 : Number(shown.toFixed(2))}°`, x, 7);
  }
  const step_mm = roundBelow((2.2 * LEAST_LABEL_PX * view.mm_per_px));
  const decimals = Math.max(0, -Math.floor(Math.log10(step_mm)));
  drawing.textAlign = "left";
  label(drawing, "mm", 4, 7); // of z, below
  drawing.textBaseline = "middle";
  const half = (height / 2) * view.mm_per_px;
  for (let k = Math.ceil((view.z_mm - half) / step_mm); k * step_mm <= view.z_mm + half; k += 1) {
    const z_mm = k * step_mm;
    if (z_mm < wall.part.top_mm || z_mm > wall.part.bottom_mm) continue;
    const y = height / 2 + (z_mm - view.z_mm) / view.mm_per_px;
    line(drawing, 0, y, 5, y, 1);
    if (y > 22) label(drawing, `${z_mm.toFixed(decimals)}`.replace("-", "−"), 8, y);
  }
}

function drawScaleBar(sheet: Sheet): void {
  const { drawing, width, height, view } = sheet;
  const length_mm = roundBelow(0.3 * Math.min(width, 360) * view.mm_per_px);
  const wide = length_mm / view.mm_per_px;
  const [x, y] = [width - 12 - wide, height - 12];
  line(drawing, x, y, x + wide, y, 3);
  drawing.textAlign = "center";
  drawing.textBaseline = "bottom";
  drawing.font = "11px system-ui, sans-serif";
  const text = length_mm < 0.1 ? `${Number((length_mm * 1000).toPrecision(3))} µm` : `${Number(length_mm.toPrecision(3))} mm`;
  label(drawing, text, x + wide / 2, y - 4);
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
