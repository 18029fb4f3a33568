/** What the page shows, and who is told when that changes. */

import { type Colouring, firstColouring } from "./colouring";
import type { CellPart, Description, LayerPart, OutlinePart } from "./description";
import { Landmarks } from "./landmarks";
import { Painting } from "./painting";
import type { Place, Spot, View } from "./wall";

export const MODES = {
  single: "alone",
  swipe: "swipe",
  opacity: "opacity",
  blink: "blink (B)",
  checker: "checkerboard",
  lens: "lens",
} as const;
export type Mode = keyof typeof MODES;

export interface PaneState {
  layer: string;
  second: string;
  mode: Mode;
  /** Where a swipe stands, or how opaque the second layer is: 0 to 1. */
  share: number;
}

export type Change = "panes" | "colours" | "marks" | "cursor" | "selection" | "link" | "landmarks" | "painting";

const MOST_DRAWN_AT_FIRST = 1;

export interface Ruler {
  from: Place;
  to: Place | null;
}

export class State {
  panes: PaneState[];
  linked: boolean;
  view: View | null = null;
  outlines: Set<string>;
  numbers = true;
  cursor: Spot | null = null;
  pinned: Spot | null = null;
  selected: CellPart | null = null;
  ringed: ReadonlySet<CellPart> = new Set();
  measuring = false;
  ruler: Ruler | null = null;
  readonly landmarks = new Landmarks();
  readonly painting = new Painting();
  secondShown = true;
  /** Whether the wall is shown as a cylinder, too. */
  cylinder = false;
  readonly colourings = new Map<string, Colouring>();
  private readonly listeners = new Map<Change, (() => void)[]>();
  private readonly layers: Map<string, LayerPart>;

  constructor(readonly description: Description) {
    this.layers = new Map(description.layers.map((layer) => [layer.key, layer]));
    this.linked = description.has_common_places;
    // many raters' lines hide each other
    const isDrawn = (outline: OutlinePart): boolean => outline.is_drawn && !outline.layer.startsWith("wall-");
    const few = description.outlines.filter(isDrawn).length <= MOST_DRAWN_AT_FIRST;
    this.outlines = new Set(description.outlines.filter((outline) => outline.layer !== "wall-cells" && (few || !isDrawn(outline))).map((outline) => outline.layer));
    this.panes = description.panes.map((layer) => ({ layer, second: this.partnerOf(layer), mode: "single", share: 0.5 }));
    for (const layer of description.layers) this.colourings.set(layer.key, firstColouring(layer));
  }

  layer(key: string): LayerPart {
    const found = this.layers.get(key) ?? this.description.layers[0];
    if (found === undefined) throw new Error("there is no layer to show");
    return found;
  }

  colouring(key: string): Colouring {
    return this.colourings.get(key) ?? firstColouring(this.layer(key));
  }

  /** Whether a place on the wall of `side` (null: of both) is one on that of `other`. */
  isCommon(side: string | null, other: string | null): boolean {
    return this.description.has_common_places || side === null || side === other;
  }

  on(change: Change, act: () => void): void {
    this.listeners.set(change, [...(this.listeners.get(change) ?? []), act]);
  }

  tell(change: Change): void {
    for (const act of this.listeners.get(change) ?? []) act();
  }

  /** What is looked at beside a layer most often: the other side's. */
  private partnerOf(key: string): string {
    const side = this.layer(key).side;
    const others = this.description.layers.filter((layer) => layer.side !== side && layer.side !== null);
    const wanted = [others.find((layer) => layer.kind === "scalar"), others[0], this.description.layers[0]];
    return wanted.find((layer) => layer !== undefined)?.key ?? key;
  }
}
