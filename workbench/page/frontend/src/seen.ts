/** Where a place of the wall is seen in a picture of a frame. */

import type { FramePicture } from "./source";
import type { Place } from "./wall";

/** A place in the coordinates of a picture; y null where only the column is known. */
export interface Spotted {
  x: number;
  y: number | null;
}

const TURN = 2 * Math.PI;

/** Where `place`, in the frame of the side, is seen; null where it is not, or nobody knows. */
export function seenAt(picture: FramePicture, place: Place): Spotted | null {
  const { seen } = picture;
  if (!seen) return null;
  const last = seen.z_mm.length - 1;
  const [top, bottom] = [seen.z_mm[0] ?? 0, seen.z_mm[last] ?? 0];
  if (last > 0 && (place.z_mm < top || place.z_mm > bottom)) return null;
  const above = Math.max(0, Math.min(seen.z_mm.findIndex((z_mm) => z_mm >= place.z_mm) - 1, last - 1));
  const rows = last > 0 ? [above, above + 1] : [0, 0];
  const [z0, z1] = rows.map((row) => seen.z_mm[row] ?? 0) as [number, number];
  const down = z1 > z0 ? (place.z_mm - z0) / (z1 - z0) : 0;
  const period = picture.x_label.endsWith("(rad)") ? TURN : Infinity;
  const [one, other] = rows.map((row) => along(seen.x[row] ?? [], seen.y[row] ?? [], place.theta_rad, period));
  if (!one || !other) return one ?? other ?? null;
  return between(one, other, down, period);
}

/** Between two neighbours along θ, a circle. */
function along(x: readonly (number | null)[], y: readonly (number | null)[], theta_rad: number, period: number): Spotted | null {
  const n = x.length;
  if (!n) return null;
  const at = ((((theta_rad / TURN) * n) % n) + n) % n;
  const k = Math.floor(at);
  const of = (j: number): Spotted | null => {
    const found = x[j % n];
    return found === null || found === undefined ? null : { x: found, y: y[j % n] ?? null };
  };
  const [one, other] = [of(k), of(k + 1)];
  if (!one || !other) return at - k < 0.5 ? one : other;
  return between(one, other, at - k, period);
}

function between(one: Spotted, other: Spotted, share: number, period: number): Spotted {
  const apart = other.x - one.x;
  const short = Number.isFinite(period) ? apart - period * Math.round(apart / period) : apart;
  const y = one.y === null || other.y === null ? (share < 0.5 ? one.y : other.y) : one.y + share * (other.y - one.y);
  return { x: one.x + share * short, y };
}
