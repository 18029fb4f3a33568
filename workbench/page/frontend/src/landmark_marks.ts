/** Landmarks in a pane: a cross at the place itself, and its number on a disc beside it; black corrects, white checks. Notes: a ring, and their text. */

import type { Note, Role } from "./landmarks";
import { toShown } from "./placement";
import { type Sheet, repeats } from "./sheet";
import type { State } from "./state";
import type { Place } from "./wall";

const [DARK, BRIGHT] = ["#111", "#fff"];
const OUT_PX = 13;
const DISC_PX = 8;
/** How far a landmark reaches. */
const REACH_PX = OUT_PX + DISC_PX + 2;
/** Of a note's ring. */
export const RING_PX = 5;
/** About the width of a letter of its text. */
const LETTER_PX = 6.5;

/** Draw the ends of pairs that lie on `side`; where a pane shows both sides, both ends and what lies between them. */
export function drawLandmarks(sheet: Sheet, state: State, side: string | null): void {
  const { landmarks } = state;
  const [a, b] = state.description.frames;
  if (!a || !b) return;
  landmarks.pairs.forEach((pair, k) => {
    const ends: Place[] = [];
    if (side === null || side === a.side) ends.push(toShown(a.placement, pair.a));
    if (side === null || side === b.side) ends.push(toShown(b.placement, pair.b));
    const [one, other] = ends;
    if (one && other) drawBetween(sheet, one, other);
    if (one) drawPin(sheet, one, String(k + 1), pair.role, false);
    if (other) drawCrossAt(sheet, other);
  });
  const { pending } = landmarks;
  const frames = [a, b].find((part) => part.side === pending?.side);
  if (!pending || !frames || (side !== null && side !== frames.side)) return;
  drawPin(sheet, toShown(frames.placement, pending.place), String(landmarks.pairs.length + 1), "correct", true);
}

/** Where a note lies on the wall as it is shown, and on whose; null where its side has no frames. */
export function spotOf(state: State, note: Note): Place & { side: string } | null {
  const frames = state.description.frames[note.side === "a" ? 0 : 1];
  return frames ? { ...toShown(frames.placement, note.place), side: frames.side } : null;
}

/** Draw the notes that have a place on what is shown of `side`, as much of their text as there is room for. */
export function drawNotes(sheet: Sheet, state: State, side: string | null): void {
  const { drawing, width } = sheet;
  const { draft, notes } = state.landmarks;
  [...notes, ...(draft ? [draft] : [])].forEach((note, k) => {
    const spot = spotOf(state, note);
    if (!spot || !state.isCommon(spot.side, side)) return;
    for (const { x, y } of repeats(spot, sheet, RING_PX + 2)) {
      strokeTwice(sheet, () => drawing.arc(x, y, RING_PX, 0, 2 * Math.PI));
      const isLeft = x > width / 2;
      const letters = [...`${k + 1} ${note.text || "…"}`];
      const room = Math.max(Math.floor(((isLeft ? x : width - x) - 2 * RING_PX) / LETTER_PX), 2);
      const text = letters.length > room ? `${letters.slice(0, room - 1).join("")}…` : letters.join("");
      drawing.font = "12px system-ui, sans-serif";
      drawing.textAlign = isLeft ? "right" : "left";
      drawing.textBaseline = "middle";
      [drawing.strokeStyle, drawing.lineWidth, drawing.lineJoin, drawing.fillStyle] = [BRIGHT, 3.5, "round", DARK];
      const at = x + (isLeft ? -1 : 1) * (RING_PX + 4);
      drawing.strokeText(text, at, y);
      drawing.fillText(text, at, y);
    }
  });
}

function strokeTwice({ drawing }: Sheet, path: () => void): void {
  for (const [colour, wide] of [[BRIGHT, 3.5], [DARK, 1.5]] as const) {
    drawing.strokeStyle = colour;
    drawing.lineWidth = wide;
    drawing.beginPath();
    path();
    drawing.stroke();
  }
}

function drawCross(sheet: Sheet, x: number, y: number): void {
  const { drawing } = sheet;
  strokeTwice(sheet, () => {
    drawing.moveTo(x - 5, y);
    drawing.lineTo(x + 5, y);
    drawing.moveTo(x, y - 5);
    drawing.lineTo(x, y + 5);
  });
}

function drawCrossAt(sheet: Sheet, place: Place): void {
  for (const { x, y } of repeats(place, sheet, REACH_PX)) drawCross(sheet, x, y);
}

function drawBetween(sheet: Sheet, one: Place, other: Place): void {
  const { drawing, view, wall } = sheet;
  const turn = 2 * Math.PI;
  const apart = ((((other.theta_rad - one.theta_rad + Math.PI) % turn) + turn) % turn) - Math.PI;
  const [dx, dy] = [(apart * wall.part.radius_mm) / view.mm_per_px, (other.z_mm - one.z_mm) / view.mm_per_px];
  for (const { x, y } of repeats(one, sheet, REACH_PX)) {
    strokeTwice(sheet, () => {
      drawing.moveTo(x, y);
      drawing.lineTo(x + dx, y + dy);
    });
  }
}

function drawPin(sheet: Sheet, place: Place, text: string, role: Role, waiting: boolean): void {
  const { drawing } = sheet;
  const [fill, ink] = role === "correct" ? [DARK, BRIGHT] : [BRIGHT, DARK];
  for (const { x, y } of repeats(place, sheet, REACH_PX)) {
    const [left, top] = [x + OUT_PX, y - OUT_PX];
    drawCross(sheet, x, y);
    strokeTwice(sheet, () => {
      drawing.moveTo(x + 3, y - 3);
      drawing.lineTo(left, top);
    });
    // the disc is a wide line as well: files of vectors fill rectangles only
    for (const [colour, radius, wide, dash] of [[fill, DISC_PX / 2, DISC_PX, []], [ink, DISC_PX, 1.5, waiting ? [3, 2] : []]] as const) {
      drawing.setLineDash([...dash]);
      drawing.strokeStyle = colour;
      drawing.lineWidth = wide;
      drawing.beginPath();
      drawing.arc(left, top, radius, 0, 2 * Math.PI);
      drawing.stroke();
    }
    drawing.setLineDash([]);
    drawing.fillStyle = ink;
    drawing.font = "bold 11px system-ui, sans-serif";
    drawing.textAlign = "center";
    drawing.textBaseline = "middle";
    drawing.fillText(text, left, top + 0.5);
  }
}
