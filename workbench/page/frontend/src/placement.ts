/** Places of a side in its own frame, and where they lie on the wall that is shown. */

import type { PlacementPart } from "./description";
import { type Place, wrapped } from "./wall";

export function toShown(placement: PlacementPart, own: Place): Place {
  const { theta_shift_rad, mirrored, z_shift_mm, z_scale, z_reversed } = placement;
  return {
    theta_rad: wrapped(theta_shift_rad + (mirrored ? -1 : 1) * own.theta_rad),
    z_mm: z_shift_mm + z_scale * (z_reversed ? -1 : 1) * own.z_mm,
  };
}

export function toOwn(placement: PlacementPart, shown: Place): Place {
  const { theta_shift_rad, mirrored, z_shift_mm, z_scale, z_reversed } = placement;
  return {
    theta_rad: wrapped((mirrored ? -1 : 1) * (shown.theta_rad - theta_shift_rad)),
    z_mm: ((z_reversed ? -1 : 1) * (shown.z_mm - z_shift_mm)) / z_scale,
  };
}
