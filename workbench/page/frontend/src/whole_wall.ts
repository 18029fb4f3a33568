/** The whole wall as one picture of a layer, as large as graphics memory takes it. */

import type { Source } from "./source";
import { tilePicture } from "./tile_picture";
import { OVERLAP_PX, TILE_PX, type Wall } from "./wall";

/** Graphics that can take no more are still in use. */
const MOST_SIDE_PX = 8192;
const MOST_PX = 16_000_000;
const MOST_TILES = 260;
const AT_ONCE = 6;

/** The finest level at which the whole wall is a picture of at most `most` pixels along a side. */
export function wholeLevel(source: Source, wall: Wall, layer: string, most: number): number {
  let level = 0;
  for (let next = 0; next <= source.finestLevel(layer); next += 1) {
    const [width, height] = [wall.widthPx(next), wall.heightPx(next)];
    const tiles = (width / TILE_PX) * Math.ceil(height / TILE_PX);
    if (Math.max(width, height) <= Math.min(most, MOST_SIDE_PX) && width * height <= MOST_PX && tiles <= MOST_TILES) level = next;
  }
  return level;
}

/** The wall at `level`, once around; null where by then nobody `wants` it any more. */
export async function wholeWall(source: Source, wall: Wall, layer: string, level: number, wants: () => boolean): Promise<HTMLCanvasElement | null> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [wall.widthPx(level), wall.heightPx(level)];
  const drawing = canvas.getContext("2d");
  if (!drawing) throw new Error("no picture can be drawn here");
  const tiles: [column: number, row: number][] = [];
  for (let row = 0; row * TILE_PX < canvas.height; row += 1) {
    for (let column = 0; column * TILE_PX < canvas.width; column += 1) tiles.push([column, row]);
  }
  const work = async (): Promise<void> => {
    for (let next = tiles.pop(); next && wants(); next = tiles.pop()) {
      const [column, row] = next;
      const picture = await tilePicture(source.tileUrl(layer, level, column, row));
      drawing.drawImage(picture, column * TILE_PX - OVERLAP_PX, Math.max(row * TILE_PX - OVERLAP_PX, 0));
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, work));
  return wants() ? canvas : null;
}

/** From where to where along z a picture of the whole wall shows anything, mm; null where it shows nothing. */
export function shownRange(picture: HTMLCanvasElement, wall: Wall): [number, number] | null {
  const { width, height } = picture;
  const data = picture.getContext("2d")?.getImageData(0, 0, width, height).data;
  const rows = Array.from({ length: height }, (_, row) => row);
  const isShown = (row: number): boolean => {
    for (let k = row * width; k < (row + 1) * width; k += 1) if (data?.[4 * k + 3]) return true;
    return false;
  };
  const [first, last] = [rows.find(isShown), rows.reverse().find(isShown)];
  const pixel_mm = wall.circumference_mm / width;
  const { top_mm, bottom_mm } = wall.part;
  return first === undefined || last === undefined ? null : [top_mm + first * pixel_mm, Math.min(top_mm + (last + 1) * pixel_mm, bottom_mm)];
}

/** How much of z the picture of `level` covers: its last row may reach beyond the wall. */
export function wholeLength_mm(wall: Wall, level: number): number {
  return (wall.heightPx(level) * wall.circumference_mm) / wall.widthPx(level);
}
