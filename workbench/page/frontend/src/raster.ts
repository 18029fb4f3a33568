/** The layers of a pane at any fineness: from tiles fetched for it, not from what the screen shows. */

import { lookUpTable } from "./colouring";
import type { Source } from "./source";
import type { State } from "./state";
import { tilePicture } from "./tile_picture";
import { type Shot, secondOpacity, secondPart } from "./together";
import { OVERLAP_PX, TILE_PX, type View, type Wall } from "./wall";

/** A tile's pixel may be this much larger than one of the figure, before finer tiles are taken. */
const COARSEST_PIXEL = 1.25;
/** Of a figure, made at a time: what is held in memory stays small. */
const BAND_PX = 1024;
const AT_ONCE = 6;
const HATCH_PX = 7;

/** Where in turns the corner of a picture is, and how much of a turn its pixel has. */
interface Window {
  x: number;
  y: number;
  pixel: number;
  width: number;
  height: number;
}

/** Return what the pane shows without its marks, `ratio` pixels for a CSS pixel; `told` hears of every tile. */
export async function paneRaster(
  shot: Shot, ratio: number, state: State, source: Source, wall: Wall, told: () => void,
): Promise<HTMLCanvasElement> {
  const [made, drawing] = newCanvas(Math.round(shot.width * ratio), Math.round(shot.height * ratio));
  drawing.save();
  drawing.scale(ratio, ratio);
  hatch(drawing, shot.width, shot.height);
  drawing.restore();
  const window = windowOf(shot.view, wall, made.width, made.height, ratio);
  await drawLayer(drawing, window, shot.shown.layer, state, source, wall, told);
  const opacity = secondOpacity(shot.shown, state.secondShown);
  if (shot.shown.mode === "single" || opacity === 0) return made;
  const part = secondPart(shot, wall);
  if (part) {
    drawing.scale(ratio, ratio);
    drawing.clip(part);
    drawing.setTransform(1, 0, 0, 1, 0, 0);
  }
  drawing.globalAlpha = opacity;
  await drawLayer(drawing, window, shot.shown.second, state, source, wall, told);
  return made;
}

function windowOf(view: View, wall: Wall, width: number, height: number, ratio: number): Window {
  const pixel = view.mm_per_px / ratio / wall.circumference_mm;
  const middle = wall.turnsOf(view);
  return { x: middle.x - (width / 2) * pixel, y: middle.y - (height / 2) * pixel, pixel, width, height };
}

async function drawLayer(
  drawing: CanvasRenderingContext2D, window: Window, layer: string, state: State, source: Source, wall: Wall, told: () => void,
): Promise<void> {
  const part = state.layer(layer);
  const wanted = Math.ceil(Math.log2(1 / (TILE_PX * COARSEST_PIXEL * window.pixel)));
  const level = Math.min(Math.max(wanted, 0), source.finestLevel(part.key));
  // single samples are shown as they are, as on the screen
  const smooth = window.pixel * wall.circumference_mm > Math.min(part.row_mm, part.column_mm);
  const table = part.kind === "scalar" ? lookUpTable(part, state.colouring(part.key)) : null;
  for (let top = 0; top < window.height; top += BAND_PX) {
    const height = Math.min(BAND_PX, window.height - top);
    const band = { ...window, y: window.y + top * window.pixel, height };
    const [canvas, into] = newCanvas(band.width, height);
    into.imageSmoothingEnabled = smooth;
    into.imageSmoothingQuality = "high";
    await drawBand(into, band, (column, row) => source.tileUrl(part.key, level, column, row), level, wall, told);
    if (table) colour(into, canvas, table);
    drawing.drawImage(canvas, 0, top);
  }
}

/** Draw tiles together at their own fineness, and then as large as wanted, so that no seam can come about. */
async function drawBand(
  into: CanvasRenderingContext2D, band: Window, url: (column: number, row: number) => string, level: number, wall: Wall, told: () => void,
): Promise<void> {
  const perTurn = wall.widthPx(level);
  const span = (from: number, pixels: number): [number, number] =>
    [Math.floor(from * perTurn) - 1, Math.ceil((from + pixels * band.pixel) * perTurn) + 1];
  const [left, right] = span(band.x, band.width);
  const [first, last] = span(band.y, band.height);
  const [top, bottom] = [Math.max(first, 0), Math.min(last, wall.heightPx(level))];
  if (bottom <= top) return;
  const [mosaic, tiles] = newCanvas(right - left, bottom - top);
  const wanted: [column: number, row: number][] = [];
  for (let row = Math.floor(top / TILE_PX); row * TILE_PX < bottom; row += 1) {
    for (let column = Math.floor(left / TILE_PX); column * TILE_PX < right; column += 1) wanted.push([column, row]);
  }
  const around = perTurn / TILE_PX;
  const work = async (): Promise<void> => {
    for (let next = wanted.pop(); next; next = wanted.pop()) {
      const [column, row] = next;
      const picture = await tilePicture(url(((column % around) + around) % around, row));
      tiles.drawImage(picture, column * TILE_PX - OVERLAP_PX - left, Math.max(row * TILE_PX - OVERLAP_PX, 0) - top);
      told();
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, work));
  const scale = 1 / (perTurn * band.pixel);
  const [x, y] = [(left / perTurn - band.x) / band.pixel, (top / perTurn - band.y) / band.pixel];
  into.drawImage(mosaic, x, y, mosaic.width * scale, mosaic.height * scale);
}

function colour(drawing: CanvasRenderingContext2D, canvas: HTMLCanvasElement, table: readonly [number, number, number][]): void {
  const image = drawing.getImageData(0, 0, canvas.width, canvas.height);
  for (let k = 0; k < image.data.length; k += 4) {
    const [red, green, blue] = table[image.data[k] ?? 0] ?? [0, 0, 0];
    image.data[k] = red;
    image.data[k + 1] = green;
    image.data[k + 2] = blue;
  }
  drawing.putImageData(image, 0, 0);
}

/** What was not observed is hatched, as in the panes and in the figures of a report. */
function hatch(drawing: CanvasRenderingContext2D, width: number, height: number): void {
  drawing.fillStyle = "#b9d0f2";
  drawing.fillRect(0, 0, width + 1, height + 1); // to the very edge, where pixels are no whole ones
  drawing.strokeStyle = "#7f9fd0";
  drawing.beginPath();
  for (let x = -height; x < width; x += HATCH_PX * Math.SQRT2) {
    drawing.moveTo(x, 0);
    drawing.lineTo(x + height, height);
  }
  drawing.stroke();
}

function newCanvas(width: number, height: number): [HTMLCanvasElement, CanvasRenderingContext2D] {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const drawing = canvas.getContext("2d", { willReadFrequently: true });
  if (!drawing) throw new Error("no picture can be drawn here");
  return [canvas, drawing];
}
