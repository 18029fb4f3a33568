/** How two layers of a pane are brought together, on the screen as in a figure. */

import { toPixels } from "./sheet";
import type { PaneState } from "./state";
import type { View, Wall } from "./wall";

export const LENS_PX = 90;

/** The view of a pane at a moment: sizes and the pointer in CSS pixels. */
export interface Shot {
  shown: PaneState;
  view: View;
  width: number;
  height: number;
  pointer: { x: number; y: number };
}

/** Squares of a whole part of the circle, which stay where they are on the wall: the side of two, and where one begins. */
export function squares(view: View, wall: Wall, width: number, height: number): { size: number; x: number; y: number } {
  const pairs = Math.max(1, Math.round(wall.circumference_mm / (160 * view.mm_per_px)));
  const origin = toPixels({ theta_rad: 0, z_mm: 0 }, view, wall, width, height);
  return { size: wall.circumference_mm / view.mm_per_px / pairs, ...origin };
}

/** Where the second layer is shown, as a path; null: everywhere, as opaque as it is. */
export function secondPart({ shown, view, width, height, pointer }: Shot, wall: Wall): Path2D | null {
  const path = new Path2D();
  if (shown.mode === "swipe") path.rect(shown.share * width, 0, width, height);
  else if (shown.mode === "lens") path.arc(pointer.x, pointer.y, LENS_PX, 0, 2 * Math.PI);
  else if (shown.mode === "checker") {
    const { size, x, y } = squares(view, wall, width, height);
    const first = (at: number): number => (((at % size) + size) % size) - size;
    for (let left = first(x); left < width; left += size) {
      for (let top = first(y); top < height; top += size) {
        path.rect(left + size / 2, top, size / 2, size / 2);
        path.rect(left, top + size / 2, size / 2, size / 2);
      }
    }
  } else return null;
  return path;
}

/** How opaque the second layer is where it is shown. */
export function secondOpacity({ mode, share }: PaneState, secondShown: boolean): number {
  return mode === "opacity" ? share : mode === "blink" && !secondShown ? 0 : 1;
}
