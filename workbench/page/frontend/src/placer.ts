/** Placing landmarks by clicks and keys, one end, then the other; and notes. */

import { toOwn } from "./placement";
import type { State } from "./state";
import type { Place } from "./wall";

/** Of what is pointed at: no rim is sharper. */
const LEAST_SIGMA_MM = 0.02;
/** By so many pixels a hand is off. */
const HAND_PX = 2;

export class Placer {
  constructor(private readonly state: State) {}

  /** Take a click on a layer of `side` for an end of a pair, and one on the other side for its other end. */
  place(shown: Place, side: string | null, mm_per_px: number): void {
    const { landmarks } = this.state;
    const [a, b] = this.state.description.frames;
    const frames = [a, b].find((part) => part?.side === side);
    if (!a || !b || !frames) return; // of both sides at once it is not known on which the place lies
    const end = { side: frames.side, place: toOwn(frames.placement, shown), sigma_mm: HAND_PX * mm_per_px };
    const { pending } = landmarks;
    if (!pending || pending.side === end.side) {
      landmarks.pending = end;
    } else {
      const [of_a, of_b] = end.side === a.side ? [end, pending] : [pending, end];
      const sigma_mm = Number(Math.min(Math.max(Math.hypot(of_a.sigma_mm, of_b.sigma_mm), LEAST_SIGMA_MM), 10).toFixed(4));
      landmarks.pending = null;
      landmarks.change({ pairs: [...landmarks.pairs, { a: of_a.place, b: of_b.place, role: "correct", name: "", sigma_mm }] });
    }
    this.state.tell("landmarks");
  }

  toggle(what: "active" | "noting" = "active"): void {
    if (this.state.description.sides.length < 2) return;
    const { landmarks } = this.state;
    const on = !landmarks[what];
    [landmarks.active, landmarks.noting, landmarks.pending] = [false, false, null];
    landmarks[what] = on;
    this.state.tell("landmarks");
  }

  /** Forget an end that waits for the other, or a place that waits for its note; say whether there was one. */
  forget(): boolean {
    const { landmarks } = this.state;
    if (!landmarks.pending && !landmarks.draft) return false;
    [landmarks.pending, landmarks.draft] = [null, null];
    this.state.tell("landmarks");
    return true;
  }

  /** Undo and redo by keys; say whether the key was meant so. */
  key(event: KeyboardEvent): boolean {
    const isUndo = (event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "z";
    if (!isUndo || event.target instanceof HTMLInputElement) return false; // a text has an undo of its own
    event.preventDefault();
    if (event.shiftKey) this.state.landmarks.redo();
    else this.state.landmarks.undo();
    this.state.tell("landmarks");
    return true;
  }
}
