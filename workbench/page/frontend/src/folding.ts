/** The text under the panes, which is there without this program: folded here, opened by links and for print. */

import { element } from "./dom";

/** Fold every section; on paper, where nothing can be opened, all are open. */
export function fold(more: HTMLElement): void {
  for (const section of sections(more)) section.open = false;
  more.classList.add("ready");
  document.addEventListener("click", (event) => follow(event));
  let folded: HTMLDetailsElement[] = [];
  window.addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll<HTMLDetailsElement>(".how, .more details")].filter((one) => !one.open);
    for (const one of folded) one.open = true;
  });
  window.addEventListener("afterprint", () => {
    for (const one of folded) one.open = false;
  });
}

/** Put the plots of each side into its section, and how many frames are beyond a limit beside its heading. */
export function addPlots(more: HTMLElement, side: string, said: string, plots: readonly HTMLElement[]): void {
  const place = [...more.querySelectorAll<HTMLElement>(".plots")].find((one) => one.dataset["side"] === side);
  place?.append(...plots);
  place?.closest("details")?.querySelector("summary")?.append(" ", element("small", {}, said));
}

function sections(more: HTMLElement): HTMLDetailsElement[] {
  return [...more.querySelectorAll<HTMLDetailsElement>(":scope > details")];
}

/** Open the section that a link leads to. */
function follow(event: MouseEvent): void {
  const link = event.target instanceof Element ? event.target.closest<HTMLAnchorElement>('a[href^="#"]') : null;
  const section = link && document.getElementById(decodeURIComponent(link.hash.slice(1)));
  const contents = document.querySelector<HTMLDetailsElement>(".contents details");
  if (contents && !(event.target instanceof Node && contents.contains(event.target) && !link)) contents.open = false;
  if (section instanceof HTMLDetailsElement) section.open = true;
}
