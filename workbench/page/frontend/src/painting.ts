/** A mask as it is drawn: strokes of a brush and outlines over a ground, what there was before, and what came of them. */

import type { PlacementPart } from "./description";
import { toOwn } from "./placement";
import type { Place } from "./wall";

/** The last fills a hole by a click, or takes a cell away. */
export type Tool = "brush" | "outline" | "cell";

/** As the server takes it: points are θ in rad, running on over the seam, and z in mm, in the frame of the side. */
export interface Shape {
  points: [theta_rad: number, z_mm: number][];
  adds: boolean;
  radius_mm: number | null;
}

export interface Drawing {
  side: string;
  ground: string;
  shapes: readonly Shape[];
}

export interface SavedMasks {
  masks: Record<string, string[]>;
  refused: string;
}

const TURN = 2 * Math.PI;

export class Painting {
  active = false;
  tool: Tool = "brush";
  adds = true;
  radius_mm = 0.1;
  side = "";
  ground = "cells";
  shapes: readonly Shape[] = [];
  /** The shape that is being drawn, in the frame that is shown. */
  stroke: Place[] = [];
  /** Outlines of what will be saved, as the server has them. */
  lines: readonly (readonly number[])[] = [];
  /** What was saved last, or was there at first: the same list as ``shapes`` until something is drawn. */
  private kept: readonly Shape[] = this.shapes;
  private past: (readonly Shape[])[] = [];
  private future: (readonly Shape[])[] = [];

  /** Begin anew on a side, over a ground. */
  begin(side: string, ground: string): void {
    this.side = side;
    this.ground = ground;
    this.shapes = this.kept = [];
    this.stroke = [];
    this.past = [];
    this.future = [];
  }

  /** Add what was drawn; a place of the side's own lies within half a turn of the one before. */
  finish(placement: PlacementPart): void {
    const points: [number, number][] = [];
    for (const place of this.stroke) {
      const own = toOwn(placement, place);
      const before = points[points.length - 1]?.[0] ?? own.theta_rad;
      points.push([own.theta_rad + TURN * Math.round((before - own.theta_rad) / TURN), own.z_mm]);
    }
    this.stroke = [];
    if (this.tool === "cell") points.splice(0, points.length - 1);
    if (!points.length || (this.tool === "outline" && points.length < 3)) return;
    this.change([...this.shapes, { points, adds: this.adds, radius_mm: this.tool === "brush" ? this.radius_mm : this.tool === "cell" ? 0 : null }]);
  }

  get drawing(): Drawing {
    return { side: this.side, ground: this.ground, shapes: this.shapes };
  }

  get canUndo(): boolean {
    return this.stroke.length > 0 || this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  get isSaved(): boolean {
    return this.shapes === this.kept;
  }

  undo(): void {
    if (this.stroke.length) {
      this.stroke = [];
      return;
    }
    const before = this.past.pop();
    if (before === undefined) return;
    this.future.push(this.shapes);
    this.shapes = before;
  }

  redo(): void {
    const next = this.future.pop();
    if (next === undefined) return;
    this.past.push(this.shapes);
    this.shapes = next;
  }

  /** Go on with what was drawn before the page was left. */
  resume({ side, ground, shapes }: Drawing): void {
    this.begin(side, ground);
    this.change(shapes);
    this.active = true;
  }

  /** What was sent is saved; what was drawn since is not. */
  markSaved(shapes: readonly Shape[]): void {
    this.kept = shapes;
  }

  private change(shapes: readonly Shape[]): void {
    this.past.push(this.shapes);
    this.future = [];
    this.shapes = shapes;
  }
}
