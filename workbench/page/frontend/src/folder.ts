/** The table of a folder: sorted by a click on a heading, filtered by text and by kind. The rows are there already. */

const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll<HTMLTableCellElement>("thead th")];
const text = document.querySelector<HTMLInputElement>("input[type=search]");
const which = document.querySelector<HTMLSelectElement>("select");
const count = document.querySelector("[role=status]");

function key(row: HTMLTableRowElement, column: number): string {
  return row.cells[column]?.dataset["key"] ?? "";
}

/** Numbers by size, texts by their letters and the numbers in them; what is not known comes last, either way. */
function compare(one: string, other: string): number {
  const [a, b] = [Number(one), Number(other)];
  return Number.isNaN(a) || Number.isNaN(b) ? one.localeCompare(other, undefined, { numeric: true }) : a - b;
}

function sort(column: number): void {
  const down = heads[column]?.getAttribute("aria-sort") === "ascending";
  heads.forEach((head, k) => {
    if (head.hasAttribute("aria-sort")) head.setAttribute("aria-sort", k !== column ? "none" : down ? "descending" : "ascending");
  });
  const rows = [...(body?.rows ?? [])].map((row) => [key(row, column), row] as const);
  rows.sort(([one], [other]) => (one === "" || other === "" ? Number(one === "") - Number(other === "") : (down ? -1 : 1) * compare(one, other)));
  body?.append(...rows.map(([, row]) => row));
}

function filter(): void {
  const words = (text?.value ?? "").toLowerCase().split(/\s+/).filter(Boolean);
  const rows = [...(body?.rows ?? [])];
  for (const row of rows) {
    const said = row.textContent.toLowerCase();
    const wanted = which?.value ?? "";
    const isWanted = wanted === "" || row.dataset["kind"] === wanted || row.dataset["level"] === wanted;
    row.hidden = !isWanted || !words.every((word) => said.includes(word));
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
