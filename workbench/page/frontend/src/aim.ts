/** A cursor that keys move through a pane, and a key that clicks there: for the marked place, the ruler and landmarks. */

import type { Pane } from "./pane";
import type { View } from "./wall";

const STEP_PX = 10;
const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

export class Aim {
  private pane: Pane | null = null;
  private x = 0;
  private y = 0;

  constructor(
    private readonly panes: () => readonly Pane[],
    private readonly show: (pane: Pane, view: View) => void,
  ) {}

  /** Take the key, if it is meant for the cursor; say whether it was. */
  key(event: KeyboardEvent): boolean {
    if (event.key.toLowerCase() === "c") {
      this.next();
      return true;
    }
    const { pane } = this;
    if (!pane || !this.panes().includes(pane) || !pane.isFocused) return false;
    const arrow = ARROWS[event.key];
    if (arrow) this.move(pane, arrow, event.shiftKey ? 1 : STEP_PX);
    else if (event.key === "Enter" || event.key === " ") pane.clickAt(this.x, this.y);
    else if (event.key === "Escape") this.end(pane);
    else return false;
    return true;
  }

  /** Into the middle of the next pane; after the last of the first. */
  private next(): void {
    const panes = this.panes();
    const next = panes[this.pane?.isFocused ? (panes.indexOf(this.pane) + 1) % panes.length : 0];
    if (!next) return;
    this.pane = next;
    this.x = Math.round(next.width / 2);
    this.y = Math.round(next.height / 2);
    next.focus();
    next.pointAt(this.x, this.y);
  }

  /** The cursor stays in view: at the edge the wall moves under it. */
  private move(pane: Pane, [across, down]: readonly [number, number], step: number): void {
    const [x, y] = [this.x + across * step, this.y + down * step];
    this.x = Math.min(Math.max(x, 0), pane.width);
    this.y = Math.min(Math.max(y, 0), pane.height);
    if (this.x !== x || this.y !== y) {
      const beyond = pane.placeAt(pane.width / 2 + x - this.x, pane.height / 2 + y - this.y);
      this.show(pane, { ...pane.view(), theta_rad: beyond.theta_rad, z_mm: beyond.z_mm });
    }
    pane.pointAt(this.x, this.y);
  }

  private end(pane: Pane): void {
    this.pane = null;
    pane.leave();
  }
}
