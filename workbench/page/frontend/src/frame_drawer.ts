/** Under the panes: the B-scan and the frame at the marked place, from either side. */

import type { FramesPart } from "./description";
import { button, element } from "./dom";
import { CurveStyles, drawPicture } from "./frame_picture";
import { toOwn } from "./placement";
import type { FramePicture, Reading, Source } from "./source";
import type { State } from "./state";

const ASK_AGAIN_MS = 700;
const FAR_MM = 0.005;

interface Drawn {
  picture: FramePicture;
  image: HTMLImageElement;
  canvas: HTMLCanvasElement;
  frames: FramesPart;
  place: number;
}

export class FrameDrawer {
  readonly element = element("section", { class: "drawer", "aria-label": "frames at the marked place" });
  private readonly said = element("span", { class: "said", "aria-live": "polite" });
  private readonly body = element("div", { class: "pictures" });
  private readonly actions = element("span");
  private readonly styles = new Map<string, CurveStyles>();
  private readonly readings = new Map<string, Reading>();
  private drawn: Drawn[] = [];
  private shown = "";

  constructor(
    private readonly state: State,
    private readonly source: Source,
    private readonly go: (z_mm: number) => void,
  ) {
    const step = (by: number): void => this.step(by);
    this.element.hidden = true;
    this.element.append(
      element("header", {}, element("h2", {}, "At the marked place"), this.said, this.actions,
        button("▲", "the frame before", null, () => step(-1)), button("▼", "the frame after", null, () => step(1)),
        button("larger", "pictures instead of panes", false, () => this.enlarge()),
        button("×", "close", null, () => this.close())),
      this.body,
    );
    state.on("cursor", () => void this.follow());
    new ResizeObserver(() => this.draw()).observe(this.body);
  }

  /** The frame of a side nearest to the marked place, of which there are pictures. */
  private nearest(frames: FramesPart, z_mm: number): number | null {
    const every = this.readings.get(frames.side)?.state === "read";
    const places = every ? frames.z_mm.map((_, k) => k) : frames.pictured;
    const apart = (k: number): number => Math.abs((frames.z_mm[k] ?? Infinity) - z_mm);
    return places.reduce<number | null>((best, k) => (best !== null && apart(best) <= apart(k) ? best : k), null);
  }

  private async follow(): Promise<void> {
    const { pinned } = this.state;
    const frames = this.state.description.frames.filter((one) => this.state.isCommon(pinned?.side ?? null, one.side));
    if (!pinned || !frames.some((one) => one.pictured.length || one.recording)) {
      this.element.hidden = true;
      this.shown = "";
      return;
    }
    this.element.hidden = false;
    const places = frames.map((one) => [one, this.nearest(one, pinned.z_mm)] as const);
    this.say(places, pinned.z_mm);
    for (const [one, place] of places) {
      const apart = (z_mm: number | undefined): number => Math.abs((z_mm ?? Infinity) - pinned.z_mm);
      const isFar = place === null || apart(one.z_mm[place]) > spacing(one.z_mm) + Math.min(...one.z_mm.map(apart));
      if (isFar && one.recording && !this.readings.has(one.side)) void this.read(one); // it lies there: show what is asked for
    }
    const wanted = places.map(([one, place]) => `${one.side} ${place}`).join();
    if (wanted === this.shown) {
      this.draw();
      return;
    }
    this.shown = wanted;
    const found: Drawn[] = [];
    let isWhole = true;
    for (const [one, place] of places) {
      if (place === null) continue;
      const pictures = await this.source.pictures(one.side, place).catch(() => undefined);
      if (pictures === undefined) isWhole = false;
      for (const picture of pictures ?? []) {
        const image = await decoded(picture.image);
        if (image) found.push({ picture, image, canvas: element("canvas"), frames: one, place });
        else isWhole = false;
      }
    }
    if (this.shown !== wanted) return; // the place was moved on meanwhile
    this.drawn = found;
    this.body.replaceChildren(...found.map((one) => this.figure(one)));
    this.draw();
    if (!isWhole) this.shown = ""; // the next step asks again
  }

  private stylesOf(side: string): CurveStyles {
    const found = this.styles.get(side) ?? new CurveStyles();
    this.styles.set(side, found);
    return found;
  }

  private figure({ picture, canvas, frames, place }: Drawn): HTMLElement {
    const legends = Object.keys(picture.curves).map((label) => {
      const { colour, dash } = this.stylesOf(frames.side).of(label);
      const made = element("span", { class: dash.length ? "legend dashed" : "legend" }, label);
      made.style.setProperty("--line-colour", colour);
      return made;
    });
    const unmarked = picture.axis === null && !picture.seen && Object.keys(picture.curves).length ? [element("span", {}, "place not marked: its beam is not known here")] : [];
    const title = `${frames.side} ${placeText(frames, place)}: ${picture.title}`;
    const caption = element("figcaption", { title: picture.about }, element("b", {}, title), element("em", { class: "away" }), ...legends, ...unmarked);
    return element("figure", {}, canvas, caption);
  }

  /** Say under each picture how far from the marked place its frame lies, where it is another's. */
  private sayAway(): void {
    const { pinned } = this.state;
    for (const { canvas, frames, place } of this.drawn) {
      const label = canvas.parentElement?.querySelector(".away");
      const away_mm = (frames.z_mm[place] ?? 0) - (pinned?.z_mm ?? 0);
      if (label) label.textContent = Math.abs(away_mm) > spacing(frames.z_mm) ? `not the marked place: ${awayText(away_mm)}` : "";
    }
  }

  private say(places: readonly (readonly [FramesPart, number | null])[], z_mm: number): void {
    const texts = places.map(([one, place]) => {
      if (place === null) return `${one.side}: no picture kept`;
      return `${one.side}: ${one.frame_dim} ${place} of 0–${one.z_mm.length - 1}, ${awayText((one.z_mm[place] ?? 0) - z_mm)}`;
    });
    const readings = places.flatMap(([one]) => {
      const reading = this.readings.get(one.side);
      if (reading?.state === "reading") return [`reading ${one.side} ${Math.round(100 * reading.share)} %`];
      return reading?.state === "failed" ? [`${one.side}: ${reading.said}`] : [];
    });
    this.said.textContent = [...texts, ...readings].join("; ");
    this.actions.replaceChildren(
      ...places.filter(([one]) => one.recording && ["none", "failed"].includes(this.readings.get(one.side)?.state ?? "none")).map(([one]) =>
        button(`every ${one.frame_dim} of ${one.side}`, `read ${one.recording} again, for pictures of every ${one.frame_dim}`, null, () => void this.read(one))),
    );
  }

  private async read(frames: FramesPart): Promise<void> {
    if (this.readings.get(frames.side)?.state === "reading") return;
    this.readings.set(frames.side, { state: "reading", share: 0, said: "" }); // at once: whoever points elsewhere meanwhile begins no other
    let reading = await this.source.reading(frames.side, true);
    for (;;) {
      this.readings.set(frames.side, reading);
      await this.follow();
      if (reading.state !== "reading") return;
      await new Promise((done) => setTimeout(done, ASK_AGAIN_MS));
      reading = await this.source.reading(frames.side, false);
    }
  }

  private step(by: number): void {
    const { pinned } = this.state;
    const frames = this.state.description.frames.find((one) => one.pictured.length || one.recording);
    if (!pinned || !frames) return;
    const every = this.readings.get(frames.side)?.state === "read";
    const all = (every ? frames.z_mm : frames.pictured.map((k) => frames.z_mm[k] ?? 0)).slice().sort((a, b) => a - b);
    const now = frames.z_mm[this.nearest(frames, pinned.z_mm) ?? 0] ?? 0;
    const next = all[Math.min(Math.max(all.indexOf(now) + by, 0), all.length - 1)];
    if (next !== undefined) this.go(next);
  }

  private enlarge(): void {
    const large = this.element.classList.toggle("large");
    this.element.querySelector("[aria-pressed]")?.setAttribute("aria-pressed", String(large));
  }

  private close(): void {
    this.element.classList.remove("large");
    this.state.pinned = null;
    this.state.tell("cursor");
  }

  private draw(): void {
    const { pinned } = this.state;
    this.sayAway();
    for (const { canvas, image, picture, frames, place } of this.drawn) {
      // a frame that lies elsewhere does not show the place; one that shows many rows says itself which
      const near = pinned !== null && Math.abs((frames.z_mm[place] ?? Infinity) - pinned.z_mm) <= spacing(frames.z_mm);
      const isThere = near || (picture.seen?.z_mm.length ?? 0) > 1;
      const marked = pinned && isThere && toOwn(frames.placement, pinned);
      drawPicture(canvas, image, picture, this.stylesOf(frames.side), marked || null);
    }
  }
}

/** An image that can be drawn; null where it is none. */
async function decoded(address: string): Promise<HTMLImageElement | null> {
  const image = new Image();
  image.src = address;
  return image.decode().then(() => image, () => null);
}

/** "frame 20, z = 4.04 mm": counted from 0 in the order of z, as in the report; z on the wall that panes show. */
function placeText(frames: FramesPart, place: number): string {
  return `${frames.frame_dim} ${place}, z = ${(frames.z_mm[place] ?? 0).toFixed(2).replace("-", "−")} mm`;
}

function awayText(away_mm: number): string {
  if (Math.abs(away_mm) < FAR_MM) return "here";
  return `${Math.abs(away_mm).toFixed(2)} mm ${away_mm > 0 ? "farther in" : "farther out"}`;
}

/** How far frames lie apart, typically. */
function spacing(z_mm: readonly number[]): number {
  const sorted = [...z_mm].sort((a, b) => a - b);
  const apart = sorted.slice(1).map((one, k) => one - (sorted[k] ?? one)).sort((a, b) => a - b);
  return apart[Math.floor(apart.length / 2)] ?? 0;
}
