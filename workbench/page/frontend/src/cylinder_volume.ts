/** The dense volume in the scene of the cylinder. */

import {
  BackSide, BoxGeometry, CustomBlending, Data3DTexture, type DataTexture, GLSL3, LinearFilter, Mesh, OneFactor,
  OneMinusSrcAlphaFactor, RedFormat, RepeatWrapping, ShaderMaterial, type Vector2, Vector2 as Pair, Vector3,
} from "three";
import type { Volume } from "./volume";
import { VOLUME_FRAGMENT, VOLUME_VERTEX } from "./volume_shader";

/** Across the bore, at rest and while it is turned. */
const STEPS = 500;
const STEPS_IN_MOTION = 120;

/** What it has in common with the wall: changed there, it changes here. */
export interface Shared {
  colours: { value: DataTexture | null };
  cut: { value: Vector2 };
  range: { value: Vector2 };
  light: { value: number };
}

export type VolumeMesh = Mesh<BoxGeometry, ShaderMaterial>;

export function volumeMesh(volume: Volume, shared: Shared): VolumeMesh {
  const { slices, columns, samples, z_mm, theta_rad, radius_mm, codes } = volume;
  const texture = new Data3DTexture(codes, samples, columns, slices);
  texture.format = RedFormat;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.wrapT = RepeatWrapping; // goes on over θ = 0
  texture.unpackAlignment = 1;
  texture.needsUpdate = true;
  const uniforms = {
    ...shared,
    volume: { value: texture },
    eye: { value: new Vector3() },
    counts: { value: new Vector3(samples, columns, slices) },
    radii: { value: new Pair(...radius_mm) },
    depths: { value: new Pair(...z_mm) },
    first: { value: theta_rad / (2 * Math.PI) },
    limit: { value: 0.35 },
    steps: { value: STEPS },
  };
  const [wide, long] = [2 * radius_mm[1], z_mm[1] - z_mm[0]];
  const box = new BoxGeometry(wide, wide, long).translate(0, 0, z_mm[0] + long / 2);
  const material = new ShaderMaterial({
    glslVersion: GLSL3, vertexShader: VOLUME_VERTEX, fragmentShader: VOLUME_FRAGMENT, uniforms, side: BackSide,
    transparent: true, depthWrite: false, depthTest: false,
    blending: CustomBlending, blendSrc: OneFactor, blendDst: OneMinusSrcAlphaFactor,
  });
  const made = new Mesh(box, material);
  made.rotation.x = Math.PI;
  made.frustumCulled = false;
  return made;
}

/** Say from where it is seen, in the bore frame, and whether it is being turned. */
export function aim({ material }: VolumeMesh, eye_mm: readonly [number, number, number], inMotion: boolean): void {
  material.uniforms["eye"]?.value.set(...eye_mm);
  const steps = material.uniforms["steps"];
  if (steps) steps.value = inMotion ? STEPS_IN_MOTION : STEPS;
}

export function setLimit({ material }: VolumeMesh, share: number): void {
  const limit = material.uniforms["limit"];
  if (limit) limit.value = share;
}

export function disposeVolume({ geometry, material }: VolumeMesh): void {
  material.uniforms["volume"]?.value.dispose();
  geometry.dispose();
  material.dispose();
}
