/** What the panes show, in the address of the page: a link, a bookmark or "back" brings it back, here and elsewhere. */

import { COLOUR_MAPS } from "./colour_maps";
import type { Colouring } from "./colouring";
import { MODES, type Mode, type PaneState, type State } from "./state";
import type { Spot, View } from "./wall";

const WAIT_MS = 400;
const BEGINS = "#view=";
const MOST_PANES = 6;

interface Shared {
  panes: PaneState[];
  linked: boolean;
  view: View;
  outlines: string[];
  numbers: boolean;
  cylinder: boolean;
  pinned: Spot | null;
  colours: Record<string, Colouring>;
}

export class SharedView {
  private timer = 0;
  /** What the address says; null until what it said at first is shown. */
  private written: string | null = null;

  constructor(private readonly state: State, private readonly view: () => View | undefined) {}

  /** Set what the address says, as far as there is such a thing here; return the view to begin with, if it says one. */
  restore(): View | null {
    const shared = parsed(location.hash);
    if (!shared) return null;
    const { state } = this;
    const keys = new Set(state.description.layers.map((layer) => layer.key));
    const isPane = (pane: PaneState): boolean => keys.has(pane.layer) && keys.has(pane.second) && Object.keys(MODES).includes(pane.mode) && isNumber(pane.share);
    const panes = list<PaneState>(shared.panes).filter(isPane).slice(0, MOST_PANES);
    if (panes.length) state.panes = panes.map(({ layer, second, mode, share }) => ({ layer, second, mode: mode as Mode, share }));
    if (state.description.has_common_places) state.linked = shared.linked !== false;
    const lines = state.description.outlines.map((outline) => outline.layer);
    if (Array.isArray(shared.outlines)) state.outlines = new Set(lines.filter((layer) => shared.outlines?.includes(layer)));
    state.numbers = shared.numbers !== false;
    state.cylinder = shared.cylinder === true;
    for (const [key, colouring] of Object.entries(shared.colours ?? {})) {
      const { map, low, high } = colouring ?? {};
      if (keys.has(key) && Object.keys(COLOUR_MAPS).includes(map) && isNumber(low) && isNumber(high)) state.colourings.set(key, { map, low, high });
    }
    const { pinned, view } = shared;
    const side = pinned && (pinned.side === null || state.description.sides.includes(pinned.side)) ? pinned.side : undefined;
    if (pinned && side !== undefined && isNumber(pinned.theta_rad) && isNumber(pinned.z_mm)) state.pinned = { theta_rad: pinned.theta_rad, z_mm: pinned.z_mm, side };
    return view && isNumber(view.theta_rad) && isNumber(view.z_mm) && isNumber(view.mm_per_px) && view.mm_per_px > 0 ? view : null;
  }

  /** From now on, show what the address is changed to, and note in the address what is shown. */
  follow(): void {
    this.written = this.text();
    window.addEventListener("hashchange", () => {
      if (location.hash.startsWith(BEGINS)) location.reload(); // a link was pasted into the tab
    });
    for (const change of ["panes", "colours", "marks", "cursor", "link"] as const) this.state.on(change, () => this.later());
  }

  later(): void {
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.write(), WAIT_MS);
  }

  private write(): void {
    const text = this.text();
    if (!text || this.written === null || text === this.written) return;
    this.written = text;
    history.replaceState(null, "", `${BEGINS}${text}`);
  }

  private text(): string {
    const { state } = this;
    const view = this.view();
    if (!view) return "";
    const rounded = { theta_rad: round(view.theta_rad), z_mm: round(view.z_mm), mm_per_px: round(view.mm_per_px) };
    const shared: Shared = {
      panes: state.panes, linked: state.linked, view: rounded, outlines: [...state.outlines], numbers: state.numbers,
      cylinder: state.cylinder, pinned: state.pinned, colours: Object.fromEntries(state.colourings),
    };
    return encodeURIComponent(JSON.stringify(shared));
  }
}

function parsed(hash: string): Partial<Shared> | null {
  if (!hash.startsWith(BEGINS)) return null;
  try {
    const shared: unknown = JSON.parse(decodeURIComponent(hash.slice(BEGINS.length)));
    return typeof shared === "object" && shared !== null ? shared : null;
  } catch {
    return null;
  }
}

function list<T>(value: T[] | undefined): T[] {
  return Array.isArray(value) ? value.filter((each) => typeof each === "object" && each !== null) : [];
}

function isNumber(value: unknown): value is number {
  return typeof value === "number" && Number.isFinite(value);
}

function round(value: number): number {
  return Number(value.toPrecision(6));
}
