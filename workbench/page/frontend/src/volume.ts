/** The dense volume as it arrives: codes by slice, by column around the circle, by sample along the radius. */

export interface Volume {
  slices: number;
  columns: number;
  samples: number;
  /** Centres of the first and the last slice, of the first column, of the first and the last sample. */
  z_mm: [first: number, last: number];
  theta_rad: number;
  radius_mm: [first: number, last: number];
  codes: Uint8Array<ArrayBuffer>;
}

/** As workbench/page/volume.py writes it. */
export function readVolume(bytes: ArrayBuffer): Volume {
  const head = new DataView(bytes);
  const [slices, columns, samples] = [0, 4, 8].map((at) => head.getUint32(at, true)) as [number, number, number];
  const [top, bottom, theta_rad, inner, outer] = [12, 16, 20, 24, 28].map((at) => head.getFloat32(at, true)) as [number, number, number, number, number];
  return { slices, columns, samples, z_mm: [top, bottom], theta_rad, radius_mm: [inner, outer], codes: new Uint8Array(bytes, 32) };
}
