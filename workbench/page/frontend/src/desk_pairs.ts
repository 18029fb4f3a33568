/** Pairs of recordings of one bore: which are to be compared. At first those without a result, or changed since. */

import type { Result } from "./desk_server";
import { button, element } from "./dom";
import { levelOf } from "./desk_results";

export type Pair = [endoscope: string, oct: string];

export class PairsPanel {
  readonly element = element("div", { class: "pairs" });
  private readonly chosen = new Map<string, boolean>();

  /** `compare` is asked for with the pairs that were chosen. */
  constructor(private readonly compare: (pairs: Pair[]) => void) {}

  /** Show `pairs`; one alone is compared from its row. */
  show(pairs: readonly Pair[], entries: readonly Result[]): void {
    if (pairs.length < 2) {
      this.element.replaceChildren();
      return;
    }
    const focused = this.element.contains(document.activeElement) ? document.activeElement?.getAttribute("value") : null;
    const isChosen = (pair: Pair): boolean => this.chosen.get(pair.join("\n")) ?? isDue(pair, entries);
    const chosen = pairs.filter(isChosen);
    const run = button(`compare ${chosen.length} of ${pairs.length} pairs`, "queue a comparison of every pair that is ticked", null, () => {
      this.chosen.clear(); // what is queued now will have a result
      this.compare(chosen);
    });
    run.disabled = !chosen.length;
    const all = (value: boolean): void => {
      for (const pair of pairs) this.chosen.set(pair.join("\n"), value);
      this.show(pairs, entries);
    };
    const isOpen = this.element.querySelector("details")?.open ?? false;
    const details = element("details", {}, element("summary", {}, "choose pairs"),
      element("div", { class: "line" }, button("all", "tick every pair", null, () => all(true)), button("none", "tick no pair", null, () => all(false))),
      element("ul", {}, ...pairs.map((pair) => {
        const box = element("input", { type: "checkbox", value: pair.join("\n") });
        box.checked = isChosen(pair);
        box.addEventListener("change", () => {
          this.chosen.set(pair.join("\n"), box.checked);
          this.show(pairs, entries);
        });
        return element("li", {}, element("label", {}, box, pair.join(" and "), element("small", {}, stateOf(pair, entries))));
      })));
    details.open = isOpen;
    this.element.replaceChildren(run, details);
    if (focused) [...this.element.querySelectorAll<HTMLInputElement>("input")].find((box) => box.value === focused)?.focus();
  }
}

/** Results of a pair, the latest last. */
function resultsOf(pair: Pair, entries: readonly Result[]): Result[] {
  const found = entries.filter((entry) => !entry.fault && entry.kind === "comparison" && pair.every((name) => entry.of.includes(name)));
  return found.sort((one, other) => one.written.localeCompare(other.written));
}

function isDue(pair: Pair, entries: readonly Result[]): boolean {
  return resultsOf(pair, entries).every((entry) => entry.changed);
}

function stateOf(pair: Pair, entries: readonly Result[]): string {
  const last = resultsOf(pair, entries).pop();
  if (!last) return "no result";
  const found = `${levelOf(last)}${last.jaccard === null ? "" : ` ${last.jaccard.toFixed(2)}`}`;
  return isDue(pair, entries) ? `${found}; a recording was changed since` : found;
}
