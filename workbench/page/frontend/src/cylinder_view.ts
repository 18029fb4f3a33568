/** The wall as a cylinder beside the panes: the same layers, colours and marks. */

import { drawCylinderAxes } from "./cylinder_axes";
import { CylinderControls } from "./cylinder_controls";
import { outlinePicture } from "./cylinder_outlines";
import { cylinderProgram, whyNoCylinder } from "./cylinder_program";
import type { CylinderScene } from "./cylinder_scene";
import { brightLast, lookUpTable, wholeMap } from "./colouring";
import { button, context, element, select } from "./dom";
import type { Drawing } from "./drawing";
import type { Paths } from "./marks";
import { knownRange, readRelief, smoothRelief, surfaceOf } from "./relief";
import type { Source } from "./source";
import type { State } from "./state";
import type { Subject } from "./subject";
import { type Spot, type Wall, wrapped } from "./wall";
import { readVolume } from "./volume";
import { shownRange, wholeLength_mm, wholeLevel, wholeWall } from "./whole_wall";

const SMOOTH = "";
const VOLUME = "volume";
/** A level that is there at once, until the finest one is. */
const FIRST_LEVEL = 1;
const CLICK_PX = 4;
const STEP_RAD = Math.PI / 36;

export interface CylinderEvents {
  pointed(place: Spot | null): void;
  clicked(place: Spot, side: string | null): void;
}

export class CylinderView {
  readonly element = element("section", { class: "cylinder", "aria-label": "the wall in three dimensions" });
  private readonly canvas = element("canvas", { class: "scene", tabindex: "0", "aria-label": "the cylinder: drag or use arrow keys to turn it" });
  private readonly axes = element("canvas", { class: "marks", "aria-hidden": "true" });
  private readonly said = element("p", { class: "said", role: "status" });
  private readonly controls: CylinderControls;
  private scene: CylinderScene | null = null;
  private layer: string;
  private shape = SMOOTH;
  /** Whose outlines are laid over it, as they are drawn anew only when that changes. */
  private outlined = "";
  /** Counts what was chosen: what is answered late to an older choice is not shown. */
  private filling = 0;
  private hasFailed = false;
  /** As long as nobody can have turned it. */
  private isNew = true;
  /** Where along z the shape is known. */
  private known: [number, number] | null = null;
  private pointed: { x: number; y: number } | null = null;
  private pressed: { x: number; y: number } | null = null;
  private readonly resized = new ResizeObserver(() => this.scene?.resize());

  constructor(
    private readonly state: State,
    private readonly source: Source,
    private readonly wall: Wall,
    private readonly paths: () => Paths,
    private readonly events: CylinderEvents,
  ) {
    this.layer = state.panes[0]?.layer ?? state.description.layers[0]?.key ?? "";
    this.controls = new CylinderControls(wall, {
      cut: () => this.recut(),
      limit: (share) => this.scene?.setLimit(share),
      look: (from) => this.scene?.look(from),
      light: (on) => this.scene?.setLight(on),
      large: (on) => this.element.classList.toggle("large", on),
    });
    const close = button("×", "close the cylinder", null, () => {
      this.state.cylinder = false;
      this.state.tell("panes");
    });
    close.className = "close";
    const view = element("div", { class: "view" }, this.canvas, this.axes, this.said);
    this.element.append(element("header", {}, ...this.choices(), close), view, this.controls.element);
    this.listen();
    this.resized.observe(view);
    void this.open();
  }

  destroy(): void {
    this.filling += 1;
    this.resized.disconnect();
    this.scene?.dispose();
    this.scene = null;
    this.element.remove();
  }

  /** Show the colours, or the marks and outlines, that the state has by now. */
  recolour(): void {
    const part = this.state.layer(this.layer);
    const colouring = this.state.colouring(part.key);
    if (this.shape === VOLUME) this.scene?.setColours(wholeMap(brightLast(colouring.map))); // its codes are its own
    else if (part.kind === "scalar") this.scene?.setColours(lookUpTable(part, colouring));
  }

  /** What it shows now, for a figure; null as long as it shows nothing. */
  subject(): (Subject & { isAlone: boolean }) | null {
    const { scene, canvas, layer } = this;
    if (!scene || this.hasFailed) return null; // it is not what was chosen
    const { left, width, height } = canvas.getBoundingClientRect();
    const shape = this.shape === VOLUME ? " and the dense volume" : this.shape === SMOOTH ? " on the smooth bore" : this.shape === layer ? "" : ` on the shape of ${this.state.layer(this.shape).title}`;
    const found: Subject & { isAlone: boolean } = {
      left, width, height,
      top: this.element.getBoundingClientRect().top,
      title: `${this.state.layer(layer).title}${shape}, in perspective`,
      layers: [layer],
      view: null,
      isAlone: this.element.classList.contains("large"),
      withHeight: () => found,
      picture: (ratio) => Promise.resolve(scene.picture(ratio)),
      marks: (drawing) => this.drawAxes(drawing),
      axes: () => undefined,
    };
    return found;
  }

  remark(): void {
    const side = this.state.layer(this.layer).side;
    const here = (spot: Spot | null): Spot | null => (spot && this.state.isCommon(spot.side, side) ? spot : null);
    this.scene?.setMarks({ cursor: here(this.state.cursor), pinned: here(this.state.pinned) });
    const outlined = [this.layer, ...this.state.outlines, this.paths().size].join();
    if (!this.scene || outlined === this.outlined) return;
    this.outlined = outlined;
    this.scene.setOutlines(outlinePicture(this.state, this.paths(), this.wall, this.layer));
  }

  lookAt(z_mm: number): void {
    this.scene?.lookAt(z_mm);
  }

  private choices(): HTMLElement[] {
    const { layers } = this.state.description;
    const side = this.state.layer(this.layer).side;
    const shapes = layers.filter((one) => one.kind === "scalar" && one.unit === "mm" && this.state.isCommon(one.side, side));
    if (this.shape !== VOLUME && !shapes.some((one) => one.key === this.shape)) this.shape = [(one: string): boolean => one === "wall-relief", (one: string): boolean => one.endsWith("-relief"), (): boolean => true] // depth by parallax is ragged
      .map((fits) => shapes.find((one) => fits(one.key))).find((one) => one !== undefined)?.key ?? SMOOTH;
    const layer = select("what the cylinder shows", layers.map((one) => [one.key, one.title] as const), this.layer, (key) => {
      this.layer = key;
      this.element.querySelector("header")?.replaceChildren(...this.choices(), ...this.element.querySelectorAll("header .close"));
      void this.fill();
    });
    const volume = this.state.description.has_volume ? [[VOLUME, "the dense volume"] as const] : [];
    const shape = select("its shape", [...shapes.map((one) => [one.key, `shape: ${one.title}`] as const), [SMOOTH, "shape: smooth bore"], ...volume], this.shape, (key) => {
      this.shape = key;
      void this.fill();
    });
    return [layer, shape];
  }

  private async open(): Promise<void> {
    this.said.textContent = whyNoCylinder() || "One moment …";
    if (this.said.textContent !== "One moment …") return;
    const { filling } = this;
    try {
      const { CylinderScene: Scene } = await cylinderProgram();
      if (filling !== this.filling) return;
      this.scene = new Scene(this.canvas, this.wall.part, () => this.draw());
      this.scene.resize();
      this.recut();
      await this.fill();
    } catch (error) {
      this.said.textContent = `No view in three dimensions: ${error instanceof Error ? error.message : String(error)}`;
    }
  }

  /** Shape and picture anew. */
  private async fill(): Promise<void> {
    if (!this.scene) return; // it is filled once it is there
    this.filling += 1;
    const { filling } = this;
    const wants = (): boolean => filling === this.filling;
    delete this.element.dataset["filled"];
    try {
      await this.bend(wants);
      await this.paint(wants);
      if (!wants()) return;
      this.hasFailed = false;
      this.recolour();
      this.remark();
    } catch (error) {
      if (!wants()) return;
      this.hasFailed = true;
      this.said.textContent = `No view in three dimensions: ${error instanceof Error ? error.message : String(error)}`;
    }
    this.element.dataset["filled"] = ""; // for whoever drives the page by a program, as is all of these
  }

  private async bend(wants: () => boolean): Promise<void> {
    // within the volume the relief still says where the wall is
    const shape = this.shape === VOLUME ? `${this.state.layer(this.layer).side}-relief` : this.shape;
    const bytes = shape === SMOOTH ? null : await this.source.relief(shape);
    if (!wants()) return;
    if (!bytes && this.shape !== SMOOTH && this.shape !== VOLUME) throw new Error("the shape could not be fetched");
    const relief = bytes ? readRelief(bytes) : smoothRelief(this.wall);
    this.known = knownRange(relief);
    this.scene?.setSurface(surfaceOf(relief, this.wall.part.radius_mm));
    await this.fillVolume(wants);
  }

  private async fillVolume(wants: () => boolean): Promise<void> {
    this.controls.showLimit(this.shape === VOLUME);
    if (this.shape === VOLUME) {
      this.said.textContent = "One moment …";
      const bytes = await this.source.volume();
      if (!wants()) return;
      this.said.textContent = "";
      if (!bytes) throw new Error("the volume could not be fetched");
      this.scene?.setVolume(readVolume(bytes));
      this.scene?.setLimit(this.controls.limit);
    } else this.scene?.setVolume(null);
  }

  private async paint(wants: () => boolean): Promise<void> {
    const { scene, layer } = this;
    if (!scene || !wants()) return;
    const finest = wholeLevel(this.source, this.wall, layer, scene.largestPicture);
    for (const level of new Set([Math.min(FIRST_LEVEL, finest), finest])) {
      const picture = await wholeWall(this.source, this.wall, layer, level, wants);
      if (!picture) return;
      scene.setPicture(picture, wholeLength_mm(this.wall, level), this.state.layer(layer).kind === "scalar");
      this.said.textContent = "";
      if (!this.controls.isRanged && level <= FIRST_LEVEL) this.showAll(shownRange(picture, this.wall));
    }
  }

  /** Show from where to where there is something to see; so far nobody chose anything else. */
  private showAll(shown: [number, number] | null): void {
    const { known } = this;
    if (!known || !shown || Math.max(known[0], shown[0]) >= Math.min(known[1], shown[1])) return;
    this.controls.range = [Math.max(known[0], shown[0]), Math.min(known[1], shown[1])];
    this.recut();
    if (this.isNew) this.scene?.look("aslant");
    this.isNew = false;
  }

  private recut(): void {
    const { cut_rad, opening_rad, range } = this.controls;
    this.scene?.setCut(cut_rad, opening_rad, ...range);
  }

  private listen(): void {
    const { canvas } = this;
    const at = (event: PointerEvent): { x: number; y: number } => ({ x: event.offsetX, y: event.offsetY });
    canvas.addEventListener("pointerdown", (event) => {
      this.pressed = at(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) return;
      if (!this.pointed) requestAnimationFrame(() => this.point());
      this.pointed = at(event);
    });
    canvas.addEventListener("pointerleave", () => {
      this.pointed = null;
      this.events.pointed(null);
    });
    canvas.addEventListener("pointerup", (event) => {
      const { x, y } = at(event);
      const isClick = this.pressed && Math.hypot(x - this.pressed.x, y - this.pressed.y) <= CLICK_PX;
      const place = isClick ? this.placeAt(x, y) : null;
      if (place) this.events.clicked(place, this.state.layer(this.layer).side);
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  private point(): void {
    const { pointed } = this;
    this.pointed = null;
    if (!pointed) return;
    const place = this.placeAt(pointed.x, pointed.y);
    this.element.dataset["pointed"] = place ? `${place.theta_rad.toFixed(5)} ${place.z_mm.toFixed(5)}` : "none";
    this.events.pointed(place);
  }

  private placeAt(x: number, y: number): Spot | null {
    const place = this.scene?.pick(x, y);
    if (!place) return null;
    return { ...place, side: this.state.description.has_common_places ? null : this.state.layer(this.layer).side };
  }

  private key(event: KeyboardEvent): void {
    const acts: Record<string, () => void> = {
      ArrowLeft: () => this.scene?.orbit(-STEP_RAD, 0, 1),
      ArrowRight: () => this.scene?.orbit(STEP_RAD, 0, 1),
      ArrowUp: () => this.scene?.orbit(0, -STEP_RAD, 1),
      ArrowDown: () => this.scene?.orbit(0, STEP_RAD, 1),
      "+": () => this.scene?.orbit(0, 0, 1.2),
      "=": () => this.scene?.orbit(0, 0, 1.2),
      "-": () => this.scene?.orbit(0, 0, 1 / 1.2),
      "0": () => this.scene?.look("aslant"),
    };
    const act = acts[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation(); // it turns the cylinder, and leaves the panes where they are
    act();
  }

  private drawAxes(drawing: Drawing): void {
    const { cut_rad, opening_rad, range } = this.controls;
    const edge_rad = wrapped(cut_rad + opening_rad / 2); // the left one, seen through the cut
    if (this.scene) drawCylinderAxes(drawing, this.scene, this.wall.part.radius_mm, range, edge_rad);
  }

  private draw(): void {
    const { scene } = this;
    const drawing = context(this.axes);
    if (!scene || !drawing) return;
    this.drawAxes(drawing);
    this.element.dataset["eyeMm"] = scene.eye_mm.map((one) => one.toFixed(4)).join(" ");
  }
}
