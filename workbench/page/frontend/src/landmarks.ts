/** Landmark pairs and notes as they are placed: what there is now, what there was before, and what the server made of them. */

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

/** What is noted at a place, in the frame of its side; the same names as in a session file. */
export interface Note {
  side: "a" | "b";
  place: Place;
  text: string;
}

export interface Placed {
  pairs: readonly Pair[];
  notes: readonly Note[];
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
  notes: Note[];
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
  /** Whether a click is for a note. */
  noting = false;
  placed: Placed = { pairs: [], notes: [] };
  pending: Pending | null = null;
  /** Where a note is being written. */
  draft: Note | null = null;
  judged: Judged | null = null;
  private kept: Placed = this.placed;
  private past: Placed[] = [];
  private future: Placed[] = [];

  get pairs(): readonly Pair[] {
    return this.placed.pairs;
  }

  get notes(): readonly Note[] {
    return this.placed.notes;
  }

  /** Take in what is saved by now, and do to it what was done here since the last time: nothing of either is lost. */
  load({ pairs, notes }: Placed): void {
    const { kept } = this;
    const both = (now: Placed): Placed => ({ pairs: merged(pairs, kept.pairs, now.pairs), notes: merged(notes, kept.notes, now.notes) });
    this.kept = { pairs, notes };
    this.placed = both(this.placed);
    this.past = this.past.map(both);
    this.future = this.future.map(both);
  }

  /** Make `by` what there is, so that it can be undone. */
  change(by: Partial<Placed>): void {
    this.past.push(this.placed);
    this.future = [];
    this.placed = { ...this.placed, ...by };
  }

  replace(k: number, by: Partial<Pair>): void {
    this.change({ pairs: this.pairs.map((pair, j) => (j === k ? { ...pair, ...by } : pair)) });
  }

  remove(k: number): void {
    this.change({ pairs: this.pairs.filter((_, j) => j !== k) });
  }

  /** Give a note another text, without one take it away; one that is not there yet, or any more, is added. */
  rewrite(note: Note, text: string): void {
    if (text === note.text) return;
    const at = this.notes.findIndex((one) => JSON.stringify(one) === JSON.stringify(note));
    const by = text ? [{ ...note, text }] : [];
    this.change({ notes: at < 0 ? [...this.notes, ...by] : [...this.notes.slice(0, at), ...by, ...this.notes.slice(at + 1)] });
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
    this.future.push(this.placed);
    this.placed = before;
  }

  redo(): void {
    const next = this.future.pop();
    if (next === undefined) return;
    this.past.push(this.placed);
    this.placed = next;
  }

  markSaved(placed: Placed): void {
    this.kept = placed;
  }

  get isSaved(): boolean {
    return JSON.stringify(this.placed) === JSON.stringify(this.kept);
  }
}

/** What is `saved` without what was removed since `kept`, and with what was added. */
function merged<T>(saved: readonly T[], kept: readonly T[], now: readonly T[]): T[] {
  const lacks = (all: readonly T[]) => (one: T): boolean => !all.some((other) => JSON.stringify(other) === JSON.stringify(one));
  const removed = kept.filter(lacks(now));
  return [...saved.filter(lacks(removed)), ...now.filter(lacks([...kept, ...saved]))];
}
