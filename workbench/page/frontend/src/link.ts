/** Panes that go together: by the place in their middle and by mm per pixel, however large each of them is. */

import type { Pane } from "./pane";
import type { State } from "./state";
import type { View, Wall } from "./wall";

/** Above what rounding makes of a view that goes through a viewer, below the last step of an animation. */
const SAME = 1e-9;

export class Link {
  constructor(
    private readonly state: State,
    private readonly wall: Wall,
    private readonly panes: () => readonly Pane[],
  ) {}

  /** A pane shows another view: the others follow, unless that is what they were told already. */
  moved(pane: Pane, view: View): void {
    if (!this.state.linked) return;
    const shared = this.state.view;
    if (shared !== null && isSame(shared, view)) return;
    if (shared === null) return;
    this.state.view = view;
    for (const other of this.panes()) if (other !== pane) other.setView(view);
  }

  /** Show `view` in all panes. */
  show(view: View, immediately = true): void {
    const { top_mm, bottom_mm } = this.wall.part;
    const bounded = { ...view, z_mm: Math.min(Math.max(view.z_mm, top_mm), bottom_mm) };
    const panes = this.panes();
    if (immediately || !this.state.linked) {
      this.state.view = bounded;
      for (const pane of panes) pane.setView(bounded, immediately);
    } else {
      panes[0]?.setView(bounded, false); // it leads, and the others follow it on the way
    }
  }
}

function isSame(one: View, other: View): boolean {
  const near = (a: number, b: number): boolean => Math.abs(a - b) <= SAME * Math.max(1, Math.abs(a));
  return (
    near(one.theta_rad, other.theta_rad) &&
    near(one.z_mm, other.z_mm) &&
    Math.abs(one.mm_per_px / other.mm_per_px - 1) < SAME
  );
}
