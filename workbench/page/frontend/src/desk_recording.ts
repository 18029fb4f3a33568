/** A recording's sidecar as a form, and a frame drawn at once as the form has it. */

import { ask, message, named, post, type Preview, type Sidecar, type SidecarField } from "./desk_server";
import { button, element, select } from "./dom";
import { explain } from "./explain";
import { CurveStyles, drawPicture } from "./frame_picture";
import type { FramePicture } from "./source";
import { travelFigure } from "./travel";

const WAIT_MS = 300;
const SLOW_MS = 1500;
/** Keys that nobody has to state, and that decide how the bore lies. */
const ORIENTING: readonly string[] = ["travel", "handedness"];
const SLOW = "Drawing… The first recording of its kind takes longer: slow parts are compiled once.";

export async function showRecording(main: HTMLElement): Promise<void> {
  await new RecordingPage(main).start();
}

class RecordingPage {
  private readonly name: string;
  private readonly form = element("form", { class: "sidecar" });
  private readonly pictures = element("div", { class: "pictures" });
  private readonly said = element("p", { role: "status" });
  private readonly travel = element("div");
  private readonly fault = element("p", { class: "fault", role: "alert" });
  private readonly place = element("input", { type: "range", min: "0", max: "1", step: "0.005", value: "0.5", "aria-label": "which frame" });
  private readonly frame = element("span", { class: "frame" });
  private readonly save = element("button", { type: "submit", class: "chief" }, "Save");
  private readonly controls = new Map<string, HTMLInputElement | HTMLSelectElement>();
  private readonly styles = new CurveStyles();
  private instrument: HTMLSelectElement | null = null;
  private sidecar: Sidecar | null = null;
  private drawn: { canvas: HTMLCanvasElement; image: HTMLImageElement; picture: FramePicture }[] = [];
  private busy = false;
  private again = false;
  private timer = 0;

  constructor(private readonly main: HTMLElement) {
    this.name = main.dataset["recording"] ?? "";
    this.form.addEventListener("input", () => this.later());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.store();
    });
    this.place.addEventListener("input", () => this.later());
    new ResizeObserver(() => this.draw()).observe(this.pictures);
  }

  async start(): Promise<void> {
    this.main.append(element("div", { class: "columns recording" },
      element("section", { class: "card" }, element("h2", {}, "A frame, as the sidecar has it"),
        element("div", { class: "line" }, this.place, this.frame), this.said, this.travel, this.pictures),
      element("section", { class: "card" }, element("h2", {}, "Sidecar", explain("sidecar")), this.fault, this.form)));
    await this.load(null);
  }

  /** Let nothing be entered until it is answered: it would be lost with the form that the answer replaces. */
  private async held(asked: () => Promise<void>): Promise<void> {
    const focused = document.activeElement;
    this.form.inert = true;
    try {
      await asked();
    } catch (error) {
      this.fault.textContent = message(error);
    } finally {
      this.form.inert = false;
    }
    if (focused instanceof HTMLElement && this.form.contains(focused)) focused.focus(); // which what is inert cannot have
  }

  private load(modality: string | null): Promise<void> {
    return this.held(() => this.loaded(modality));
  }

  private async loaded(modality: string | null): Promise<void> {
    try {
      const asked = named("sidecar.json", this.name) + (modality ? `&modality=${encodeURIComponent(modality)}` : "");
      this.sidecar = await ask<Sidecar>(asked);
      this.fault.textContent = "";
      this.fill(this.sidecar);
      this.later();
    } catch (error) {
      this.fault.textContent = message(error);
      if (!this.sidecar) this.form.replaceChildren(this.kinds(""));
      else if (this.instrument) this.instrument.value = this.sidecar.modality;
    }
  }

  /** Which kind of recording it is, where the guess is wrong. */
  private kinds(chosen: string): HTMLElement {
    const kinds = (this.main.dataset["modalities"] ?? "").split(" ");
    const list = select("which instrument recorded it", kinds.map((kind) => [kind, kind] as const), chosen, (kind) => void this.load(kind));
    this.instrument = list;
    list.addEventListener("input", (event) => event.stopPropagation()); // a frame drawn of the former one would hide why it is refused
    return element("div", { class: "field" }, element("label", {}, "instrument", element("small", {}, "what recorded it")), list);
  }

  private fill(sidecar: Sidecar): void {
    this.controls.clear();
    // of keys of which one will do, all are offered until one is there
    const isOpen = (why: string): boolean => why !== "" && Object.keys(sidecar.missing).some((key) => key.startsWith("one of") && sidecar.missing[key] === why);
    const rank = (field: SidecarField): number => (field.value ? 2 : field.required ? 0 : isOpen(field.one_of) ? 1 : ORIENTING.includes(field.key) ? 2 : 3);
    const chief = sidecar.fields.filter((field) => rank(field) < 3).sort((a, b) => rank(a) - rank(b));
    const others = sidecar.fields.filter((field) => rank(field) === 3);
    this.form.replaceChildren(
      this.kinds(sidecar.modality), ...chief.map((field) => this.row(field)),
      element("details", {}, element("summary", {}, `${others.length} more that may be known`), ...others.map((field) => this.row(field))),
      element("div", { class: "line buttons" }, this.save, button("Undo", "back to what is saved", null, () => void this.load(null)),
        element("small", {}, sidecar.sidecar)));
  }

  private row(field: SidecarField): HTMLElement {
    const usual = field.cited || field.stated || field.default;
    const from = field.cited ? " (from the calibration)" : field.stated ? ` (stated by ${this.sidecar?.stated_by || "the files"})` : usual && field.kind === "choice" ? " (taken where nothing is said)" : "";
    let control: HTMLInputElement | HTMLSelectElement;
    if (field.kind === "choice") {
      control = element("select", {}, element("option", { value: "" }, usual ? (from.endsWith("said)") ? `not stated: ${usual} is taken` : `not stated here: ${usual} is taken${from}`) : ""), ...field.choices.map((choice) => element("option", { value: choice }, choice)));
    } else {
      control = element("input", { type: "text", spellcheck: "false", placeholder: usual + from });
      if (field.kind === "number") control.inputMode = "decimal";
    }
    control.value = field.value;
    control.id = `key-${field.key}`;
    this.controls.set(field.key, control);
    const range = field.low !== null && field.high !== null ? `, ${field.low} to ${field.high}` : "";
    const unit = field.unit ? ` (${field.unit}${field.kind === "number" ? range : ""})` : "";
    const about = field.one_of ? `${field.about}; one way to give ${field.one_of}` : field.about;
    return element("div", { class: `field ${field.required ? "required" : ""}`, "data-key": field.key },
      element("label", { for: control.id }, element("code", {}, field.key), unit, element("small", {}, about)), control);
  }

  /** What the form has changed; an empty text takes a key out. */
  private texts(): Record<string, string> {
    const texts: Record<string, string> = {};
    for (const field of this.sidecar?.fields ?? []) {
      const value = this.controls.get(field.key)?.value.trim() ?? "";
      if (value !== field.value) texts[field.key] = value;
    }
    return texts;
  }

  private drawTravel(): void {
    const field = this.sidecar?.fields.find((each) => each.key === "travel");
    const chosen = this.controls.get("travel")?.value;
    const taken = field ? field.cited || field.stated || field.default : "";
    const by = chosen || !taken ? "" : field?.cited || field?.stated ? "(as the files say)" : "(taken where nothing is said)";
    this.travel.replaceChildren(...(field ? [travelFigure(chosen || taken || "not stated", by, Number(this.place.value))] : []));
  }

  private later(): void {
    this.drawTravel();
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.preview(), WAIT_MS);
  }

  /** Have a frame drawn; what is changed meanwhile is drawn after it. */
  private async preview(): Promise<void> {
    if (this.busy || !this.sidecar) {
      this.again = this.busy;
      return;
    }
    this.busy = true;
    this.main.setAttribute("aria-busy", "true");
    const slow = window.setTimeout(() => (this.said.textContent = SLOW), SLOW_MS);
    try {
      const asked = post<Preview>("preview", { name: this.name, modality: this.sidecar.modality, texts: this.texts(), share: Number(this.place.value) });
      const drawn = await asked.finally(() => window.clearTimeout(slow)); // or it would speak after what is said below
      this.fault.textContent = drawn.fault;
      await this.show(drawn);
    } catch (error) {
      this.said.textContent = "";
      this.fault.textContent = message(error);
    }
    this.busy = false;
    this.main.setAttribute("aria-busy", "false");
    if (this.again) {
      this.again = false;
      void this.preview();
    }
  }

  private async show(drawn: Preview): Promise<void> {
    const missing = Object.keys(drawn.missing);
    this.said.textContent = missing.length ? `Still needed: ${missing.join("; ")}.` : drawn.fault ? "This sidecar does not fit the recording." : `Nothing is missing. ${Object.keys(this.texts()).length ? "Not saved yet." : "It is saved."}`;
    for (const row of this.form.querySelectorAll<HTMLElement>("[data-key]")) row.classList.toggle("lacking", missing.includes(row.dataset["key"] ?? ""));
    this.frame.textContent = drawn.frames ? `frame ${drawn.frame + 1} of ${drawn.frames}` : "";
    const made = [];
    for (const picture of drawn.pictures) {
      const image = new Image();
      image.src = picture.image;
      await image.decode();
      made.push({ canvas: element("canvas"), image, picture });
    }
    this.drawn = made;
    this.pictures.replaceChildren(...made.map(({ canvas, picture }) => {
      const legends = Object.keys(picture.curves).map((label) => {
        const legend = element("span", { class: "legend" }, label);
        legend.style.setProperty("--line-colour", this.styles.of(label).colour);
        return legend;
      });
      return element("figure", {}, canvas, element("figcaption", {}, element("b", {}, picture.title), ...legends));
    }));
    this.draw();
  }

  private draw(): void {
    for (const { canvas, image, picture } of this.drawn) drawPicture(canvas, image, picture, this.styles, null);
  }

  private async store(): Promise<void> {
    const { name, sidecar } = this;
    if (!sidecar) return;
    await this.held(async () => {
      await post("sidecar", { name, modality: sidecar.modality, texts: this.texts(), based_on: sidecar.digest });
      await this.loaded(null);
    });
  }
}
