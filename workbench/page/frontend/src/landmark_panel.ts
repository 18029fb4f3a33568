/** The list of landmark pairs: what each is for, how far apart its ends lie, and what all of them say together. */

import { button, element, redraw, select } from "./dom";
import { explain } from "./explain";
import type { Distance, Distances, Judged, Pair, Role, SessionState } from "./landmarks";
import type { Source } from "./source";
import type { State } from "./state";

const ROLES = [["correct", "corrects"], ["check", "checks"]] as const;

export class LandmarkPanel {
  readonly element = element("section", { class: "landmarks", "aria-label": "landmarks" });
  private readonly heading = element("h2");
  private readonly hint = element("p", { class: "hint", "aria-live": "polite" });
  private readonly body = element("tbody");
  private readonly command = element("details"); // one, so that it stays open
  private readonly foot = element("div", { class: "said", "aria-live": "polite" });
  private session: SessionState | null = null;
  private asked = "";
  private asking = false;
  private loading = true;
  private saving = false;
  private message = "";

  constructor(
    private readonly state: State,
    private readonly source: Source,
    private readonly chosen: (pair: Pair) => void,
  ) {
    const heads = ["", "name", "it", "now", "then", ""].map((title, k) =>
      element("th", { scope: "col", title: ["", "", "what the pair is for", "mm apart as shown", "mm apart once the pairs have corrected", ""][k] ?? "" }, title));
    this.element.append(this.heading, this.hint,
      element("div", { class: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...heads)), this.body)),
      this.foot);
    this.element.hidden = true; // until it is known what pairs there are
    state.on("landmarks", () => this.follow());
    window.addEventListener("beforeunload", (event) => {
      if (document.activeElement instanceof HTMLInputElement) document.activeElement.blur(); // what is written there counts
      if (!state.landmarks.isSaved) event.preventDefault();
    });
  }

  async load(): Promise<void> {
    this.loading = true;
    this.session = await this.source.session().catch(() => null);
    this.loading = false;
    if (this.session) {
      this.state.landmarks.load(this.session);
      this.state.landmarks.judged = this.session.judged;
      this.asked = JSON.stringify(this.session.pairs);
      this.message = this.session.refused;
    }
    this.state.tell("landmarks");
  }

  private follow(): void {
    this.draw();
    if (this.session && !this.asking) void this.ask();
  }

  /** One question at a time, always about the pairs that there are by then. */
  private async ask(): Promise<void> {
    this.asking = true;
    const { landmarks } = this.state;
    for (;;) {
      const { pairs } = landmarks;
      const wanted = JSON.stringify(pairs);
      if (this.asked === wanted) break;
      this.asked = wanted;
      const judged = await this.source.judge(pairs).catch(() => null);
      if (landmarks.pairs === pairs) landmarks.judged = judged;
      this.draw();
      if (!judged && JSON.stringify(landmarks.pairs) === wanted) {
        this.asked = ""; // the next step asks again
        break;
      }
    }
    this.asking = false;
  }

  private draw(): void {
    const { landmarks } = this.state;
    this.element.hidden = !landmarks.active && !landmarks.pairs.length;
    const tell = (): void => this.state.tell("landmarks");
    const act = (label: string, title: string, can: boolean, does: () => void): HTMLButtonElement => {
      const made = button(label, title, null, does);
      made.disabled = !can;
      return made;
    };
    this.heading.replaceChildren("Landmarks ", explain("landmark pair") ?? "", element("small", {}, landmarks.pairs.length ? `${landmarks.pairs.length}${landmarks.isSaved ? "" : ", not saved"}` : ""),
      element("span", { class: "actions" },
        act("undo", "take back the last step (Ctrl+Z)", landmarks.canUndo, () => { landmarks.undo(); tell(); }),
        act("redo", "make it again (Ctrl+Shift+Z)", landmarks.canRedo, () => { landmarks.redo(); tell(); }),
        this.saveButton()));
    this.hint.textContent = this.hintText();
    this.hint.hidden = !landmarks.active;
    redraw(this.body, () => this.body.replaceChildren(...landmarks.pairs.map((pair, k) => this.row(pair, k))));
    this.foot.replaceChildren(...this.said());
  }

  saveButton(): HTMLButtonElement {
    const made = button("save session", this.source.canSave ? `write ${this.session?.file ?? "the session file"}` : "download the session file", null, () => void this.save());
    // one that could not be read is asked for again where there is a server
    const can = this.session ? this.session.refused === "" : this.source.canSave && this.state.description.sides.length > 1;
    made.disabled = !can || this.loading || this.saving;
    return made;
  }

  /** Why nothing was saved, or cannot be. */
  refused(): HTMLElement[] {
    return this.message ? [element("p", { class: "refused", role: "alert" }, this.message)] : [];
  }

  private hintText(): string {
    const { landmarks, description } = this.state;
    const [a, b] = description.sides;
    if (landmarks.pending) {
      return `Now click on the same place in a pane of ${landmarks.pending.side === a ? b : a}. Escape forgets the first.`;
    }
    return `Click on a place in a pane of ${a}, and on the same place in one of ${b}. By keys: C, arrow keys, Enter.`;
  }

  private row(pair: Pair, k: number): HTMLTableRowElement {
    const { landmarks } = this.state;
    const tell = (): void => this.state.tell("landmarks");
    const name = element("input", { "aria-label": `name of pair ${k + 1}`, maxlength: "100", "data-at": `name-${k}` });
    name.value = pair.name;
    name.addEventListener("change", () => {
      const at = landmarks.pairs.findIndex((one) => JSON.stringify(one) === JSON.stringify(pair)); // pairs of another window may have come before it
      if (at >= 0) landmarks.replace(at, { name: name.value });
      tell();
    });
    const role = select(`what pair ${k + 1} is for`, ROLES, pair.role, (value) => { landmarks.replace(k, { role: value as Role }); tell(); });
    role.dataset["at"] = `role-${k}`;
    const { judged } = landmarks;
    const then = judged?.by_hand?.corrected ? judged.by_hand.pairs[k]?.after : null;
    const go = button(String(k + 1), "go there", null, () => this.chosen(pair));
    go.className = `disc ${pair.role}`;
    return element("tr", {},
      element("td", {}, go), element("td", {}, name), element("td", {}, role),
      distanceCell(judged?.present.each[k] ?? null), distanceCell(then ?? null),
      element("td", {}, button("×", `delete pair ${k + 1}`, null, () => { landmarks.remove(k); tell(); })));
  }

  private said(): HTMLElement[] {
    const { landmarks } = this.state;
    const { judged } = landmarks;
    const parts: HTMLElement[] = [];
    if (landmarks.pairs.length && judged) {
      const corrected = judged.by_hand?.corrected ?? false;
      parts.push(element("p", { class: "error" }, element("b", {}, "Error now: "), errorText(judged.present.check)));
      if (corrected) parts.push(element("p", { class: "error" }, element("b", {}, "Then: "), errorText(judged.by_hand?.check ?? null), movedText(judged, this.state.description.sides[1] ?? "")));
    } else if (landmarks.pairs.length) {
      parts.push(element("p", {}, "Distances are computed where the page is served (endoct serve)."));
    }
    for (const text of judged?.said ?? []) parts.push(element("p", { class: "soft" }, text));
    if (judged?.error) parts.push(element("p", { class: "refused", role: "alert" }, judged.error));
    parts.push(...this.refused());
    if (landmarks.pairs.length && this.session?.command) {
      const first = landmarks.isSaved ? [] : [element("p", {}, "Save the session first.")];
      if (!this.source.canSave) first.push(element("p", {}, "In the folder of the comparison, with the session in it:"));
      this.command.replaceChildren(element("summary", {}, "Compare with these landmarks"), ...first, element("code", {}, this.session.command));
      parts.push(this.command);
    }
    return parts;
  }

  private async save(): Promise<void> {
    if (this.loading || this.saving) return;
    this.saving = true;
    if (!this.session) await this.load();
    if (!this.session) this.message = "The session cannot be read; nothing was saved. Try again.";
    else if (!this.session.refused) await this.write(this.session);
    this.saving = false;
    this.state.tell("landmarks");
  }

  private async write(session: SessionState): Promise<void> {
    const { placed } = this.state.landmarks;
    try {
      session.saved = await this.source.saveSession(session, placed);
      this.state.landmarks.markSaved(placed);
      this.message = "";
    } catch (error) {
      this.message = error instanceof Error ? error.message : String(error);
      await this.takeIn();
    }
  }

  /** Where another window has saved meanwhile, bring that together with what is here. */
  private async takeIn(): Promise<void> {
    const now = await this.source.session().catch(() => null);
    if (!now || now.refused || now.saved === this.session?.saved) return;
    this.session = now;
    this.state.landmarks.load(now);
    this.message = "Another window saved meanwhile. What it saved is now here too: look, and save again.";
  }
}

function distanceCell(distance: Distance | null): HTMLTableCellElement {
  if (!distance) return element("td", {}, "–");
  const title = `${signed(distance.around_mm)} mm around, ${signed(distance.along_mm)} mm along the bore`;
  return element("td", { title }, distance.distance_mm.toFixed(3));
}

function errorText(check: Distances | null): string {
  if (!check) return "not known, no pair checks.";
  const by = `by ${check.pairs} pair${check.pairs === 1 ? "" : "s"}`;
  const most = check.pairs === 1 ? "" : ` (median), ${check.max_mm.toFixed(3)} mm at most`;
  return `${check.median_mm.toFixed(3)} mm${most}, ${by}; ${check.around_median_mm.toFixed(3)} mm around, ${check.along_median_mm.toFixed(3)} mm along.`;
}

function movedText(judged: Judged, side: string): string {
  const moved = judged.by_hand?.moved;
  return moved ? ` The pairs that correct move ${side} by ${Math.hypot(moved.around_mm, moved.along_mm).toFixed(3)} mm.` : "";
}

function signed(value: number): string {
  return `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(3)}`;
}
