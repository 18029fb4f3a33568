/** The results of a study: sorted, filtered, grouped, noted on, and summarised. */

import { message, post, type Result } from "./desk_server";
import { button, element, pathText, select } from "./dom";
import { explain } from "./explain";
import { compareKeys, says, turn } from "./table_order";

const LEVELS = { trusted: "trusted", uncertain: "uncertain", doubted: "doubted", unaligned: "not aligned" };
const GROUPS = { "": "no groups", bore: "by bore", folder: "by folder" };

/** What a column is called and sorted by; "" where it is not. */
const COLUMNS: readonly [title: string, key: ((entry: Result) => string) | null][] = [
  ["picture", null],
  ["name", (entry) => entry.name],
  ["verdict", (entry) => (entry.level ? String(Object.keys(LEVELS).indexOf(entry.level)) : "")],
  ["Jaccard index", (entry) => (entry.jaccard === null ? "" : String(entry.jaccard))],
  ["doubts", (entry) => String(entry.doubts.length)],
  ["written", (entry) => entry.written],
  ["note", (entry) => entry.note],
];

export function levelOf(entry: Result): string {
  return entry.level ? LEVELS[entry.level] : "";
}

export class ResultsTable {
  readonly element: HTMLElement;
  private readonly body = element("tbody");
  private readonly heads: HTMLElement[];
  private readonly text = element("input", { type: "search", placeholder: "filter by any text", "aria-label": "filter by any text" });
  private readonly count = element("small", { role: "status" });
  private readonly fault = element("p", { class: "fault", role: "alert" });
  private entries: Result[] = [];
  private level = "";
  private group: keyof typeof GROUPS = "";
  private column = 1;
  private down = false;

  /** `summarise` is asked for with the names of the comparisons that are shown; `steps` are what can be done about a result. */
  constructor(summarise: (names: string[]) => void, private readonly steps: (entry: Result) => HTMLElement[], private readonly lookAgain: () => void) {
    this.heads = COLUMNS.map(([title, key], column) => key
      ? element("th", { scope: "col", "aria-sort": column === 1 ? "ascending" : "none" }, button(title, `sort by ${title}`, null, () => this.sort(column)), explain(title))
      : element("th", { scope: "col" }, title, explain(title)));
    const levels = [["", "any verdict"], ...Object.entries(LEVELS)] as [string, string][];
    this.text.addEventListener("input", () => this.draw());
    this.element = element("section", { class: "card" },
      element("h2", {}, "Results", this.count,
        button("summarise…", "medians, plots and a supplement of the comparisons that are shown", null, () => summarise(this.shown().filter((entry) => entry.kind === "comparison" && !entry.fault).map((entry) => entry.name)))),
      element("p", { class: "line", role: "search" }, this.text,
        select("which verdict", levels, "", (value) => { this.level = value; this.draw(); }),
        select("groups", Object.entries(GROUPS), "", (value) => { this.group = value as keyof typeof GROUPS; this.draw(); })),
      this.fault,
      element("table", { class: "results" }, element("thead", {}, element("tr", {}, ...this.heads)), this.body));
  }

  show(entries: readonly Result[]): void {
    this.entries = entries.filter((entry) => entry.kind !== "specimen");
    this.draw();
  }

  private sort(column: number): void {
    this.down = turn(this.heads, column);
    this.column = column;
    this.draw();
  }

  /** What is shown, in its order. */
  private shown(): Result[] {
    const key = COLUMNS[this.column]?.[1] ?? ((): string => "");
    const wanted = this.entries.filter((entry) => (this.level === "" || entry.level === this.level) && says(textOf(entry), this.text.value));
    const sorted = wanted.sort((one, other) => compareKeys(key(one), key(other), this.down));
    return this.group ? sorted.sort((one, other) => groupOf(one, this.group).localeCompare(groupOf(other, this.group), undefined, { numeric: true })) : sorted;
  }

  private draw(): void {
    const shown = this.shown();
    const all = this.entries.length;
    this.count.textContent = shown.length === all ? String(all || "") : `${shown.length} of ${all}`;
    const rows: HTMLElement[] = [];
    let before: string | null = null;
    for (const entry of shown) {
      const group = this.group ? groupOf(entry, this.group) : "";
      if (this.group && group !== before) rows.push(element("tr", { class: "group" }, element("th", { scope: "colgroup", colspan: String(COLUMNS.length) }, group || "others")));
      before = group;
      rows.push(this.row(entry));
    }
    const none = all ? "None is so. Clear the filter." : "None yet. Unroll a recording, or compare two.";
    this.body.replaceChildren(...(rows.length ? rows : [element("tr", {}, element("td", { colspan: String(COLUMNS.length) }, element("small", {}, none)))]));
  }

  private row(entry: Result): HTMLElement {
    const interval = entry.interval ? ` (${entry.interval.map((end) => end.toFixed(2)).join("–")})` : "";
    const link = entry.kind === "summary" ? { href: entry.address, target: "_blank" } : { href: entry.address };
    return element("tr", { "data-name": entry.name },
      element("td", {}, ...(entry.thumbnail ? [element("img", { src: entry.thumbnail, loading: "lazy", alt: "" })] : [])),
      element("td", {}, entry.address ? element("a", link, ...pathText(entry.name)) : element("span", {}, ...pathText(entry.name)), " ", element("small", {}, `${entry.kind === "summary" ? "summary " : ""}${entry.about}`)),
      element("td", {}, entry.fault ? element("span", { class: "fault" }, entry.fault)
        : element("span", {}, element("span", { class: `level ${entry.level ?? ""}` }, levelOf(entry)), element("small", {}, ` ${entry.headline}`), ...entry.doubts.slice(0, 1).map((doubt) => element("small", { class: "doubt" }, doubt))), ...this.steps(entry)),
      element("td", {}, entry.jaccard === null ? "" : entry.jaccard.toFixed(2), interval),
      element("td", { title: entry.doubts.join("\n") }, entry.doubts.length ? String(entry.doubts.length) : ""),
      element("td", {}, entry.written),
      element("td", {}, entry.fault ? "" : button(entry.note || "note…", "what you note on it, kept beside it", null, () => this.note(entry))));
  }

  private note(entry: Result): void {
    const text = element("textarea", { rows: "6", "aria-label": "note" });
    const fault = element("p", { class: "fault", role: "alert" });
    const save = element("button", { type: "submit", class: "chief" }, "Save");
    const body = element("form", { method: "dialog" }, element("h2", {}, `Note on ${entry.name}`), text, fault,
      element("div", { class: "line buttons" }, save, button("Close", "leave it as it was", null, () => dialog.close())));
    const dialog = element("dialog", { class: "note", "aria-label": `note on ${entry.name}` }, body);
    text.value = entry.note;
    body.addEventListener("submit", (event) => {
      event.preventDefault();
      post("note", { name: entry.name, text: text.value, was: entry.note }).then(
        () => {
          dialog.close();
          this.lookAgain(); // what is listed may be another by now
        },
        (error: unknown) => (fault.textContent = message(error)),
      );
    });
    dialog.addEventListener("close", () => dialog.remove());
    document.body.append(dialog);
    dialog.showModal();
  }
}

function textOf(entry: Result): string {
  return [entry.name, entry.kind, entry.about, levelOf(entry), entry.headline, ...entry.doubts, entry.fault, entry.note, ...entry.of].join(" ");
}

/** The folder of the first recording that was compared, or that of the result. */
function groupOf(entry: Result, by: string): string {
  const name = by === "bore" ? (entry.of[0] ?? "") : entry.name;
  return name.slice(0, Math.max(0, name.lastIndexOf("/")));
}
