/** The table of a folder: sorted by a click on a heading, filtered by text and by kind. The rows are there already. */

import { compareKeys, says, turn } from "./table_order";

const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll<HTMLTableCellElement>("thead th")];
const text = document.querySelector<HTMLInputElement>("input[type=search]");
const which = document.querySelector<HTMLSelectElement>("select");
const count = document.querySelector("[role=status]");

function key(row: HTMLTableRowElement, column: number): string {
  return row.cells[column]?.dataset["key"] ?? "";
}

function sort(column: number): void {
  const down = turn(heads, column);
  const rows = [...(body?.rows ?? [])].map((row) => [key(row, column), row] as const);
  rows.sort(([one], [other]) => compareKeys(one, other, down));
  body?.append(...rows.map(([, row]) => row));
}

function filter(): void {
  const rows = [...(body?.rows ?? [])];
  for (const row of rows) {
    const wanted = which?.value ?? "";
    const isWanted = wanted === "" || row.dataset["kind"] === wanted || row.dataset["level"] === wanted;
    row.hidden = !isWanted || !says(row.textContent, text?.value ?? "");
  }
  if (count) count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length}`;
}

heads.forEach((head, column) => head.querySelector("button")?.addEventListener("click", () => sort(column)));
text?.addEventListener("input", filter);
which?.addEventListener("change", filter);
body?.addEventListener("click", (event) => {
  const row = event.target instanceof Element && !event.target.closest("a") ? event.target.closest("tr") : null;
  if (!window.getSelection()?.toString()) row?.querySelector("a")?.click();
});
filter();
