/** The colour bar of a layer: its unit, its contrast and its colours, which can be changed there. */

import { COLOUR_MAPS } from "./colour_maps";
import { colourAt, firstColouring } from "./colouring";
import { button, element, select } from "./dom";
import type { State } from "./state";

export function colourBar(state: State, key: string): HTMLElement {
  const layer = state.layer(key);
  if (layer.kind === "classes") {
    const items = layer.classes.map((one) => {
      const swatch = element("i");
      swatch.style.background = one.colour;
      return element("span", { class: "class" }, swatch, one.label);
    });
    return element("div", { class: "bar classes", title: layer.title }, ...items);
  }
  const colouring = state.colouring(key);
  const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.max(layer.high - layer.low, 1e-9))));
  const limit = (name: string, of: "low" | "high"): HTMLInputElement => {
    const step = (layer.high - layer.low) / 100;
    const made = element("input", { type: "number", step: step.toPrecision(1), "aria-label": `${name} of ${layer.title}` });
    made.value = colouring[of].toFixed(digits);
    made.addEventListener("change", () => {
      const value = Number(made.value);
      if (!Number.isFinite(value) || made.value === "") return;
      state.colourings.set(key, { ...state.colouring(key), [of]: value });
      state.tell("colours");
    });
    return made;
  };
  const stops = Array.from({ length: 17 }, (_, k) => {
    const [red, green, blue] = colourAt(colouring.map, k / 16);
    return `rgb(${Math.round(255 * red)} ${Math.round(255 * green)} ${Math.round(255 * blue)})`;
  });
  const gradient = element("div", { class: "gradient", "aria-hidden": "true" });
  gradient.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  const maps = Object.keys(COLOUR_MAPS).map((name) => [name, name] as const);
  return element(
    "div",
    { class: "bar", title: layer.title },
    limit("least shown", "low"),
    gradient,
    limit("most shown", "high"),
    element("span", { class: "unit" }, layer.unit),
    select(`colours of ${layer.title}`, maps, colouring.map, (map) => {
      state.colourings.set(key, { ...state.colouring(key), map });
      state.tell("colours");
    }),
    button("↺", "contrast and colours as at first", null, () => {
      state.colourings.set(key, firstColouring(layer));
      state.tell("colours");
    }),
  );
}
