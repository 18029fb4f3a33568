/** Landmark pairs as they are placed: what there is now, what there was before, and what the server made of them. */

import type { Place } from "./wall";

export type Role = "correct" | "check";

/** A place on either side, each in its side's own frame; the same names as in a session file. */
export interface Pair {
  a: Place;
  b: Place;
  role: Role;
  name: string;
  sigma_mm: number;
}

export interface Distance {
  around_mm: number;
  along_mm: number;
  distance_mm: number;
}

export interface Distances {
  pairs: number;
  median_mm: number;
  max_mm: number;
  around_median_mm: number;
  around_max_mm: number;
  along_median_mm: number;
  along_max_mm: number;
}

/** How far pairs lie apart as shown, and as `endoct compare --session` would have them (`by_hand` of result.json). */
export interface Judged {
  present: { each: (Distance | null)[]; check: Distances | null };
  by_hand: { corrected: boolean; moved: { around_mm: number; along_mm: number } | null; check: Distances | null; pairs: { after: Distance | null }[] } | null;
  said: string[];
  error: string;
}

export interface SessionState {
  sides: Record<string, string>[];
  pairs: Pair[];
  saved: string | null;
  refused: string;
  file: string;
  command: string;
  judged: Judged | null;
}

/** One end of a pair that waits for the other. */
export interface Pending {
  side: string;
  place: Place;
  sigma_mm: number;
}

export class Landmarks {
  active = false;
  pairs: readonly Pair[] = [];
  pending: Pending | null = null;
  judged: Judged | null = null;
  private kept: readonly Pair[] = [];
  private past: (readonly Pair[])[] = [];
  private future: (readonly Pair[])[] = [];

  /** Take in the pairs of a session, before those that a quick hand has placed while it was fetched. */
  load(saved: readonly Pair[]): void {
    const after = (placed: readonly Pair[]): readonly Pair[] => [...saved, ...placed];
    this.kept = saved;
    this.pairs = after(this.pairs);
    this.past = this.past.map(after);
    this.future = this.future.map(after);
  }

  /** Make `pairs` what there is, so that it can be undone. */
  change(pairs: readonly Pair[]): void {
    this.past.push(this.pairs);
    this.future = [];
    this.pairs = pairs;
  }

  replace(k: number, by: Partial<Pair>): void {
    this.change(this.pairs.map((pair, j) => (j === k ? { ...pair, ...by } : pair)));
  }

  remove(k: number): void {
    this.change(this.pairs.filter((_, j) => j !== k));
  }

  get canUndo(): boolean {
    return this.pending !== null || this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  /** Take back the last step; the first end of a pair is one. */
  undo(): void {
    if (this.pending) {
      this.pending = null;
      return;
    }
    const before = this.past.pop();
    if (before === undefined) return;
    this.future.push(this.pairs);
    this.pairs = before;
  }

  redo(): void {
    const next = this.future.pop();
    if (next === undefined) return;
    this.past.push(this.pairs);
    this.pairs = next;
  }

  markSaved(pairs: readonly Pair[]): void {
    this.kept = pairs;
  }

  get isSaved(): boolean {
    return JSON.stringify(this.pairs) === JSON.stringify(this.kept);
  }
}
