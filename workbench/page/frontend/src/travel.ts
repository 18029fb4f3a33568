/** Which way the instrument moved: a bore with its mouth on the left, an arrow, and where the frame in view lies. */

import { element } from "./dom";
import { explain } from "./explain";

const SAID: Readonly<Record<string, string>> = {
  in: "the first frame lies nearest the mouth, the last one deepest",
  out: "the first frame lies deepest, the last one nearest the mouth",
  unknown: "either end may be up; a comparison tries both",
};
const [LEFT, RIGHT] = [52, 268];

/** `travel`: in, out or unknown; `by`: who says so; `share`: which frame is in view, from 0 to 1. */
export function travelFigure(travel: string, by: string, share: number): HTMLElement {
  const way = { in: 1, out: -1 }[travel] ?? 0;
  const at = LEFT + (RIGHT - LEFT) * (way < 0 ? 1 - share : share);
  const heads = [...(way >= 0 ? [`M${RIGHT} 20 l-9 -5 v10 z`] : []), ...(way <= 0 ? [`M${LEFT} 20 l9 -5 v10 z`] : [])];
  const figure = svg("svg", { viewBox: "0 0 320 44", role: "img", "aria-label": `travel: ${travel}` },
    svg("path", { d: "M40 6 H280 M40 34 H280 M280 6 q8 14 0 28", class: "bore" }),
    svg("path", { d: `M${LEFT} 20 H${RIGHT}`, class: way ? "way" : "way open" }), svg("path", { d: heads.join(" "), class: "head" }),
    ...(way ? [svg("circle", { cx: String(at), cy: "20", r: "5", class: "frame" })] : []),
    label("36", "end", "mouth"), label("290", "start", "end"));
  return element("figure", { class: "travel" }, figure,
    element("figcaption", {}, element("b", {}, `travel: ${travel}`), explain("travel"), ` ${by} ${SAID[travel] ?? ""}`));
}

function svg(tag: string, attributes: Readonly<Record<string, string>>, ...children: Node[]): SVGElement {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function label(x: string, anchor: string, text: string): SVGElement {
  return svg("text", { x, y: "24", "text-anchor": anchor }, document.createTextNode(text));
}
