/** The list of notes on places, and where one is written. */

import { csvOf } from "./cell_words";
import { button, download, element, redraw } from "./dom";
import { RING_PX, spotOf } from "./landmark_marks";
import type { LandmarkPanel } from "./landmark_panel";
import type { Note } from "./landmarks";
import { toOwn } from "./placement";
import type { State } from "./state";
import { type Spot, degrees, wrapped } from "./wall";

/** So near a note a click is on it. */
const NEAR_PX = 2 * RING_PX;

export class NotePanel {
  readonly element = element("section", { class: "notes", "aria-label": "notes on places" });
  private readonly heading = element("h2");
  private readonly body = element("tbody");
  private readonly fresh = this.field("the new note", "", (text) => this.add(text));
  private readonly hint = element("p", { class: "hint" }, "Click a place, and write. By keys: C, arrow keys, Enter.");
  private readonly foot = element("div", { class: "said", "aria-live": "polite" });
  /** What had the focus before a note was written. */
  private from: Element | null = null;

  constructor(
    private readonly state: State,
    private readonly session: LandmarkPanel,
    private readonly chosen: (spot: Spot) => void,
  ) {
    this.fresh.placeholder = "what is there?";
    this.element.append(this.heading, this.hint, this.fresh, element("div", { class: "scroll" }, element("table", {}, this.body)), this.foot);
    state.on("landmarks", () => this.draw());
    this.draw();
  }

  /** Write a note at a place of the wall of `side` (null: of both), or change the one that is there. */
  begin(place: Spot, side: string | null, mm_per_px: number): void {
    const { landmarks, description } = this.state;
    const [a, b] = description.frames;
    const frames = b?.side === side ? b : a;
    if (!frames) return;
    this.add(clean(this.fresh.value));
    if (!this.element.contains(document.activeElement)) this.from = document.activeElement;
    const near = landmarks.notes.findIndex((note) => {
      const spot = spotOf(this.state, note);
      if (!spot || !this.state.isCommon(spot.side, side)) return false;
      const around_mm = (wrapped(spot.theta_rad - place.theta_rad + Math.PI) - Math.PI) * description.wall.radius_mm;
      return Math.hypot(around_mm, spot.z_mm - place.z_mm) < NEAR_PX * mm_per_px;
    });
    if (near < 0) landmarks.draft = { side: frames === b ? "b" : "a", place: toOwn(frames.placement, place), text: "" };
    this.state.tell("landmarks");
    (near < 0 ? this.fresh : this.body.querySelectorAll("input")[near])?.focus();
  }

  private add(text: string): void {
    const { landmarks } = this.state;
    const { draft } = landmarks;
    if (!draft) return;
    [landmarks.draft, this.fresh.value] = [null, ""];
    landmarks.rewrite(draft, text);
    this.state.tell("landmarks");
  }

  /** Where a text is written: Enter takes it, Escape does not, and both go back to where the place was pointed at. */
  private field(label: string, text: string, take: (text: string) => void): HTMLInputElement {
    const made = element("input", { "aria-label": label, maxlength: "200" });
    made.value = text;
    made.addEventListener("change", () => take(clean(made.value)));
    made.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== "Escape") return;
      if (event.key === "Escape") made.value = text;
      made.blur(); // which takes what was changed
      if (made === this.fresh) this.add(clean(made.value));
      if (this.from instanceof HTMLElement) this.from.focus();
    });
    return made;
  }

  private draw(): void {
    const { landmarks } = this.state;
    const { notes, noting } = landmarks;
    if (!noting) landmarks.draft = null;
    this.element.hidden = !noting && !notes.length;
    this.hint.hidden = !noting || landmarks.draft !== null;
    this.fresh.hidden = landmarks.draft === null;
    const csv = button("CSV", "save the notes, with the places as they are shown", null, () => this.save());
    csv.disabled = !notes.length;
    this.heading.replaceChildren("Notes on places ", element("small", {}, notes.length ? `${notes.length}${landmarks.isSaved ? "" : ", not saved"}` : ""),
      element("span", { class: "actions" }, csv, this.session.saveButton()));
    redraw(this.body, () => this.body.replaceChildren(...landmarks.notes.map((note, k) => this.row(note, k))));
    this.foot.replaceChildren(...this.session.element.hidden ? this.session.refused() : []);
  }

  private row(note: Note, k: number): HTMLTableRowElement {
    const spot = spotOf(this.state, note);
    const rewrite = (text: string): void => {
      if (text === note.text) return;
      this.state.landmarks.rewrite(note, text);
      this.state.tell("landmarks");
    };
    const text = this.field(`note ${k + 1}`, note.text, rewrite);
    const away = button("×", `delete note ${k + 1}`, null, () => rewrite(""));
    [text.dataset["at"], away.dataset["at"]] = [`text-${k}`, `away-${k}`];
    return element("tr", {},
      element("td", {}, button(String(k + 1), "go there", null, () => spot && this.chosen(spot))), element("td", {}, text),
      element("td", { title: spot ? `θ and z in mm, noted on ${spot.side}` : "" }, spot ? `${degrees(spot.theta_rad).toFixed(1)}° ${spot.z_mm.toFixed(2)}` : "–"),
      element("td", {}, away));
  }

  private save(): void {
    const rows = this.state.landmarks.notes.map((note) => {
      const spot = spotOf(this.state, note);
      return [spot?.side ?? note.side, spot?.z_mm ?? null, spot?.theta_rad ?? null, note.text];
    });
    download(new Blob([csvOf(["side", "z_mm", "theta_rad", "note"], rows)], { type: "text/csv" }), "notes.csv");
  }
}

/** One line, without what cannot be seen. */
function clean(text: string): string {
  return text.replace(/[\p{C}\p{Z}]+/gu, " ").trim();
}
