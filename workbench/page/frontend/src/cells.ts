/** The table of cells: sorted, filtered, and linked to the panes. */

import type { CellPart, CellState } from "./description";
import { explain } from "./explain";
import { LEGEND, brief, cellsAsCsv, number } from "./cell_words";
import { button, download, element, select } from "./dom";
import type { Paths } from "./marks";
import type { State } from "./state";
import { type Place, type Wall, degrees, wrapped } from "./wall";

type Column = readonly [title: string, hint: string, key: (cell: CellPart) => number | string, text: (cell: CellPart) => string];

/** States as a filter names them. */
const FILTERS: Readonly<Record<CellState, string>> = {
  matched: "on both sides", overlapping: "overlapping by less than half", alone: "on one side only", "not observed": "not counted", "not aligned": "not aligned",
};

const COLUMNS: readonly Column[] = [
  ["cell", "side and number, as in cells.csv", (c) => `${c.side} ${String(c.id).padStart(6, "0")}`, (c) => String(c.id)],
  ["θ °", "centroid", (c) => c.theta_rad, (c) => degrees(c.theta_rad).toFixed(1)],
  ["z mm", "centroid, inward", (c) => c.z_mm, (c) => number(c.z_mm, 2)],
  ["mm²", "area on the nominal bore", (c) => c.area_mm2, (c) => number(c.area_mm2, 3)],
  ["depth", "median depth behind the wall, mm", (c) => c.depth_median_mm ?? -1, (c) => number(c.depth_median_mm, 2)],
  ["other side", "what the other side has there", (c) => `${c.state} ${1 - c.overlap}`, brief],
];

/** Whether a place lies within what is outlined of `layer`. */
export function isOutlined(paths: Paths, wall: Wall, layer: string, place: Place): boolean {
  const path = paths.get(layer)?.path;
  const { x, y } = wall.turnsOf({ theta_rad: wrapped(place.theta_rad), z_mm: place.z_mm });
  return path !== undefined && (document.createElement("canvas").getContext("2d")?.isPointInPath(path, x, y, "evenodd") ?? false);
}

/** The cell of the side that `layer` outlines at a place; null where it has none there. */
export function cellAt(
  state: State,
  paths: Paths,
  wall: Wall,
  layer: string,
  place: Place,
): CellPart | null {
  if (!isOutlined(paths, wall, layer, place)) return null;
  const side = state.layer(layer).side;
  const apart = (cell: CellPart): number => {
    const turned = wrapped(cell.theta_rad - place.theta_rad + Math.PI) - Math.PI;
    return Math.hypot(turned * wall.part.radius_mm, cell.z_mm - place.z_mm) / Math.max(cell.diameter_mm, 1e-6);
  };
  const own = state.description.cells.filter((cell) => cell.side === side);
  return own.reduce<CellPart | null>((best, cell) => (best && apart(best) <= apart(cell) ? best : cell), null);
}

export class CellTable {
  readonly element = element("section", { class: "cells", "aria-label": "cells" });
  private order = 0;
  private down = false;
  private filter = "all";
  private readonly body = element("tbody");
  private readonly colours: Map<string, string>;
  private readonly count = element("small");
  private readonly filters: HTMLSelectElement;
  private readonly about = element("p", { class: "about", "aria-live": "polite" });

  constructor(
    private readonly state: State,
    private readonly chosen: (cell: CellPart) => void,
  ) {
    this.colours = new Map(state.description.outlines.filter((outline) => !outline.is_drawn).map((outline) => [outline.side, outline.colour]));
    const states = [...new Set(state.description.cells.map((cell) => cell.state))];
    const options = [["all", "all"], ...state.description.sides.map((side) => [`of ${side}`, `of ${side}`] as const), ...states.map((one) => [one, FILTERS[one]] as const)] as const;
    this.filters = select("which cells are listed", options, "all", (value) => this.list(value));
    const heads = COLUMNS.map(([title, hint], k) => {
      const sort = element("button", { type: "button", title: `sort by: ${hint}` }, title);
      sort.addEventListener("click", () => {
        this.down = this.order === k && !this.down;
        this.order = k;
        this.draw();
      });
      return element("th", { scope: "col" }, sort);
    });
    this.body.addEventListener("keydown", (event) => this.step(event));
    this.element.append(
      element("h2", {}, "Cells ", explain("cell"), this.count, this.filters, button("CSV", "save the cells that are listed, as cells.csv has them", null, () => this.save())),
      element("div", { class: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...heads)), this.body)),
      element("p", { class: "legend" }, ...LEGEND.filter(([, of]) => state.description.cells.some(of)).map(([text]) => element("span", {}, text))),
      this.about,
    );
    state.on("selection", () => this.mark());
    this.draw();
  }

  /** List the cells that a filter has; those of one state are ringed on the panes. */
  list(filter: string): void {
    this.filters.value = this.filter = filter;
    this.draw();
    this.state.ringed = new Set(filter in FILTERS ? this.rows() : []);
    this.state.tell("marks");
  }

  private rows(): CellPart[] {
    const { filter } = this;
    const key = COLUMNS[this.order]?.[2] ?? (() => 0);
    const sign = this.down ? -1 : 1;
    return this.state.description.cells
      .filter((cell) => filter === "all" || filter === cell.state || filter === `of ${cell.side}`)
      .sort((one, other) => sign * (key(one) < key(other) ? -1 : key(one) > key(other) ? 1 : 0));
  }

  private save(): void {
    download(new Blob([cellsAsCsv(this.rows())], { type: "text/csv" }), "cells.csv");
  }

  private draw(): void {
    const rows = this.rows();
    this.count.textContent = `${rows.length} of ${this.state.description.cells.length}`;
    this.body.replaceChildren(
      ...rows.map((cell) => {
        const row = element("tr", { tabindex: "0", "data-cell": name(cell), title: cell.why });
        const swatch = element("i");
        swatch.style.background = this.colours.get(cell.side) ?? "none";
        row.append(element("td", {}, swatch, COLUMNS[0]?.[3](cell) ?? ""));
        COLUMNS.slice(1).forEach(([, , , text], k) => row.append(element("td", k === COLUMNS.length - 2 ? { class: cell.state.replace(" ", "-") } : {}, text(cell))));
        row.addEventListener("click", () => this.chosen(cell));
        return row;
      }),
    );
    this.element.querySelectorAll("th").forEach((head, k) => {
      head.setAttribute("aria-sort", k !== this.order ? "none" : this.down ? "descending" : "ascending");
    });
    this.mark();
  }

  private mark(): void {
    const { selected } = this.state;
    this.about.textContent = selected ? `${name(selected)}: ${about(selected)}` : "Choose a cell to go there.";
    const wanted = this.state.selected ? name(this.state.selected) : "";
    for (const row of this.body.rows) {
      const isChosen = row.dataset["cell"] === wanted;
      row.setAttribute("aria-selected", String(isChosen));
      if (isChosen) row.scrollIntoView({ block: "nearest" });
    }
  }

  private step(event: KeyboardEvent): void {
    const row = event.target instanceof HTMLTableRowElement ? event.target : null;
    if (!row) return;
    const next = event.key === "ArrowDown" ? row.nextElementSibling : event.key === "ArrowUp" ? row.previousElementSibling : row;
    if (event.key !== "Enter" && next === row) return;
    event.preventDefault();
    event.stopPropagation();
    if (!(next instanceof HTMLTableRowElement)) return;
    next.focus();
    next.click();
  }
}

function about(cell: CellPart): string {
  const depth = cell.depth_of === null ? "depth not measured"
    : `depth ${withError(cell.depth_median_mm, cell.depth_error_mm)} mm, 95th percentile ${number(cell.depth_p95_mm, 3)} mm, by ${cell.depth_of}`;
  const own = cell.own_depth_mm === null || cell.depth_of === cell.side ? ""
    : `; by ${cell.side} itself ${withError(cell.own_depth_mm, cell.own_depth_error_mm)} mm`;
  const volume = cell.volume_mm3 === null ? "" : `, ${number(cell.volume_mm3, 3)} mm³`;
  const edge = cell.touches_edge ? "; at the edge of what was observed, may be larger" : "";
  return `${cell.why}. ${number(cell.area_mm2, 3)} mm², ⌀ ${number(cell.diameter_mm, 2)} mm; ${depth}${volume}${own}${edge}.`;
}

function withError(value_mm: number | null, error_mm: number | null): string {
  return number(value_mm, 3) + (error_mm === null ? "" : ` ± ${number(error_mm, 2)}`);
}

function name(cell: CellPart): string {
  return `${cell.side} ${cell.id}`;
}
