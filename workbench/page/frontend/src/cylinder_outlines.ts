/** The outlines of cells as a picture of the whole wall, to be laid over the cylinder. */

import type { Paths } from "./marks";
import type { State } from "./state";
import type { Wall } from "./wall";

const AROUND_PX = 2048;
const MOST_DOWN_PX = 8192;
const LINE_MM = 0.018;

/** Return what is outlined in panes that show `layer`; null where nothing is. */
export function outlinePicture(state: State, paths: Paths, wall: Wall, layer: string): HTMLCanvasElement | null {
  const { side } = state.layer(layer);
  const shown = [...paths].filter(([of]) => state.outlines.has(of) && state.isCommon(state.layer(of).side, side));
  if (!shown.length) return null;
  const turns = wall.length_mm / wall.circumference_mm;
  const made = document.createElement("canvas");
  [made.width, made.height] = [AROUND_PX, Math.min(Math.ceil(AROUND_PX * turns), MOST_DOWN_PX)];
  const drawing = made.getContext("2d");
  if (!drawing) return null;
  drawing.scale(AROUND_PX, made.height / turns);
  drawing.lineJoin = "round";
  for (const [, { path, colour }] of shown) {
    for (const [stroke, wide] of [["rgba(255,255,255,0.75)", 2], [colour, 1]] as const) {
      drawing.strokeStyle = stroke;
      drawing.lineWidth = (wide * LINE_MM) / wall.circumference_mm;
      for (const turn of [-1, 0, 1]) { // lines go on beyond θ = 0, on either side
        drawing.save();
        drawing.translate(turn, 0);
        drawing.stroke(path);
        drawing.restore();
      }
    }
  }
  return made;
}
