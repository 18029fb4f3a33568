/** In words, what a figure shows: short plain text, for people to edit. */

import type { Description } from "./description";
import type { State } from "./state";
import type { Subject } from "./subject";
import { type View, degrees } from "./wall";

/** The caption of a figure in which a millimetre of wall has `mm_per_mm` of paper. */
export function captionOf(subjects: readonly Subject[], state: State, mm_per_mm: number): string {
  const { description } = state;
  const places = [...new Set(subjects.flatMap(({ view }) => (view ? [place(view)] : [])))];
  const titles = subjects.map((subject) => subject.title).join("; ");
  const layers = [...new Set(subjects.flatMap((subject) => subject.layers))];
  const contrast = layers.map((key) => contrastOf(key, state)).filter((text) => text !== "");
  const outlined = description.outlines.filter((one) => state.outlines.has(one.layer)).map((one) => one.side);
  return [
    `${description.title}.`,
    description.verdict,
    `${subjects.length > 1 ? "From left to right: " : ""}${titles}.`,
    places.length ? `θ across, z down, which is inward; in the middle ${places.join("; ")}.` : "",
    places.length === 1 ? `A millimetre of wall has ${Number(mm_per_mm.toPrecision(3))} mm here.` : "",
    contrast.length ? `Shown are ${contrast.join("; ")}.` : "",
    outlined.length ? `Lines: outlines of the cells of ${outlined.join(" and ")}.` : "",
    "Hatched: not observed.",
    madeBy(description),
  ].filter((text) => text !== "").join(" ");
}

function place(view: View): string {
  return `θ ${degrees(view.theta_rad).toFixed(1)}°, z ${view.z_mm.toFixed(3)} mm`.replace("-", "−");
}

function contrastOf(key: string, state: State): string {
  const layer = state.layer(key);
  if (layer.kind === "classes") return "";
  const { low, high, map } = state.colouring(key);
  const limits = [low, high].map((value) => Number(value.toPrecision(3)).toString().replace("-", "−"));
  return `${layer.title} from ${limits.join(" to ")} ${layer.unit} (${map})`;
}

function madeBy(description: Description): string {
  return description.endoct ? `Made by endoct ${description.endoct}.` : "";
}
