/** What lies under the cursor: θ, z, the value of every layer of numbers, the cells. */

import { element } from "./dom";
import type { Source, Values } from "./source";
import type { State } from "./state";
import { cellAt, isOutlined } from "./cells";
import { type Spot, degrees } from "./wall";
import { apartOnWall, type Paths } from "./marks";
import type { Wall } from "./wall";

export class Readout {
  readonly element = element("section", { class: "readout", "aria-label": "values under the cursor" });
  private asking = false;
  private wanted: Spot | null = null;
  private values: Values | null = null;

  constructor(
    private readonly state: State,
    private readonly source: Source,
    private readonly wall: Wall,
    private readonly paths: () => Paths,
  ) {
    state.on("cursor", () => this.follow());
    state.on("marks", () => this.follow());
    this.draw();
  }

  private follow(): void {
    this.draw();
    this.wanted = this.place;
    if (!this.asking) void this.ask();
  }

  /** One question at a time, always for the place where the cursor is by then. */
  private async ask(): Promise<void> {
    this.asking = true;
    while (this.wanted) {
      const place = this.wanted;
      this.wanted = null;
      this.values = await this.source.values(place.theta_rad, place.z_mm).catch(() => null);
      if (!this.wanted) this.draw();
    }
    this.asking = false;
  }

  private get place(): Spot | null {
    return this.state.cursor ?? this.state.pinned;
  }

  private draw(): void {
    const { place } = this;
    const rows: [string, string][] = [
      ["θ", place ? `${degrees(place.theta_rad).toFixed(2)}°` : "–"],
      ["z", place ? `${place.z_mm.toFixed(3)} mm`.replace("-", "−") : "–"],
    ];
    const { top_mm, bottom_mm } = this.wall.part;
    const inside = place !== null && place.z_mm >= top_mm && place.z_mm <= bottom_mm;
    for (const layer of this.state.description.layers) {
      if (layer.kind !== "scalar" || !this.state.isCommon(place?.side ?? null, layer.side)) continue;
      const value = inside ? this.values?.[layer.key] : undefined;
      const text = value === undefined ? "–" : value === null ? "not observed" : valueText(value, layer.unit);
      rows.push([layer.title, text]);
    }
    for (const outline of this.state.description.outlines) {
      if (!this.state.isCommon(place?.side ?? null, outline.side)) continue;
      if (outline.is_drawn) {
        rows.push([outline.title, inside && place && isOutlined(this.paths(), this.wall, outline.layer, place) ? (outline.layer === "wall-contradictions" ? "here" : "cell") : "–"]);
        continue;
      }
      const cell = inside && place ? cellAt(this.state, this.paths(), this.wall, outline.layer, place) : null;
      rows.push([`${outline.side}: cell`, cell ? `${cell.id} (${cell.state === "alone" ? `only ${cell.side}` : cell.state})` : "–"]);
    }
    const { ruler } = this.state;
    if (ruler?.to) {
      const { around_mm, along_mm } = apartOnWall(ruler.from, ruler.to, this.wall);
      const [wide_mm, tall_mm] = [Math.abs(around_mm), Math.abs(along_mm)];
      const fromAxis = (Math.atan2(wide_mm, tall_mm) * 180) / Math.PI;
      rows.push(["ruler", `${Math.hypot(wide_mm, tall_mm).toFixed(3)} mm, ${fromAxis.toFixed(1)}° from the axis`]);
      rows.push(["its rectangle", `${wide_mm.toFixed(3)} × ${tall_mm.toFixed(3)} mm, ${(wide_mm * tall_mm).toFixed(3)} mm²`]);
    }
    const pinned = !this.state.cursor && this.state.pinned ? "at the marked place" : "under the cursor";
    this.element.replaceChildren(
      element("h2", {}, "Values ", element("small", {}, place ? pinned : "")),
      element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)])),
    );
  }
}

function valueText(value: number, unit: string): string {
  const text = unit === "mm" ? `${value.toFixed(3).replace(/^-(?=[0.]*$)/, "")} mm` : `${Number(value.toPrecision(4))}`;
  return text.replace("-", "−");
}
