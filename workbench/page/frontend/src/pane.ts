/** A pane: one layer of the wall, or two of them brought together, with marks over and a colour bar under them. */

import { AXES_PX, drawAxes } from "./axes";
import { colourBar } from "./colour_bar";
import type { Filters } from "./colouring";
import type { Painter } from "./painter";
import { button, context, element, select } from "./dom";
import { type Paths, drawMarks } from "./marks";
import { type Sheet, paperOf } from "./sheet";
import type { Source } from "./source";
import { MODES, type Mode, type PaneState, type State } from "./state";
import { type Subject, paneSubject } from "./subject";
import { LENS_PX, secondOpacity, squares } from "./together";
import { LayerViewer } from "./viewer";
import { type Spot, type View, type Wall, degrees } from "./wall";

/** What is cut off by less is no news. */
const SEEN_MM = 0.1;

export interface PaneEvents {
  readonly painter: Painter;
  moved(pane: Pane, view: View): void;
  pointed(place: Spot | null): void;
  clicked(place: Spot, side: string | null): void;
  closed(pane: Pane): void;
}

export class Pane {
  readonly element = element("section", { class: "pane" });
  private readonly view_ = element("div", { class: "view", tabindex: "-1" }); // focused while keys move its cursor
  private readonly marks = element("canvas", { class: "marks", "aria-hidden": "true" });
  private readonly axes = element("canvas", { class: "axes", "aria-hidden": "true" });
  private readonly handle = element("div", { class: "handle" });
  private readonly beyond = element("div", { class: "beyond" });
  private readonly head = element("header");
  private readonly foot = element("footer");
  private readonly under: LayerViewer;
  private over: LayerViewer | null = null;
  private size = "";
  private last: View | null = null;
  private pointer = { x: 0, y: 0 };
  private drawing = 0;
  private readonly resized: ResizeObserver;

  constructor(
    parent: HTMLElement,
    readonly shown: PaneState,
    private readonly state: State,
    private readonly source: Source,
    private readonly wall: Wall,
    private readonly filters: Filters,
    private readonly paths: () => Paths,
    private readonly events: PaneEvents,
  ) {
    const below = element("div", { class: "layer" });
    this.view_.append(below, this.handle, this.marks, this.beyond);
    const plot = element("div", { class: "plot" }, this.axes, this.view_);
    plot.style.padding = `${AXES_PX.top}px 0 0 ${AXES_PX.left}px`;
    this.element.append(this.head, plot, this.foot);
    parent.append(this.element); // a viewer must know how large it is from the start
    this.under = new LayerViewer(below, source, wall);
    this.under.viewer.addHandler("viewport-change", () => this.follow());
    this.under.viewer.addHandler("canvas-click", (event) => {
      if (event.quick && !this.events.painter.draws(this.sideAt(event.position.x))) this.clickAt(event.position.x, event.position.y);
    });
    this.letDraw();
    this.view_.addEventListener("pointermove", (event) => this.point(event));
    this.view_.addEventListener("pointerleave", () => this.events.pointed(null));
    this.handle.addEventListener("pointerdown", (event) => this.handle.setPointerCapture(event.pointerId));
    this.handle.addEventListener("pointermove", (event) => this.drag(event));
    this.resized = new ResizeObserver(() => this.redraw());
    this.resized.observe(this.view_);
  }

  /** Have the pointer draw while a mask of this pane's side is drawn, instead of moving the view. */
  private letDraw(): void {
    const { painter } = this.events;
    const { viewer } = this.under;
    let [moved, draws] = [false, false];
    viewer.addHandler("canvas-press", (event) => {
      moved = false;
      draws = painter.draws(this.sideAt(event.position.x)); // of two layers, the one under the pointer
      if (draws) painter.press(this.placeAt(event.position.x, event.position.y));
    });
    viewer.addHandler("canvas-drag", (event) => {
      if (!draws) return;
      event.preventDefaultAction = true;
      moved = true;
      painter.drag(this.placeAt(event.position.x, event.position.y), this.view().mm_per_px);
    });
    viewer.addHandler("canvas-drag-end", (event) => {
      if (draws) (event as { preventDefaultAction?: boolean }).preventDefaultAction = true; // nor flick it on
    });
    viewer.addHandler("canvas-release", () => {
      if (draws) painter.release(moved);
    });
  }

  /** Show what the state says, after any of it changed. */
  refresh(): void {
    this.buildHead();
    this.foot.replaceChildren(...this.layers().map((key) => colourBar(this.state, key)));
    this.under.show(this.shown.layer);
    const two = this.shown.mode !== "single";
    if (two && !this.over) {
      const above = element("div", { class: "layer over" });
      this.handle.before(above);
      this.over = new LayerViewer(above, this.source, this.wall);
      this.over.viewer.setMouseNavEnabled(false);
    } else if (!two && this.over) {
      this.over.destroy();
      this.over.element.remove();
      this.over = null;
    }
    this.over?.show(this.shown.second);
    this.recolour();
    this.follow();
  }

  recolour(): void {
    this.under.element.style.filter = this.filters.css(this.state.layer(this.shown.layer));
    if (this.over) this.over.element.style.filter = this.filters.css(this.state.layer(this.shown.second));
    this.redraw();
  }

  /** The side that this pane shows, null where it is both. */
  get side(): string | null {
    return this.state.layer(this.shown.layer).side;
  }

  /** The side whose layer lies at `x`: beyond a swipe the second one's, else the first one's. */
  private sideAt(x: number): string | null {
    const beyond = this.shown.mode === "swipe" && x > this.shown.share * this.view_.clientWidth;
    return this.state.layer(beyond ? this.shown.second : this.shown.layer).side;
  }

  view(): View {
    return this.under.view();
  }

  setView(view: View, immediately = true): void {
    this.under.setView(view, immediately);
    if (immediately) this.follow();
  }

  /** mm per pixel at which the whole wall is in view, or its whole circle, whichever leaves more to see. */
  home(): View {
    const { clientWidth, clientHeight } = this.view_;
    const length = this.wall.length_mm;
    const whole = Math.max(this.wall.circumference_mm / clientWidth, (1.04 * length) / Math.max(clientHeight, 1));
    const least = this.wall.circumference_mm / Math.min(150, clientWidth);
    const mm_per_px = Math.min(whole, least);
    const top = this.wall.part.top_mm + Math.min(length / 2, (clientHeight / 2 - 14) * mm_per_px);
    return { theta_rad: Math.PI, z_mm: mm_per_px === whole ? this.wall.part.top_mm + length / 2 : top, mm_per_px };
  }

  redraw(): void {
    if (this.drawing) return;
    this.drawing = requestAnimationFrame(() => {
      this.drawing = 0;
      this.draw();
    });
  }

  get width(): number {
    return this.view_.clientWidth;
  }

  get height(): number {
    return this.view_.clientHeight;
  }

  get isFocused(): boolean {
    return document.activeElement === this.view_;
  }

  focus(): void {
    this.view_.focus({ preventScroll: true });
  }

  /** The cursor is at a pixel of the view. */
  pointAt(x: number, y: number): void {
    this.pointer = { x, y };
    this.events.pointed(this.placeAt(x, y));
    if (this.shown.mode === "lens") this.bringTogether();
  }

  clickAt(x: number, y: number): void {
    this.events.clicked(this.placeAt(x, y), this.sideAt(x));
  }

  /** The cursor is not in this pane any more. */
  leave(): void {
    this.view_.blur();
    this.events.pointed(null);
  }

  /** What it shows now, for a figure. */
  subject(): Subject {
    const { left, width, height } = this.view_.getBoundingClientRect();
    const shot = { shown: { ...this.shown }, view: this.view(), width, height, pointer: this.pointer };
    const { state, source, wall } = this;
    return paneSubject(shot, left, this.element.getBoundingClientRect().top, { state, source, wall, paths: this.paths() });
  }

  destroy(): void {
    this.resized.disconnect();
    this.over?.destroy();
    this.under.destroy();
    this.element.remove();
  }

  private layers(): string[] {
    return this.shown.mode === "single" ? [this.shown.layer] : [this.shown.layer, this.shown.second];
  }

  private buildHead(): void {
    const titles = this.state.description.layers.map((layer) => [layer.key, layer.title] as const);
    const changed = (): void => this.state.tell("panes");
    const parts: HTMLElement[] = [
      select("what this pane shows", titles, this.shown.layer, (key) => {
        this.shown.layer = key;
        changed();
      }),
      select("how a second layer is brought in", Object.entries(MODES), this.shown.mode, (mode) => {
        this.shown.mode = mode as Mode;
        changed();
      }),
    ];
    if (this.shown.mode !== "single") {
      parts.push(
        select("the second layer", titles, this.shown.second, (key) => {
          this.shown.second = key;
          changed();
        }),
      );
    }
    if (this.shown.mode === "opacity" || this.shown.mode === "swipe") {
      const range = element("input", { type: "range", min: "0", max: "1", step: "0.01", "aria-label": this.shown.mode });
      range.value = String(this.shown.share);
      range.addEventListener("input", () => {
        this.shown.share = Number(range.value);
        this.bringTogether();
      });
      parts.push(range);
    }
    if (this.state.panes.length > 1) {
      const close = button("×", "close this pane", null, () => this.events.closed(this));
      close.className = "close";
      parts.push(close);
    }
    this.head.replaceChildren(...parts);
    this.element.setAttribute("aria-label", this.state.layer(this.shown.layer).title);
  }

  private follow(): void {
    const size = this.under.size();
    if (this.size !== size) {
      // a pane that became larger or smaller shows the same place at the same scale
      this.size = size;
      const kept = this.state.linked ? this.state.view : this.last;
      if (kept) this.under.setView(kept);
    }
    const view = this.view();
    this.last = view;
    this.over?.setView(view);
    const layer = this.state.layer(this.shown.layer);
    this.under.setSmooth(view.mm_per_px > Math.min(layer.row_mm, layer.column_mm));
    this.over?.setSmooth(true);
    this.events.moved(this, view);
    this.bringTogether();
    this.redraw();
  }

  private bringTogether(): void {
    const { mode, share } = this.shown;
    this.handle.hidden = mode !== "swipe";
    this.handle.style.left = `${100 * share}%`;
    if (!this.over) return;
    const { style } = this.over.element;
    style.opacity = String(secondOpacity(this.shown, this.state.secondShown));
    style.clipPath = "none";
    style.maskImage = "none";
    if (mode === "swipe") style.clipPath = `inset(0 0 0 ${100 * share}%)`;
    if (mode === "lens") style.clipPath = `circle(${LENS_PX}px at ${this.pointer.x}px ${this.pointer.y}px)`;
    if (mode === "checker") this.lay(style);
  }

  private lay(style: CSSStyleDeclaration): void {
    const { size, x, y } = squares(this.view(), this.wall, this.view_.clientWidth, this.view_.clientHeight);
    style.maskImage = "conic-gradient(#000 25%, transparent 0 50%, #000 0 75%, transparent 0)";
    style.maskSize = `${size}px ${size}px`;
    style.maskPosition = `${x}px ${y}px`;
  }

  private drag(event: PointerEvent): void {
    if (!this.handle.hasPointerCapture(event.pointerId)) return;
    const frame = this.view_.getBoundingClientRect();
    this.shown.share = Math.min(Math.max((event.clientX - frame.left) / frame.width, 0), 1);
    const range = this.head.querySelector<HTMLInputElement>("input[type=range]");
    if (range) range.value = String(this.shown.share);
    this.bringTogether();
  }

  private point(event: PointerEvent): void {
    const frame = this.view_.getBoundingClientRect();
    this.pointAt(event.clientX - frame.left, event.clientY - frame.top);
  }

  placeAt(x: number, y: number): Spot {
    const view = this.view();
    const { clientWidth, clientHeight } = this.view_;
    return {
      theta_rad: view.theta_rad + ((x - clientWidth / 2) * view.mm_per_px) / this.wall.part.radius_mm,
      z_mm: view.z_mm + (y - clientHeight / 2) * view.mm_per_px,
      side: this.state.description.has_common_places ? null : this.side,
    };
  }

  private draw(): void {
    const drawing = context(this.marks);
    const around = context(this.axes);
    if (!drawing || !around) return;
    const { clientWidth: width, clientHeight: height } = this.marks;
    const view = this.view();
    this.under.setDoubleClickZoom(!this.state.measuring && !this.state.landmarks.active && !this.state.landmarks.noting && !this.state.painting.active);
    const sheet: Sheet = { drawing, width, height, view, wall: this.wall, paper: paperOf(this.element) };
    drawMarks(sheet, this.state, this.paths(), this.layers());
    around.translate(AXES_PX.left, AXES_PX.top);
    drawAxes({ ...sheet, drawing: around });
    this.beyond.textContent = beyond(view, this.wall, height);
    // for whoever drives the page by a program
    this.element.dataset["thetaDeg"] = degrees(view.theta_rad).toFixed(3);
    this.element.dataset["zMm"] = view.z_mm.toFixed(4);
    this.element.dataset["mmPerPx"] = view.mm_per_px.toPrecision(7);
  }
}

/** How much of the wall lies beyond the view along z, "" where none does. */
function beyond(view: View, { part }: Wall, height: number): string {
  const half_mm = (height / 2) * view.mm_per_px;
  const ends = [["▲", view.z_mm - half_mm - part.top_mm], ["▼", part.bottom_mm - view.z_mm - half_mm]] as const;
  const said = ends.filter(([, mm]) => mm > SEEN_MM).map(([way, mm]) => `${way} ${mm.toFixed(1)} mm more`);
  return said.join("  ");
}
