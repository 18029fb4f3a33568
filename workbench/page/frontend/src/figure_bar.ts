/** The colour bar of a layer in a figure: what it shows, its unit, its limits; of classes their names. */

import { colourAt } from "./colouring";
import type { LayerPart } from "./description";
import type { Drawing } from "./drawing";
import type { State } from "./state";
import { FONT, textWidth } from "./vector_drawing";

const SIZE_PX = 10;
const LINE_PX = 13;
const BAR_PX = 9;
const SPARE_PX = 6;
const SWATCH_PX = 9;

export function barHeight(state: State, key: string, width: number): number {
  const layer = state.layer(key);
  return layer.kind === "classes" ? classLines(layer, width).length * (LINE_PX + 1) + SPARE_PX : 2 * LINE_PX + BAR_PX + SPARE_PX;
}

export function drawBar(drawing: Drawing, state: State, key: string, x: number, y: number, width: number): void {
  const layer = state.layer(key);
  drawing.font = `${SIZE_PX}px ${FONT}`;
  drawing.textBaseline = "top";
  drawing.textAlign = "left";
  if (layer.kind === "classes") {
    drawClasses(drawing, layer, x, y, width);
    return;
  }
  const { low, high, map } = state.colouring(key);
  drawing.fillStyle = "#111";
  drawing.fillText(`${layer.title}, ${layer.unit}`, x, y);
  drawing.drawImage(gradient(map), x, y + LINE_PX, width, BAR_PX);
  const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.max(layer.high - layer.low, 1e-9))));
  const text = (value: number): string => value.toFixed(digits).replace("-", "−");
  drawing.fillStyle = "#111";
  drawing.fillText(text(low), x, y + LINE_PX + BAR_PX + 2);
  drawing.textAlign = "right";
  drawing.fillText(text(high), x + width, y + LINE_PX + BAR_PX + 2);
  drawing.textAlign = "left";
}

function gradient(map: string): HTMLCanvasElement {
  const made = document.createElement("canvas");
  [made.width, made.height] = [256, 8]; // of several rows, since some programs blur a picture at its edges
  const drawing = made.getContext("2d");
  if (!drawing) return made;
  for (let k = 0; k < 256; k += 1) {
    const [red, green, blue] = colourAt(map, k / 255).map((one) => Math.round(255 * one));
    drawing.fillStyle = `rgb(${red} ${green} ${blue})`;
    drawing.fillRect(k, 0, 1, made.height);
  }
  return made;
}

function drawClasses(drawing: Drawing, layer: LayerPart, x: number, y: number, width: number): void {
  classLines(layer, width).forEach((line, row) => {
    let at = x;
    const top = y + row * (LINE_PX + 1);
    for (const { label, colour, wide } of line) {
      drawing.fillStyle = colour;
      drawing.fillRect(at, top, SWATCH_PX, SWATCH_PX);
      drawing.fillStyle = "#111";
      drawing.fillText(label, at + SWATCH_PX + 4, top);
      at += wide;
    }
  });
}

/** The classes in lines no wider than `width`. */
function classLines(layer: LayerPart, width: number): { label: string; colour: string; wide: number }[][] {
  const lines: { label: string; colour: string; wide: number }[][] = [[]];
  let left = width;
  for (const { label, colour } of layer.classes) {
    const wide = SWATCH_PX + 4 + textWidth(label, SIZE_PX, false) + 10;
    if (wide > left && lines[lines.length - 1]?.length) {
      lines.push([]);
      left = width;
    }
    lines[lines.length - 1]?.push({ label, colour, wide });
    left -= wide;
  }
  return lines;
}
