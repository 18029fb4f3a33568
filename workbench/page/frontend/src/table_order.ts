/** Tables whose heads sort them, and whose rows are filtered by words. */

/** Numbers by size, texts by their letters and the numbers in them; what is not known comes last, either way. */
export function compareKeys(one: string, other: string, down: boolean): number {
  if (one === "" || other === "") return Number(one === "") - Number(other === "");
  const [a, b] = [Number(one), Number(other)];
  return (down ? -1 : 1) * (Number.isNaN(a) || Number.isNaN(b) ? one.localeCompare(other, undefined, { numeric: true }) : a - b);
}

/** Mark which of `heads` sorts now; return whether downwards: the other way, where it did so before. */
export function turn(heads: readonly HTMLElement[], column: number): boolean {
  const down = heads[column]?.getAttribute("aria-sort") === "ascending";
  heads.forEach((head, k) => {
    if (head.hasAttribute("aria-sort")) head.setAttribute("aria-sort", k !== column ? "none" : down ? "descending" : "ascending");
  });
  return down;
}

/** Whether a text has every one of the words that are wanted. */
export function says(text: string, wanted: string): boolean {
  const said = text.toLowerCase();
  return wanted.toLowerCase().split(/\s+/).every((word) => said.includes(word));
}
