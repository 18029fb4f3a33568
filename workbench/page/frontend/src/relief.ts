/** The wall's relief as it arrives, and the surface that is made of it. */

import type { Wall } from "./wall";

/** Wall radius − bore radius in mm, NaN where not observed; column j of n has its centre at θ = (j + ½) · 2π/n. */
export interface Relief {
  columns: number;
  z_mm: Float32Array;
  values: Float32Array;
}

/** Columns and rows of a wall without relief. */
const SMOOTH_COLUMNS = 256;
const SMOOTH_ROWS = 2;

/** As workbench/page/layers.py writes it. */
export function readRelief(bytes: ArrayBuffer): Relief {
  const head = new DataView(bytes);
  const [rows, columns] = [head.getUint32(0, true), head.getUint32(4, true)];
  const [low, high] = [head.getFloat32(8, true), head.getFloat32(12, true)];
  const z_mm = new Float32Array(rows);
  for (let k = 0; k < rows; k += 1) z_mm[k] = head.getFloat32(16 + 4 * k, true);
  const values = new Float32Array(rows * columns);
  const first = 16 + 4 * rows;
  for (let k = 0; k < values.length; k += 1) {
    const code = head.getUint16(first + 2 * k, true);
    values[k] = code === 0 ? NaN : low + ((code - 1) / 65534) * (high - low);
  }
  return { columns, z_mm, values };
}

export function smoothRelief(wall: Wall): Relief {
  const z_mm = new Float32Array([wall.part.top_mm, wall.part.bottom_mm]);
  return { columns: SMOOTH_COLUMNS, z_mm, values: new Float32Array(SMOOTH_COLUMNS * SMOOTH_ROWS) };
}

/** From where to where along z anything is known, mm; null where nothing is. */
export function knownRange({ columns, z_mm, values }: Relief): [number, number] | null {
  const known = [...z_mm].filter((_, row) => values.subarray(row * columns, (row + 1) * columns).some((one) => !Number.isNaN(one)));
  const [first, last] = [known[0], known[known.length - 1]];
  return first === undefined || last === undefined ? null : [first, last];
}

/** Corners of triangles, in mm of the bore frame, where z runs inward; `place` has θ in turns and z in mm. */
export interface Surface {
  position: Float32Array;
  normal: Float32Array;
  place: Float32Array;
  triangles: Uint32Array;
}

/** The surface of the wall. Its last column is its first one a turn on, so that it closes; unknown corners leave holes. */
export function surfaceOf(relief: Relief, radius_mm: number): Surface {
  const { columns, z_mm, values } = relief;
  const [rows, wide] = [z_mm.length, columns + 1];
  const [position, normal, place] = [3, 3, 2].map((n) => new Float32Array(n * rows * wide)) as [Float32Array, Float32Array, Float32Array];
  const radius = (row: number, column: number): number => radius_mm + (values[row * columns + (column % columns)] ?? NaN);
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < wide; column += 1) {
      const at = row * wide + column;
      const turn = (column + 0.5) / columns;
      const r = radius(row, column);
      const known = Number.isNaN(r) ? radius_mm : r;
      const [cos, sin] = [Math.cos(2 * Math.PI * (turn % 1)), Math.sin(2 * Math.PI * (turn % 1))];
      position.set([known * cos, known * sin, z_mm[row] ?? 0], 3 * at);
      place.set([turn, z_mm[row] ?? 0], 2 * at);
      // slopes from neighbours that are known, else as if it were smooth
      const along = slope(radius(row, column + columns - 1), r, radius(row, column + 1)) / ((2 * Math.PI) / columns);
      const [before, after] = [Math.max(row - 1, 0), Math.min(row + 1, rows - 1)];
      const apart = ((z_mm[after] ?? 0) - (z_mm[before] ?? 0)) / Math.max(after - before, 1);
      const inward = slope(row > 0 ? radius(row - 1, column) : NaN, r, row < rows - 1 ? radius(row + 1, column) : NaN) / (apart || 1);
      // toward the axis, where the light and the eye are
      const [x, y, z] = [-(known * cos + along * sin), -(known * sin - along * cos), known * inward];
      const length = Math.hypot(x, y, z) || 1;
      normal.set([x / length, y / length, z / length], 3 * at);
    }
  }
  return { position, normal, place, triangles: trianglesOf(rows, columns, (row, column) => !Number.isNaN(radius(row, column))) };
}

/** How much a value changes from one neighbour to the next, from those that are known. */
function slope(before: number, here: number, after: number): number {
  const known = [before, here, after].map((one) => !Number.isNaN(one));
  if (known[0] && known[2]) return (after - before) / 2;
  if (known[1] && known[2]) return after - here;
  return known[0] && known[1] ? here - before : 0;
}

function trianglesOf(rows: number, columns: number, isKnown: (row: number, column: number) => boolean): Uint32Array {
  const wide = columns + 1;
  const found = new Uint32Array(6 * (rows - 1) * columns);
  let count = 0;
  for (let row = 0; row + 1 < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      if (!(isKnown(row, column) && isKnown(row, column + 1) && isKnown(row + 1, column) && isKnown(row + 1, column + 1))) continue;
      const at = row * wide + column;
      found.set([at, at + wide, at + 1, at + 1, at + wide, at + wide + 1], count); // counter-clockwise as seen from the axis
      count += 6;
    }
  }
  return found.slice(0, count);
}
