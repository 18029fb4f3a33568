/** What to do next, as the heading lists it: its buttons open the page's tools, or copy a command line. */

import { element } from "./dom";

export interface Tools {
  /** Mark a place along the bore, and bring it into view. */
  show(z_mm: number): void;
  landmarks(): void;
  /** List the cells that are not counted, and ring them on the panes. */
  uncounted(): void;
  /** Draw the cells of a side; null where nothing can be saved. */
  draw: ((side: string) => void) | null;
}

export function followSteps(top: HTMLElement, tools: Tools): void {
  top.querySelector(".uncounted button")?.addEventListener("click", () => tools.uncounted());
  for (const step of top.querySelectorAll<HTMLElement>(".next li")) {
    const { does, side = "", zMm } = step.dataset;
    const act = step.querySelector<HTMLButtonElement>("button.act");
    const acts: Record<string, (() => void) | null> = {
      show: () => tools.show(Number(zMm)), landmarks: () => tools.landmarks(), draw: tools.draw && ((): void => tools.draw?.(side)),
    };
    const does_ = acts[does ?? ""];
    if (act && does_) act.addEventListener("click", does_);
    else act?.replaceWith(element("span", {}, act.textContent, " (where the page is served)"));
    const copy = step.querySelector<HTMLButtonElement>("button.copy");
    copy?.addEventListener("click", () => void navigator.clipboard.writeText(step.querySelector("code")?.textContent ?? ""));
  }
}
