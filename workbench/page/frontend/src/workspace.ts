/** The panes with all that goes with them. */

import { Aim } from "./aim";
import { CellTable } from "./cells";
import { CylinderView } from "./cylinder_view";
import { Filters } from "./colouring";
import type { CellPart, Description } from "./description";
import { element } from "./dom";
import { askToExport } from "./export_dialog";
import { LandmarkPanel } from "./landmark_panel";
import type { Pair } from "./landmarks";
import { Link } from "./link";
import { type Paths, outlinePaths } from "./marks";
import { MaskPanel } from "./mask_panel";
import type { Tools } from "./next_steps";
import { NotePanel } from "./note_panel";
import { Painter } from "./painter";
import { Pane } from "./pane";
import { toShown } from "./placement";
import { Placer } from "./placer";
import { FrameDrawer } from "./frame_drawer";
import { plotQuality } from "./quality";
import { Readout } from "./readout";
import { askToSave } from "./save_view";
import { SharedView } from "./shared_view";
import type { Source } from "./source";
import { State } from "./state";
import { MOST_PANES, toolbar } from "./toolbar";
import { type Place, type Spot, Wall, wrapped } from "./wall";

/** How large a cell is shown when it is selected. */
const CELL_PX = 150;

export class Workspace {
  readonly element = element("main", { class: "workspace" });
  readonly state: State;
  private readonly wall: Wall;
  private readonly filters: Filters;
  private paths: Paths = new Map();
  private readonly link: Link;
  private readonly drawer: FrameDrawer;
  private readonly landmarks: LandmarkPanel;
  private readonly notes: NotePanel;
  private readonly placer: Placer;
  private readonly painter: Painter;
  private readonly aim: Aim;
  private readonly shared: SharedView;
  private readonly cells: CellTable;
  private readonly grid = element("div", { class: "panes" });
  private panes: Pane[] = [];
  private cylinder: CylinderView | null = null;

  private readonly pointing = {
    pointed: (place: Spot | null): void => {
      this.state.cursor = place;
      this.state.tell("cursor");
    },
    clicked: (place: Spot, side: string | null): void => this.click(place, side),
  };

  constructor(description: Description, private readonly source: Source) {
    this.state = new State(description);
    this.wall = new Wall(description.wall);
    this.filters = new Filters(description.layers);
    this.link = new Link(this.state, this.wall, () => this.panes);
    this.drawer = new FrameDrawer(this.state, source, (z_mm) => this.go(z_mm));
    this.landmarks = new LandmarkPanel(this.state, source, (pair) => this.show(pair));
    this.notes = new NotePanel(this.state, this.landmarks, (spot) => this.lookAt(spot));
    this.placer = new Placer(this.state);
    this.painter = new Painter(this.state);
    this.cells = new CellTable(this.state, (cell) => this.select(cell));
    this.shared = new SharedView(this.state, () => this.panes[0]?.view());
    this.aim = new Aim(() => this.panes, (pane, view) => (this.state.linked ? this.link.show(view) : pane.setView(view)));
    const draw = source.canSave && description.sides.length > 1 ? (): void => this.painter.toggle() : null;
    const actions = { addPane: () => this.addPane(), home: () => this.home(), save: () => this.save(), export: source.canSave ? (): void => void askToExport(source) : null, draw };
    const side = element("aside", {}, new Readout(this.state, source, this.wall, () => this.paths).element);
    side.append(this.landmarks.element, this.notes.element);
    if (source.canSave && description.sides.length > 1) side.append(new MaskPanel(this.state, source).element);
    if (description.cells.length) side.append(this.cells.element);
    this.element.append(element("div", { class: "stage" }, toolbar(this.state, this.placer, actions), this.grid, this.drawer.element), side);
    this.state.on("panes", () => this.refresh());
    this.state.on("colours", () => this.recolour());
    this.state.on("link", () => this.relink());
    for (const change of ["marks", "cursor", "selection", "landmarks", "painting"] as const) this.state.on(change, () => this.redraw());
    document.addEventListener("keydown", (event) => this.key(event));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.state.tell("cursor")); // axes have its ink
  }

  /** What the steps of the heading lead to. */
  get tools(): Tools {
    const seen = (act: () => void): void => {
      this.element.scrollIntoView({ block: "start" });
      act();
    };
    return {
      show: (z_mm) => seen(() => this.go(z_mm)),
      landmarks: () => seen(() => this.state.landmarks.active || this.placer.toggle()),
      uncounted: () => seen(() => {
        this.home();
        this.cells.list("not observed");
      }),
      draw: this.source.canSave ? (side): void => seen(() => this.painter.beginOn(side)) : null,
    };
  }

  /** Plot how good every frame is, below. */
  plotQuality(more: HTMLElement): void {
    plotQuality(more, this.state, (z_mm) => this.go(z_mm));
  }

  /** Open the panes; the page must hold the workspace by then, so that they know how large they are. */
  start(): void {
    const view = this.shared.restore();
    this.recolour();
    this.refresh();
    void this.source.outlines().then((lines) => {
      this.paths = outlinePaths(this.state.description, lines, this.wall);
      this.redraw();
    });
    void this.landmarks.load();
    requestAnimationFrame(() => requestAnimationFrame(() => {
      if (view) this.link.show(view);
      else this.home();
      this.state.tell("cursor");
      this.shared.follow();
    }));
  }

  private refresh(): void {
    const kept = this.panes.filter((pane) => this.state.panes.includes(pane.shown));
    for (const pane of this.panes) if (!kept.includes(pane)) pane.destroy();
    this.grid.style.setProperty("--panes", String(this.state.panes.length));
    this.panes = this.state.panes.map((shown) => kept.find((pane) => pane.shown === shown) ?? this.newPane(shown));
    this.grid.replaceChildren(...this.panes.map((pane) => pane.element), ...this.openCylinder());
    for (const pane of this.panes) {
      pane.refresh();
      if (!kept.includes(pane) && this.state.view) pane.setView(this.state.view);
    }
  }

  private openCylinder(): HTMLElement[] {
    if (!this.state.cylinder) {
      this.cylinder?.destroy();
      this.cylinder = null;
      return [];
    }
    this.cylinder ??= new CylinderView(this.state, this.source, this.wall, () => this.paths, this.pointing);
    return [this.cylinder.element];
  }

  private newPane(shown: State["panes"][number]): Pane {
    return new Pane(this.grid, shown, this.state, this.source, this.wall, this.filters, () => this.paths, {
      ...this.pointing,
      painter: this.painter,
      moved: (pane, view) => {
        this.link.moved(pane, view);
        this.shared.later();
      },
      closed: (pane) => {
        this.state.panes = this.state.panes.filter((one) => one !== pane.shown);
        this.state.tell("panes");
      },
    });
  }

  private addPane(): void {
    if (this.state.panes.length >= MOST_PANES) return;
    const shown = new Set(this.state.panes.map((pane) => pane.layer));
    const layers = this.state.description.layers;
    const next = layers.find((layer) => !shown.has(layer.key)) ?? layers[0];
    if (!next) return;
    this.state.panes = [...this.state.panes, { layer: next.key, second: next.key, mode: "single", share: 0.5 }];
    this.state.tell("panes");
  }

  private home(): void {
    const pane = this.panes[0];
    if (pane) this.link.show(pane.home());
  }

  private recolour(): void {
    for (const layer of this.state.description.layers) {
      if (layer.kind === "scalar") this.filters.set(layer, this.state.colouring(layer.key));
    }
    for (const pane of this.panes) pane.refresh();
    this.cylinder?.recolour();
  }

  private relink(): void {
    const pane = this.panes[0];
    if (this.state.linked && pane) this.link.show(pane.view());
  }

  private redraw(): void {
    for (const pane of this.panes) pane.redraw();
    this.cylinder?.remark();
  }

  private click(place: Spot, side: string | null): void {
    if (this.state.landmarks.noting) {
      this.notes.begin(place, side, this.panes[0]?.view().mm_per_px ?? 0);
      return;
    }
    if (this.state.landmarks.active) {
      this.placer.place(place, side, this.panes[0]?.view().mm_per_px ?? 0);
      return;
    }
    if (this.state.measuring) {
      const open = this.state.ruler && !this.state.ruler.to ? this.state.ruler : null;
      this.state.ruler = open ? { from: open.from, to: place } : { from: place, to: null };
      this.state.tell("marks");
      return;
    }
    this.pin(place);
    // the frames that appear below make the panes smaller
    requestAnimationFrame(() => requestAnimationFrame(() => this.reveal(place.z_mm)));
  }

  private pin(place: Spot | null): void {
    this.state.pinned = place && { ...place, theta_rad: wrapped(place.theta_rad) };
    this.state.tell("cursor");
  }

  private select(cell: CellPart): void {
    this.state.selected = cell;
    this.state.tell("selection");
    this.cylinder?.lookAt(cell.z_mm);
    const shown = this.panes.filter((pane) => this.state.isCommon(cell.side, pane.side));
    const now = shown[0]?.view();
    if (!now) return;
    const mm_per_px = Math.min(now.mm_per_px, cell.diameter_mm / CELL_PX);
    // the nearer way around
    const apart = wrapped(cell.theta_rad - now.theta_rad + Math.PI) - Math.PI;
    const view = { theta_rad: now.theta_rad + apart, z_mm: cell.z_mm, mm_per_px };
    if (this.state.linked) this.link.show(view);
    else for (const pane of shown) pane.setView(view);
  }

  /** Bring a place of the wall of `side` into view, in the panes that have it. */
  private lookAt({ side, ...place }: Spot): void {
    for (const pane of this.panes.filter((one) => this.state.isCommon(side, one.side))) this.lead(pane, place);
  }

  /** Bring a place into view in a pane, and in those that are linked to it. */
  private lead(pane: Pane, place: Place): void {
    const view = { ...pane.view(), ...place };
    if (this.state.linked) this.link.show(view);
    else pane.setView(view);
  }

  /** Bring both ends of a landmark pair into view. */
  private show(pair: Pair): void {
    this.state.description.frames.forEach((frames, k) => {
      const place = toShown(frames.placement, k ? pair.b : pair.a);
      for (const pane of this.panes.filter((one) => one.side === frames.side)) this.lead(pane, place);
    });
  }

  /** Mark the place at `z_mm`, and bring it into view. */
  private go(z_mm: number): void {
    const now = this.panes[0]?.view();
    if (!now) return;
    const side = this.state.pinned?.side ?? (this.state.description.has_common_places ? null : (this.panes[0]?.side ?? null));
    this.pin({ theta_rad: this.state.pinned?.theta_rad ?? wrapped(now.theta_rad), z_mm, side });
    this.reveal(z_mm);
  }

  /** Bring `z_mm` into view, where it is not. */
  private reveal(z_mm: number): void {
    const now = this.panes[0]?.view();
    const heights = this.panes.map((pane) => pane.element.querySelector(".view")?.clientHeight ?? 0);
    const half_mm = (Math.min(...heights) / 2 - 30) * (now?.mm_per_px ?? 0);
    if (now && Math.abs(z_mm - now.z_mm) > half_mm) this.link.show({ ...now, z_mm });
  }

  private save(): void {
    const cylinder = this.cylinder?.subject();
    const panes = cylinder?.isAlone ? [] : this.panes.map((pane) => pane.subject());
    askToSave([...panes, ...(cylinder ? [cylinder] : [])], this.state);
  }

  private key(event: KeyboardEvent): void {
    const target = event.target;
    if (document.querySelector("dialog[open]")) return; // also where its focus is lost, as by a button that is disabled
    if (this.painter.key(event) || this.placer.key(event)) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (target instanceof HTMLInputElement || target instanceof HTMLSelectElement) return;
    if (this.aim.key(event)) {
      event.preventDefault();
      return;
    }
    const acts: Record<string, () => void> = {
      "0": () => this.home(),
      l: () => {
        this.state.linked = !this.state.linked;
        this.state.tell("link");
      },
      b: () => {
        this.state.secondShown = !this.state.secondShown;
        for (const pane of this.panes) pane.refresh();
      },
      o: () => {
        const all = this.state.description.outlines.map((outline) => outline.layer);
        this.state.outlines = new Set(this.state.outlines.size ? [] : all);
        this.state.tell("marks");
      },
      r: () => {
        this.state.measuring = !this.state.measuring;
        this.state.ruler = null;
        this.state.tell("marks");
      },
      "+": () => this.zoom(1 / 1.5),
      "=": () => this.zoom(1 / 1.5),
      "-": () => this.zoom(1.5),
      arrowup: () => this.step(0, -1),
      arrowdown: () => this.step(0, 1),
      arrowleft: () => this.step(-1, 0),
      arrowright: () => this.step(1, 0),
      m: () => this.placer.toggle(),
      n: () => this.placer.toggle("noting"),
      d: () => this.painter.toggle(),
      escape: () => {
        if (this.placer.forget()) return;
        this.state.selected = null;
        this.state.ruler = null;
        this.state.measuring = false;
        this.state.tell("marks");
        this.state.tell("selection");
        this.pin(null);
      },
    };
    const act = acts[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  }

  private zoom(by: number): void {
    const now = this.panes[0]?.view();
    if (now) this.link.show({ ...now, mm_per_px: now.mm_per_px * by });
  }

  /** Move the marked place by a degree and by a frame of the side in the first pane; without one, the view. */
  private step(across: number, down: number): void {
    const pane = this.panes[0];
    if (!pane) return;
    const { pinned } = this.state;
    if (!pinned) {
      const now = pane.view();
      const [theta_rad, z_mm] = [now.theta_rad + (across * 60 * now.mm_per_px) / this.wall.part.radius_mm, now.z_mm + down * 60 * now.mm_per_px];
      this.link.show({ ...now, theta_rad, z_mm });
      return;
    }
    const theta_rad = pinned.theta_rad + (across * Math.PI) / 180;
    const { frames } = this.state.description;
    const side = pinned.side ?? pane.side;
    const found = frames.find((one) => one.side === side && one.z_mm.length) ?? frames.find((one) => one.z_mm.length);
    const next = down && found ? nextFrame(found.z_mm, pinned.z_mm, down) : pinned.z_mm;
    this.state.pinned = { ...pinned, theta_rad: wrapped(theta_rad), z_mm: next };
    this.go(next);
  }
}

/** The z of the frame after, or before, the one nearest to `z_mm`. */
function nextFrame(frames_mm: readonly number[], z_mm: number, down: number): number {
  const sorted = [...frames_mm].sort((a, b) => a - b);
  const apart = sorted.map((one) => Math.abs(one - z_mm));
  const nearest = apart.indexOf(Math.min(...apart));
  return sorted[Math.min(Math.max(nearest + down, 0), sorted.length - 1)] ?? z_mm;
}
