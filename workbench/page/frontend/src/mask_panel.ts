/** The panel for drawing a mask: on which side and over what, with which tool, and under whose name it is saved. */

import { button, element, select } from "./dom";
import type { Drawing, SavedMasks, Tool } from "./painting";
import type { Source } from "./source";
import type { State } from "./state";

const ASK_MS = 60;

export class MaskPanel {
  readonly element = element("section", { class: "masks", "aria-label": "mask" });
  private readonly heading = element("h2");
  private readonly tools = element("div", { class: "tools" });
  private readonly rater = element("input", { "aria-label": "who draws", placeholder: "rater", maxlength: "40" });
  private readonly session = element("input", { "aria-label": "session", value: "1", maxlength: "20" });
  private readonly foot = element("div", { class: "said", "aria-live": "polite" });
  private saved: SavedMasks | null = null;
  private asked = "";
  private timer = 0;
  private message = "";
  private command = "";
  private score = "";
  private isResumed = false;
  private loading: Promise<void> | null = null;
  private saving = false;
  /** Whether the session is one that was typed, which stays. */
  private isTyped = false;
  /** What is not saved is kept for the next visit of this very output. */
  private readonly kept = `endoct-drawing-${document.querySelector<HTMLMetaElement>('meta[name="endoct-output"]')?.content ?? ""}`;

  constructor(private readonly state: State, private readonly source: Source) {
    this.rater.value = "me";
    this.session.addEventListener("input", () => (this.isTyped = true));
    const line = element("div", { class: "tools" }, "as", this.rater, this.session, button("save mask", "write a label image that napari and Fiji read", null, () => void this.save()));
    this.element.append(this.heading, this.tools, line, this.foot);
    this.element.hidden = true;
    state.on("painting", () => this.follow());
    window.addEventListener("beforeunload", (event) => {
      if (!state.painting.isSaved) event.preventDefault();
    });
    this.resume();
  }

  /** Go on with what was drawn here and not saved; what is no drawing of these sides is dropped. */
  private resume(): void {
    try {
      const drawing = JSON.parse(localStorage.getItem(this.kept) ?? "null") as Drawing | null;
      if (!drawing?.shapes.length || !this.state.description.sides.includes(drawing.side)) return;
      this.state.painting.resume(drawing);
      this.isResumed = true;
      requestAnimationFrame(() => this.state.tell("painting")); // once all who listen are there
    } catch {
      localStorage.removeItem(this.kept);
    }
  }

  private keep(): void {
    const { painting } = this.state;
    try {
      if (painting.isSaved) localStorage.removeItem(this.kept);
      else localStorage.setItem(this.kept, JSON.stringify(painting.drawing));
    } catch {
      // a browser that is full, or keeps nothing, asks before the page is left
    }
  }

  private follow(): void {
    const { painting } = this.state;
    this.element.hidden = !painting.active;
    this.keep();
    if (painting.active && !this.saved && !this.loading) void this.load();
    this.draw();
    window.clearTimeout(this.timer);
    if (painting.active) this.timer = window.setTimeout(() => void this.outline(), ASK_MS);
  }

  private load(): Promise<void> {
    this.loading = this.read().finally(() => (this.loading = null));
    return this.loading;
  }

  private async read(): Promise<void> {
    this.saved = await this.source.masks().catch(() => null);
    this.message = this.saved ? this.saved.refused : "Masks are saved where the page is served (endoct serve).";
    if (!this.isTyped) this.number();
    this.draw();
  }

  /** Have the server outline what was drawn: it is what will be saved. */
  private async outline(): Promise<void> {
    const { painting } = this.state;
    const wanted = JSON.stringify(painting.drawing);
    if (wanted === this.asked) return;
    this.asked = wanted;
    try {
      const { lines } = await this.source.outlineDrawing(painting.drawing);
      if (this.asked !== wanted) return;
      painting.lines = lines;
      this.message = this.saved?.refused ?? "";
    } catch (error) {
      if (this.asked !== wanted) return;
      this.message = error instanceof Error ? error.message : String(error);
    }
    this.draw();
    this.state.tell("marks");
  }

  private draw(): void {
    const { painting, description } = this.state;
    const tell = (): void => this.state.tell("painting");
    const act = (label: string, title: string, can: boolean, does: () => void): HTMLButtonElement => {
      const made = button(label, title, null, () => { does(); tell(); });
      made.disabled = !can;
      return made;
    };
    this.heading.replaceChildren("Mask ", element("small", {}, painting.isSaved ? "" : "not saved"),
      element("span", { class: "actions" },
        act("undo", "take back the last shape (Ctrl+Z)", painting.canUndo, () => painting.undo()),
        act("redo", "make it again (Ctrl+Shift+Z)", painting.canRedo, () => painting.redo())));
    const grounds = [["cells", "the cells found"], ["", "nothing"], ...(this.saved?.masks[painting.side] ?? []).map((name) => [name, name])] as [string, string][];
    const begin = (side: string, ground: string): void => {
      if (!painting.isSaved && !window.confirm("What was drawn is not saved. Begin anew?")) {
        this.draw();
        return;
      }
      painting.begin(side, ground);
      this.isTyped = false;
      this.number();
      tell();
    };
    const size = element("input", { type: "range", min: "-2.3", max: "0.5", step: "0.05", "aria-label": "radius of the brush" });
    size.value = String(Math.log10(painting.radius_mm));
    size.addEventListener("input", () => {
      painting.radius_mm = 10 ** Number(size.value);
      radius.textContent = `${painting.radius_mm.toPrecision(2)} mm`;
    });
    const radius = element("small", {}, `${painting.radius_mm.toPrecision(2)} mm`);
    this.tools.replaceChildren(
      select("on which side", description.sides.map((side) => [side, side] as const), painting.side, (side) => begin(side, "cells")),
      select("over what", grounds, painting.ground, (ground) => begin(painting.side, ground)),
      select("with what", [["brush", "brush"], ["outline", "outline"], ["cell", "fill or delete"]], painting.tool, (tool) => { painting.tool = tool as Tool; painting.stroke = []; tell(); }),
      button(painting.adds ? "adds" : "erases", "add cell, or take it away (E)", !painting.adds, () => { painting.adds = !painting.adds; tell(); }),
      ...(painting.tool === "brush" ? [size, radius] : [element("small", {}, painting.tool === "outline" ? "draw around it, or click corners and press Enter" : painting.adds ? "click into a hole to fill it" : "click a cell to delete it")]));
    const names = this.saved?.masks[painting.side] ?? [];
    this.foot.replaceChildren(
      ...(this.message ? [element("p", { class: "refused", role: "alert" }, this.message)] : []),
      ...(this.isResumed && !painting.isSaved ? [element("p", {}, "What you drew before is here again.")] : []),
      ...(names.length ? [element("div", { class: "tools" }, "score against", ...names.map((name) => button(name, "how well each side agrees with this mask", null, () => void this.judge(name))))] : []),
      ...(this.score ? [element("p", {}, this.score)] : []),
      ...this.compared(names),
      ...(this.hasNew() ? [button("show saved masks", "load the page anew: saved masks are layers and outlines then", null, () => location.reload())] : []),
      ...(this.command ? [element("details", {}, element("summary", {}, "Saved. Score against it"), element("code", {}, this.command))] : []));
  }

  /** A link to where the sides can be compared again, with every mask of side A as drawn by a rater. */
  private compared(names: readonly string[]): HTMLElement[] {
    const again = document.querySelector<HTMLElement>("a.above")?.dataset["again"];
    const sides = this.state.description.sides;
    if (!again || !names.length || this.state.painting.side !== sides[0]) return [];
    const asked = [...sides.map((side) => `side=${encodeURIComponent(side)}`), ...names.map((name) => `mask=${encodeURIComponent(name)}`)];
    return [element("a", { class: "act", href: `${again}&${asked.join("&")}` }, `compare again, against ${names.length === 1 ? "this mask" : `these ${names.length} masks`}`)];
  }

  /** Whether a mask was saved since the page was opened, of which it has no layer. */
  private hasNew(): boolean {
    const { layers } = this.state.description;
    return Object.entries(this.saved?.masks ?? {}).some(([side, names]) => names.some((name) => !layers.some((layer) => layer.key === `drawn.${side}.${name}`)));
  }

  private async judge(name: string): Promise<void> {
    try {
      const { scores, command } = await this.source.scoreMask(this.state.painting.side, name);
      const said = Object.entries(scores).map(([side, { jaccard, interval }]) =>
        `${side} ${jaccard === null ? "–" : jaccard.toFixed(3)}${interval ? ` (${interval.map((end) => end.toFixed(2)).join("–")})` : ""}`);
      this.score = `Jaccard index against ${name}: ${said.join(", ")}`;
      this.command = command;
      this.message = "";
    } catch (error) {
      this.message = error instanceof Error ? error.message : String(error);
    }
    this.draw();
  }

  /** The next session that has no mask. */
  private number(): void {
    const names = new Set(this.saved?.masks[this.state.painting.side] ?? []);
    let next = 1;
    while (names.has(`${this.rater.value}_${next}`)) next += 1;
    this.session.value = String(next);
  }

  private async save(): Promise<void> {
    if (this.saving) return;
    this.saving = true;
    const { painting } = this.state;
    const sent = painting.shapes;
    const session = this.session.value;
    try {
      const { command } = await this.source.saveMask({ ...painting.drawing, rater: this.rater.value.trim(), session: session.trim() });
      this.command = command;
      painting.markSaved(sent);
      if (this.session.value === session) this.isTyped = false; // it is taken now
      await this.loading; // which may not know of it
      await this.load();
    } catch (error) {
      this.message = error instanceof Error ? error.message : String(error);
    }
    this.saving = false;
    this.state.tell("painting");
  }
}
