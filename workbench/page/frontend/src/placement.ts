/** Places of a side in its own frame, and where they lie on the wall that is shown. */

import type { PlacementPart } from "./description";
import { type Place, wrapped } from "./wall";

export function toShown(placement: PlacementPart, own: Place): Place {
  const { theta_shift_rad, mirrored, z_shift_mm, z_scale, z_reversed, bend } = placement;
  const z_mm = z_shift_mm + z_scale * (z_reversed ? -1 : 1) * own.z_mm;
  const roll_rad = bend ? between(bend.z_mm, bend.roll_rad, z_mm) : 0;
  return {
    theta_rad: wrapped(theta_shift_rad + roll_rad + (mirrored ? -1 : 1) * own.theta_rad),
    z_mm: z_mm + (bend ? between(bend.z_mm, bend.shift_mm, z_mm) : 0),
  };
}

export function toOwn(placement: PlacementPart, shown: Place): Place {
  const { theta_shift_rad, mirrored, z_shift_mm, z_scale, z_reversed, bend } = placement;
  const bent_mm = bend ? bend.z_mm.map((z_mm, k) => z_mm + bend.shift_mm[k]!) : [];
  const z_mm = shown.z_mm - (bend ? between(bent_mm, bend.shift_mm, shown.z_mm) : 0);
  const roll_rad = bend ? between(bend.z_mm, bend.roll_rad, z_mm) : 0;
  return {
    theta_rad: wrapped((mirrored ? -1 : 1) * (shown.theta_rad - theta_shift_rad - roll_rad)),
    z_mm: ((z_reversed ? -1 : 1) * (z_mm - z_shift_mm)) / z_scale,
  };
}

/** Values at ascending z, linear in between and constant beyond the ends. */
function between(z_mm: number[], values: number[], at_mm: number): number {
  const above = z_mm.findIndex((z) => z > at_mm);
  if (above === 0) return values[0]!;
  if (above < 0) return values[values.length - 1]!;
  const share = (at_mm - z_mm[above - 1]!) / (z_mm[above]! - z_mm[above - 1]!);
  return values[above - 1]! + share * (values[above]! - values[above - 1]!);
}
