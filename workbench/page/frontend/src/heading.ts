/** The top of the page: what it is, the verdict with its doubts, the figures. */

import type { Description, DoubtPart } from "./description";
import { element } from "./dom";

function said(part: DoubtPart): HTMLLIElement {
  return element("li", {}, part.side ? element("b", {}, `${part.side}: `) : null, part.what, " ",
    part.code ? element("code", {}, part.code) : null);
}

export function heading(description: Description): HTMLElement {
  const facts = description.facts.map(([name, value]) => element("span", {}, element("b", {}, name), ` ${value}`));
  const verdict = element("div", { class: `verdict ${description.level}`, role: "status" },
    element("strong", {}, description.headline));
  if (description.doubts.length) verdict.append(element("ul", {}, ...description.doubts.map(said)));
  if (description.sentences.length) {
    const more = description.sentences.map((sentence) => element("p", {}, sentence));
    verdict.append(description.level === "unaligned" ? element("div", {}, ...more)
      : element("details", {}, element("summary", {}, "How they lie"), ...more));
  }
  const figures = description.figures.map((figure) =>
    element("li", { title: figure.of }, element("span", {}, figure.title), element("b", {}, figure.value),
      element("small", {}, figure.of)));
  return element("header", { class: "top" },
    element("div", { class: "what" }, element("h1", {}, description.title), element("p", { class: "facts" }, ...facts)),
    element("ul", { class: "figures" }, ...figures),
    verdict);
}

export function details(description: Description, quality: HTMLElement[]): HTMLElement {
  const parts: HTMLElement[] = description.details.map((part) => {
    const body = element("div", { class: "body" });
    body.innerHTML = part.html; // made by us, every text in it escaped there
    return element("details", {}, element("summary", {}, part.title), body);
  });
  if (description.notes.length) {
    const notes = element("ul", {}, ...description.notes.map(said));
    parts.unshift(element("details", {}, element("summary", {}, `Notes (${description.notes.length})`), notes));
  }
  parts.unshift(...quality);
  const by = description.endoct ? `Made by endoct ${description.endoct}. ` : "";
  return element("section", { class: "more", "aria-label": "details" }, ...parts,
    element("footer", {}, `${by}Research software and no medical device.`));
}
