/** Drawing with the pointer and with keys: strokes of the brush, outlines by hand or by corners. */

import type { State } from "./state";
import type { Place } from "./wall";

/** A stroke has a point every so many pixels. */
const STEP_PX = 3;

export class Painter {
  constructor(private readonly state: State) {}

  /** Whether the pointer draws on what a pane shows of `side`. */
  draws(side: string | null): boolean {
    const { painting } = this.state;
    return painting.active && side === painting.side;
  }

  press(place: Place): void {
    const { painting } = this.state;
    // an outline by corners goes on
    painting.stroke = painting.tool === "outline" ? [...painting.stroke, place] : [place];
    this.state.tell("painting");
  }

  drag(place: Place, mm_per_px: number): void {
    const { painting } = this.state;
    const last = painting.stroke[painting.stroke.length - 1];
    const radius_mm = this.state.description.wall.radius_mm;
    if (last && Math.hypot((place.theta_rad - last.theta_rad) * radius_mm, place.z_mm - last.z_mm) < STEP_PX * mm_per_px) return;
    painting.stroke = [...painting.stroke, place];
    this.state.tell("painting");
  }

  /** The pointer was let go; `moved`: it was drawn by hand, not clicked. */
  release(moved: boolean): void {
    const { painting } = this.state;
    if (painting.tool !== "outline" || moved) this.close();
  }

  /** Close the outline, or end the stroke. */
  close(): void {
    const { painting } = this.state;
    const frames = this.state.description.frames.find((part) => part.side === painting.side);
    if (frames) painting.finish(frames.placement);
    this.state.tell("painting");
  }

  toggle(): void {
    const { painting, description } = this.state;
    if (description.sides.length < 2) return;
    painting.active = !painting.active;
    painting.stroke = [];
    if (painting.active && !painting.side) painting.begin(description.sides[0] ?? "", "cells");
    this.state.tell("painting");
  }

  /** Draw on `side`; what was drawn so far stays. */
  beginOn(side: string): void {
    const { painting } = this.state;
    if (!painting.shapes.length) painting.begin(side, "cells");
    painting.active = true;
    this.state.tell("painting");
  }

  /** Keys while a mask is drawn; say whether the key was meant so. */
  key(event: KeyboardEvent): boolean {
    const { painting } = this.state;
    if (!painting.active || event.target instanceof HTMLInputElement) return false;
    const key = event.key.toLowerCase();
    const isUndo = (event.ctrlKey || event.metaKey) && !event.altKey && key === "z";
    if (isUndo && event.shiftKey) painting.redo();
    else if (isUndo) painting.undo();
    else if (key === "enter" && painting.stroke.length) this.close();
    else if (key === "escape" && painting.stroke.length) painting.stroke = [];
    else if (key === "e" && !event.ctrlKey && !event.metaKey) painting.adds = !painting.adds;
    else if (key === "[" || key === "]") painting.radius_mm = Math.min(5, Math.max(0.005, painting.radius_mm * (key === "]" ? 1.25 : 0.8)));
    else return false;
    event.preventDefault();
    this.state.tell("painting");
    return true;
  }
}
