/** Cells in a few words and signs, with the legend of these, and as rows of a file. */

import type { CellPart } from "./description";

export const number = (value: number | null, digits: number): string =>
  value === null ? "–" : value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "−");

/** What the other side has where a cell lies, and whether the truth has a cell there. */
export function brief(cell: CellPart): string {
  const partner = cell.partner === null ? "" : ` ${cell.partner} (${cell.overlap.toFixed(2)})`;
  const words = { matched: `=${partner}`, overlapping: `~${partner}`, alone: `only ${cell.side}`, "not observed": "not counted", "not aligned": "–" };
  return words[cell.state] + (cell.is_real === null ? "" : cell.is_real ? " ✓" : " ✗");
}

/** What signs mean, each with the cells that have it. */
export const LEGEND: readonly (readonly [text: string, of: (cell: CellPart) => boolean])[] = [
  ["= same cell there (overlap)", (cell) => cell.state === "matched"],
  ["~ overlaps by less than half", (cell) => cell.state === "overlapping"],
  ["not counted: less than half observed there", (cell) => cell.state === "not observed"],
  ["✓ ✗ the truth has a cell, has none", (cell) => cell.is_real !== null],
];

/** Columns of a file, those of cells.csv first. */
const COLUMNS = [
  "side", "id", "area_mm2", "z_mm", "theta_rad", "depth_median_mm", "depth_p95_mm", "volume_mm3", "depth_of", "contrast",
  "touches_edge", "observed_by_other", "covered", "seen_by", "partner", "overlap", "depth_error_mm", "own_depth_mm",
  "own_depth_error_mm", "state", "is_real",
] as const satisfies readonly (keyof CellPart)[];

/** Return the cells as CSV, a row each, as cells.csv has them, then what the other side and the truth have there. */
export function cellsAsCsv(cells: readonly CellPart[]): string {
  return csvOf(COLUMNS, cells.map((cell) => COLUMNS.map((name) => cell[name])));
}

export function csvOf(columns: readonly string[], rows: readonly (readonly (string | number | boolean | null)[])[]): string {
  return [columns.join(","), ...rows.map((row) => row.map(field).join(",")), ""].join("\r\n");
}

function field(value: string | number | boolean | null): string {
  if (value === null) return "";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (typeof value === "number") return String(Number(value.toPrecision(6)));
  const safe = /^[=+\-@\t\r]/.test(value) ? `'${value}` : value; // no spreadsheet takes a name for a formula
  return /[",\r\n]/.test(safe) ? `"${safe.replace(/"/g, '""')}"` : safe;
}
