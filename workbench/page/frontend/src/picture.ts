/** The view as a picture: panes side by side as they are shown, with their marks, titles and the scale. */

import { lookUpTable } from "./colouring";
import type { Pane } from "./pane";
import type { State } from "./state";

const TITLE_PX = 26;
const GAP_PX = 8;

export function pictureOf(panes: readonly Pane[], state: State): HTMLCanvasElement {
  const scale = window.devicePixelRatio || 1;
  const widths = panes.map((pane) => pane.marksCanvas.width);
  const tall = Math.max(...panes.map((pane) => pane.marksCanvas.height));
  const picture = document.createElement("canvas");
  picture.width = widths.reduce((sum, width) => sum + width, 0) + GAP_PX * scale * (panes.length - 1);
  picture.height = tall + TITLE_PX * scale;
  const drawing = picture.getContext("2d");
  if (!drawing) throw new Error("no picture can be drawn here");
  drawing.fillStyle = "#fff";
  drawing.fillRect(0, 0, picture.width, picture.height);
  let left = 0;
  for (const pane of panes) {
    drawing.fillStyle = "#111";
    drawing.font = `${13 * scale}px system-ui, sans-serif`;
    drawing.fillText(state.layer(pane.shown.layer).title, left, 17 * scale);
    for (const { layer, canvas } of pane.canvases()) {
      drawing.drawImage(coloured(canvas, state, layer), left, TITLE_PX * scale);
    }
    drawing.drawImage(pane.marksCanvas, left, TITLE_PX * scale);
    left += pane.marksCanvas.width + GAP_PX * scale;
  }
  return picture;
}

function coloured(canvas: HTMLCanvasElement, state: State, layer: string): HTMLCanvasElement {
  const copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  const drawing = copy.getContext("2d");
  if (!drawing) return copy;
  drawing.drawImage(canvas, 0, 0);
  const part = state.layer(layer);
  if (part.kind === "classes") return copy;
  const table = lookUpTable(part, state.colouring(layer));
  const image = drawing.getImageData(0, 0, copy.width, copy.height);
  for (let k = 0; k < image.data.length; k += 4) {
    const colour = table[image.data[k] ?? 0];
    if (colour) image.data.set(colour, k);
  }
  drawing.putImageData(image, 0, 0);
  return copy;
}
