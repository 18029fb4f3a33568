/** What marks are drawn on: the canvas of a pane and what of the wall it shows. */

import type { Drawing } from "./drawing";
import type { Place, View, Wall } from "./wall";

export interface Sheet {
  drawing: Drawing;
  width: number;
  height: number;
  view: View;
  wall: Wall;
}

export function toPixels(place: Place, view: View, wall: Wall, width: number, height: number): { x: number; y: number } {
  const perTurn = wall.circumference_mm / view.mm_per_px;
  return {
    x: width / 2 + ((place.theta_rad - view.theta_rad) / (2 * Math.PI)) * perTurn,
    y: height / 2 + (place.z_mm - view.z_mm) / view.mm_per_px,
  };
}

/** The x of a place in every turn that is in view. */
export function* repeats(place: Place, sheet: Sheet): Generator<{ x: number; y: number }> {
  const { width, height, view, wall } = sheet;
  const perTurn = wall.circumference_mm / view.mm_per_px;
  const first = toPixels(place, view, wall, width, height);
  for (let x = (((first.x % perTurn) + perTurn) % perTurn) - perTurn; x < width + perTurn; x += perTurn) {
    yield { x, y: first.y };
  }
}
