/** The panel for drawing a mask: on which side and over what, with which tool, and under whose name it is saved. */

import { button, element, select } from "./dom";
import type { SavedMasks } from "./painting";
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

  constructor(private readonly state: State, private readonly source: Source) {
    this.rater.value = "me";
    const line = element("div", { class: "tools" }, "as", this.rater, this.session, button("save mask", "write a label image that napari and Fiji read", null, () => void this.save()));
    this.element.append(this.heading, this.tools, line, this.foot);
    this.element.hidden = true;
    state.on("painting", () => this.follow());
    window.addEventListener("beforeunload", (event) => {
      if (!state.painting.isSaved) event.preventDefault();
    });
  }

  private follow(): void {
    const { painting } = this.state;
    this.element.hidden = !painting.active;
    if (painting.active && !this.saved) void this.load();
    this.draw();
    window.clearTimeout(this.timer);
    if (painting.active) this.timer = window.setTimeout(() => void this.outline(), ASK_MS);
  }

  private async load(): Promise<void> {
    this.saved = await this.source.masks().catch(() => null);
    this.message = this.saved ? this.saved.refused : "Masks are saved where the page is served (endoct serve).";
    this.number();
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
      select("with what", [["brush", "brush"], ["outline", "outline"]], painting.tool, (tool) => { painting.tool = tool === "outline" ? "outline" : "brush"; painting.stroke = []; tell(); }),
      button(painting.adds ? "adds" : "erases", "add cell, or take it away (E)", !painting.adds, () => { painting.adds = !painting.adds; tell(); }),
      ...(painting.tool === "brush" ? [size, radius] : [element("small", {}, "draw around it, or click corners and press Enter")]));
    this.foot.replaceChildren(
      ...(this.message ? [element("p", { class: "refused", role: "alert" }, this.message)] : []),
      ...(this.command ? [element("details", {}, element("summary", {}, "Saved. Score against it"), element("code", {}, this.command))] : []));
  }

  /** The next session that has no mask. */
  private number(): void {
    const names = new Set(this.saved?.masks[this.state.painting.side] ?? []);
    let next = 1;
    while (names.has(`${this.rater.value}_${next}`)) next += 1;
    this.session.value = String(next);
  }

  private async save(): Promise<void> {
    const { painting } = this.state;
    const sent = painting.shapes;
    try {
      const { command } = await this.source.saveMask({ ...painting.drawing, rater: this.rater.value.trim(), session: this.session.value.trim() });
      this.command = command;
      painting.markSaved(sent);
      await this.load();
    } catch (error) {
      this.message = error instanceof Error ? error.message : String(error);
    }
    this.state.tell("painting");
  }
}
