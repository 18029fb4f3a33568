/** What is below the cylinder: views to begin with, light, and what is cut away. */

import type { Direction } from "./cylinder_scene";
import { button, element } from "./dom";
import type { Wall } from "./wall";

const START = { cut_deg: 270, opening_deg: 120 };
const STEPS = 500;

export interface ControlEvents {
  cut(): void;
  limit(share: number): void;
  look(from: Direction): void;
  light(on: boolean): void;
  large(on: boolean): void;
}

export class CylinderControls {
  readonly element = element("footer");
  /** Whether from where to where it is shown was chosen by hand. */
  isRanged = false;
  private readonly cut: HTMLInputElement;
  private readonly opening: HTMLInputElement;
  private readonly from: HTMLInputElement;
  private readonly to: HTMLInputElement;
  private readonly least: HTMLInputElement;

  constructor(wall: Wall, events: ControlEvents) {
    const { top_mm, bottom_mm } = wall.part;
    const ranged = (): void => {
      this.isRanged = true;
      events.cut();
    };
    const step = wall.length_mm / STEPS;
    this.cut = slider("where it is cut open, θ", 0, 360, 1, START.cut_deg, events.cut);
    this.opening = slider("how far it is open", 0, 300, 1, START.opening_deg, events.cut);
    this.from = slider("from this z on", top_mm, bottom_mm, step, top_mm, ranged);
    this.to = slider("up to this z", top_mm, bottom_mm, step, bottom_mm, ranged);
    this.least = slider("volume: from this brightness on", 0, 1, 0.01, 0.35, () => events.limit(this.limit));
    const view = (name: Direction, title: string): HTMLButtonElement => button(name, title, null, () => events.look(name));
    this.element.append(
      element("span", {}, view("in", "along the axis, from the mouth"), view("aslant", "into the mouth, aslant"),
        view("side", "all of it, from the side where it is open"),
        toggle("light", "light from the eye, which shows the shape; without, colours are those of the bar", true, events.light),
        toggle("larger", "the cylinder in place of the panes", false, events.large)),
      element("label", {}, "cut at", this.cut), element("label", {}, "open", this.opening),
      element("label", {}, "z from", this.from), element("label", {}, "to", this.to),
      element("label", {}, "from brightness", this.least),
    );
    this.showLimit(false);
  }

  /** The code from which on samples of the volume are seen, 0 to 1. */
  get limit(): number {
    return Number(this.least.value);
  }

  showLimit(on: boolean): void {
    const label = this.least.parentElement;
    if (label) label.hidden = !on;
  }

  get cut_rad(): number {
    return radians(this.cut);
  }

  get opening_rad(): number {
    return radians(this.opening);
  }

  /** From where to where along z it is shown, mm. */
  get range(): [number, number] {
    const [from, to] = [Number(this.from.value), Number(this.to.value)];
    return [Math.min(from, to), Math.max(from, to)];
  }

  set range([from, to]: [number, number]) {
    this.from.value = String(from);
    this.to.value = String(to);
  }
}

function radians(input: HTMLInputElement): number {
  return (Number(input.value) * Math.PI) / 180;
}

function toggle(name: string, title: string, first: boolean, act: (on: boolean) => void): HTMLButtonElement {
  const made = button(name, title, first, () => {
    const on = made.getAttribute("aria-pressed") !== "true";
    made.setAttribute("aria-pressed", String(on));
    act(on);
  });
  return made;
}

function slider(label: string, least: number, most: number, step: number, value: number, act: () => void): HTMLInputElement {
  const made = element("input", { type: "range", min: String(least), max: String(most), step: String(step), "aria-label": label, title: label });
  made.value = String(value);
  made.addEventListener("input", act);
  return made;
}
