/** A "?" beside a word: what it means, and where to read on. The words are the glossary's, in the page. */

import { element } from "./dom";

interface Words {
  /** Where the manuals are; "" where there are none. */
  manual: string;
  words: Record<string, [text: string, page: string]>;
}

const known: Words = JSON.parse(document.getElementById("glossary")?.textContent ?? '{"manual": "", "words": {}}') as Words;

/** Null for a word that the glossary lacks. */
export function explain(word: string): HTMLElement | null {
  const asked = word.toLowerCase();
  const found = known.words[asked] ?? known.words[asked.replace(/s$/, "")];
  if (!found) return null;
  const link = known.manual ? [" ", element("a", { href: known.manual + found[1], target: "_blank" }, "Read on")] : [];
  return element("details", { class: "explain" },
    element("summary", { "aria-label": `what ${word} means` }, "?"), element("span", {}, found[0], ...link));
}

/** One is open at a time, and none after Escape or a click elsewhere. */
export function foldExplanations(): void {
  const close = (but: EventTarget | null): void => {
    for (const open of document.querySelectorAll<HTMLDetailsElement>(".explain[open]")) {
      if (!(but instanceof Node && open.contains(but))) open.open = false;
    }
  };
  document.addEventListener("click", (event) => close(event.target));
  document.addEventListener("keydown", (event) => event.key === "Escape" && close(null));
}
