/** The wall in the page's units. Viewers measure in turns: 1 is once around the circle, along θ as along z. */

import type { WallPart } from "./description";

export const TILE_PX = 256;
export const OVERLAP_PX = 1;

export interface Place {
  theta_rad: number;
  z_mm: number;
}

/** A place somebody points at; where the sides have no place in common, the `side` on whose wall it is, else null. */
export interface Spot extends Place {
  side: string | null;
}

/** What a pane shows: the place in its middle, θ not brought into one turn, and mm of wall for a CSS pixel. */
export interface View extends Place {
  mm_per_px: number;
}

export class Wall {
  readonly circumference_mm: number;

  constructor(readonly part: WallPart) {
    this.circumference_mm = 2 * Math.PI * part.radius_mm;
  }

  get length_mm(): number {
    return this.part.bottom_mm - this.part.top_mm;
  }

  widthPx(level: number): number {
    return TILE_PX * 2 ** level;
  }

  heightPx(level: number): number {
    return Math.ceil(this.length_mm / (this.circumference_mm / this.widthPx(level)) - 1e-6);
  }

  turnsOf(place: Place): { x: number; y: number } {
    return { x: place.theta_rad / (2 * Math.PI), y: (place.z_mm - this.part.top_mm) / this.circumference_mm };
  }

  placeOf(turns: { x: number; y: number }): Place {
    return { theta_rad: turns.x * 2 * Math.PI, z_mm: this.part.top_mm + turns.y * this.circumference_mm };
  }
}

/** θ in [0, 2π). */
export function wrapped(theta_rad: number): number {
  const turn = 2 * Math.PI;
  return ((theta_rad % turn) + turn) % turn;
}

export function degrees(theta_rad: number): number {
  return (wrapped(theta_rad) * 180) / Math.PI;
}

/** The largest of 1, 2 and 5 times a power of ten that is at most `most`. */
export function roundBelow(most: number): number {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((step) => step * power).find((value) => value <= most * (1 + 1e-9)) ?? power;
}
