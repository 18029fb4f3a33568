/** What marks are drawn on: the canvas of a pane and what of the wall it shows. */

import type { Drawing } from "./drawing";
import type { Place, View, Wall } from "./wall";

export interface Sheet {
  drawing: Drawing;
  width: number;
  height: number;
  view: View;
  wall: Wall;
  paper: Paper;
}

/** What lies around the wall: its colour, red, green and blue, and that of the axes. */
export interface Paper {
  colour: string;
  ink: string;
}

/** Of figures. */
export const WHITE: Paper = { colour: "255,255,255", ink: "#111" };

export function toPixels(place: Place, view: View, wall: Wall, width: number, height: number): { x: number; y: number } {
  const perTurn = wall.circumference_mm / view.mm_per_px;
  return {
    x: width / 2 + ((place.theta_rad - view.theta_rad) / (2 * Math.PI)) * perTurn,
    y: height / 2 + (place.z_mm - view.z_mm) / view.mm_per_px,
  };
}

/** That of an element of the page, in the scheme of colours that it has now. */
export function paperOf(of: Element): Paper {
  const style = getComputedStyle(of);
  return { colour: (style.backgroundColor.match(/[\d.]+/g) ?? []).slice(0, 3).join(",") || WHITE.colour, ink: style.color };
}

/** From where to where the one turn reaches that is marked: half a turn to either side of the middle. */
export function turnOf({ width, view, wall }: Sheet): { left: number; right: number; perTurn: number } {
  const perTurn = wall.circumference_mm / view.mm_per_px;
  return { left: (width - perTurn) / 2, right: (width + perTurn) / 2, perTurn };
}

/** Where a place lies in that turn; near its end also beyond the other one, where a mark of `reach` pixels is seen in part. */
export function* repeats(place: Place, sheet: Sheet, reach = 0): Generator<{ x: number; y: number }> {
  const { width, height, view, wall } = sheet;
  const { left, right, perTurn } = turnOf(sheet);
  const { x, y } = toPixels(place, view, wall, width, height);
  const first = left + ((((x - left) % perTurn) + perTurn) % perTurn);
  yield { x: first, y };
  if (first - left < reach) yield { x: first + perTurn, y };
  if (right - first < reach) yield { x: first - perTurn, y };
}
