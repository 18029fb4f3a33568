/** Save the view: ask for the kind of file, its size, its fineness and its caption; then write it. */

import { captionOf } from "./caption";
import { button, download, element, select } from "./dom";
import { drawFigure, layOut, widthOf } from "./figure";
import { PdfFile } from "./pdf_file";
import { described } from "./png_file";
import type { State } from "./state";
import type { Subject } from "./subject";
import { SvgFile } from "./svg_file";

const FORMATS = ["PNG", "SVG", "PDF"] as const;
type Format = (typeof FORMATS)[number];
/** Along a side, and in all: what browsers can hold as one picture. */
const MOST_SIDE_PX = 10_000;
const MOST_PX = 50_000_000;

interface Wanted {
  format: Format;
  width_mm: number;
  dpi: number;
  caption: string;
}

/** What was asked for last, for the next time. */
const last = { format: "PNG" as Format, width_mm: 180, dpi: 300 };

export function askToSave(subjects: readonly Subject[], state: State): void {
  const dialog = element("dialog", { class: "save", "aria-label": "save the view" });
  const number = (label: string, value: number, least: number, most: number): HTMLInputElement => {
    const made = element("input", { type: "number", min: String(least), max: String(most), step: "1", "aria-label": label });
    made.value = String(value);
    made.addEventListener("input", () => check());
    return made;
  };
  const formats = select("kind of file", FORMATS.map((one) => [one, one] as const), last.format, () => check());
  const width = number("width in mm", last.width_mm, 20, 1000);
  const dpi = number("dots per inch", last.dpi, 50, 2400);
  const caption = element("textarea", { rows: "7", "aria-label": "caption" });
  const said = element("p", { class: "said", "aria-live": "polite" });
  const save = button("save", "write the file", null, () => void write());
  let edited = false;
  caption.addEventListener("input", () => {
    edited = true;
    check();
  });
  const wanted = (): Wanted => ({ format: formats.value as Format, width_mm: Number(width.value), dpi: Number(dpi.value), caption: caption.value });
  const check = (): void => {
    const { width_mm, dpi: dots } = wanted();
    const isKnown = width.validity.valid && dpi.validity.valid && width_mm > 0 && dots > 0;
    if (isKnown && !edited) caption.value = captionOf(subjects, state, paperOf(subjects, width_mm));
    const size = isKnown ? sizeOf(subjects, state, wanted()) : null;
    const fits = size !== null && Math.max(size.width, size.height) <= MOST_SIDE_PX && size.width * size.height <= MOST_PX;
    save.disabled = !fits;
    said.textContent = size === null ? "Width from 20 to 1000 mm, 50 to 2400 dots per inch."
      : `${width_mm} × ${Math.round((size.height / dots) * 25.4)} mm, ${size.width} × ${size.height} pixels${fits ? "" : ": too many, choose fewer dots per inch"}`;
  };
  const write = async (): Promise<void> => {
    save.disabled = true;
    let tiles = 0;
    const told = (): void => {
      tiles += 1;
      said.textContent = `${tiles} tiles fetched`;
    };
    try {
      const asked = wanted();
      Object.assign(last, { format: asked.format, width_mm: asked.width_mm, dpi: asked.dpi });
      download(await fileOf(subjects, state, asked, told), `${state.description.title.replace(/[^\w-]+/g, "-")}.${asked.format.toLowerCase()}`);
      dialog.close();
    } catch (error) {
      check();
      said.textContent = `Not saved: ${error instanceof Error ? error.message : String(error)}`;
    }
  };
  dialog.append(
    element("h2", {}, "Save the view"),
    element("div", { class: "fields" }, element("label", {}, "as ", formats), element("label", {}, "width ", width, " mm"), element("label", {}, dpi, " dots per inch")),
    element("label", {}, "Caption", caption), said,
    element("footer", {}, save, button("cancel", "close without a file", null, () => dialog.close())),
  );
  dialog.addEventListener("keydown", (event) => event.stopPropagation()); // keys are for its fields, not for the panes
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  check();
  dialog.showModal();
}

/** The figure as a file; `told` hears of every tile that was fetched for it. */
async function fileOf(subjects: readonly Subject[], state: State, wanted: Wanted, told: () => void): Promise<Blob> {
  const { ratio, width, height } = sizeOf(subjects, state, wanted);
  const figure = layOut(subjects, state, wanted.caption, ratio);
  const pictures: HTMLCanvasElement[] = [];
  for (const { subject } of figure.plates) pictures.push(await subject.picture(ratio, told));
  const about = { title: state.description.title, caption: wanted.caption };
  if (wanted.format === "PNG") {
    const canvas = element("canvas");
    [canvas.width, canvas.height] = [width, height];
    const drawing = canvas.getContext("2d");
    if (!drawing) throw new Error("no picture can be drawn here");
    drawing.scale(ratio, ratio);
    drawFigure(drawing, figure, pictures, state);
    const png = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/png"));
    if (!png) throw new Error("the picture is too large for this browser");
    return described(png, wanted.dpi, wanted.caption);
  }
  const file = new (wanted.format === "SVG" ? SvgFile : PdfFile)(figure.width, figure.height, wanted.width_mm);
  drawFigure(file, figure, pictures, state);
  return file.blob(about);
}

/** Pixels of the figure, and how many of them a CSS pixel has. */
function sizeOf(subjects: readonly Subject[], state: State, { dpi, width_mm, caption }: Wanted): { ratio: number; width: number; height: number } {
  const figure = layOut(subjects, state, caption, 1);
  const width = Math.round((width_mm / 25.4) * dpi);
  const ratio = width / figure.width;
  return { ratio, width, height: Math.ceil(figure.height * ratio) };
}

/** mm of paper for a mm of wall. */
function paperOf(subjects: readonly Subject[], width_mm: number): number {
  const mm_per_px = subjects.find((one) => one.view)?.view?.mm_per_px ?? 1;
  return width_mm / (widthOf(subjects) * mm_per_px);
}
