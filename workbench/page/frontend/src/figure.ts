/** The view as a figure: panes as they lie on the screen, with titles, marks, colour bars and a caption, on white. */

import { AXES_PX } from "./axes";
import type { Drawing } from "./drawing";
import { barHeight, drawBar } from "./figure_bar";
import type { State } from "./state";
import type { Subject } from "./subject";
import { FONT, textWidth } from "./vector_drawing";

const MARGIN_PX = 10;
const GAP_PX = 10;
const TITLE = { size: 12, line: 15 };
const CAPTION = { size: 11, line: 14.5 };

/** A subject in the figure: `y` of its title, of its picture and of its colour bars. */
interface Plate {
  subject: Subject;
  x: number;
  titleY: number;
  y: number;
  barsY: number;
  title: string[];
}

export interface Figure {
  width: number;
  height: number;
  plates: readonly Plate[];
  caption: readonly string[];
  captionY: number;
}

/** Lay the figure out, in CSS pixels of which `ratio` are one of the picture: pictures begin on whole ones of these. */
export function layOut(subjects: readonly Subject[], state: State, caption: string, ratio: number): Figure {
  const whole = (value: number): number => Math.round(value * ratio) / ratio;
  const left = Math.min(...subjects.map((one) => one.left));
  const width = widthOf(subjects);
  const rows = [...new Set(subjects.map((one) => Math.round(one.top)))].sort((a, b) => a - b);
  const plates: Plate[] = [];
  let y = MARGIN_PX;
  for (const row of rows) {
    const own = alike(subjects.filter((one) => Math.round(one.top) === row));
    const titles = own.map((one) => wrap(one.title, one.width, TITLE.size, true));
    const below = y + Math.max(...titles.map((title) => title.length)) * TITLE.line + 3 + AXES_PX.top;
    own.forEach((subject, k) => {
      const [x, title] = [whole(subject.left - left + MARGIN_PX + AXES_PX.left), titles[k] ?? []];
      plates.push({ subject, x, titleY: y, y: whole(below), barsY: below + subject.height + 6, title });
    });
    y = below + Math.max(...own.map((one) => one.height + barsHeight(one, state))) + 6 + GAP_PX;
  }
  const lines = wrap(caption, width - 2 * MARGIN_PX, CAPTION.size, false);
  return { width, height: Math.ceil(y + lines.length * CAPTION.line + MARGIN_PX), plates, caption: lines, captionY: y };
}

/** How wide a figure is, with its margins. */
export function widthOf(subjects: readonly Subject[]): number {
  const left = Math.min(...subjects.map((one) => one.left));
  return Math.max(...subjects.map((one) => one.left + one.width)) - left + 2 * MARGIN_PX + AXES_PX.left;
}

/** Subjects beside each other, as high as the lowest of them, so that a place is as high in all panes. */
function alike(subjects: readonly Subject[]): Subject[] {
  const height = Math.min(...subjects.map((one) => one.height));
  return subjects.map((one) => one.withHeight(height));
}

function barsHeight({ layers, width }: Subject, state: State): number {
  return layers.reduce((sum, key) => sum + barHeight(state, key, width), 0);
}

/** Draw the figure, with the `pictures` of its subjects in their order. */
export function drawFigure(drawing: Drawing, figure: Figure, pictures: readonly HTMLCanvasElement[], state: State): void {
  drawing.fillStyle = "#ffffff";
  drawing.fillRect(0, 0, figure.width, figure.height);
  figure.plates.forEach((plate, k) => {
    const { subject, x, y } = plate;
    const { width, height } = subject;
    const picture = pictures[k];
    drawText(drawing, plate.title, x, plate.titleY, TITLE, true);
    if (picture) drawing.drawImage(picture, x, y, width, height);
    drawing.save();
    drawing.beginPath();
    drawing.rect(x, y, width, height);
    drawing.clip();
    drawing.translate(x, y);
    subject.marks(drawing);
    drawing.restore();
    drawing.save();
    drawing.translate(x, y);
    subject.axes(drawing);
    drawing.restore();
    let at = plate.barsY;
    for (const key of subject.layers) {
      drawBar(drawing, state, key, x, at, width);
      at += barHeight(state, key, width);
    }
  });
  drawText(drawing, figure.caption, MARGIN_PX, figure.captionY, CAPTION, false);
}

function drawText(drawing: Drawing, lines: readonly string[], x: number, y: number, { size, line }: typeof TITLE, bold: boolean): void {
  drawing.fillStyle = "#111";
  drawing.font = `${bold ? "bold " : ""}${size}px ${FONT}`;
  drawing.textAlign = "left";
  drawing.textBaseline = "top";
  lines.forEach((text, k) => drawing.fillText(text, x, y + k * line));
}

/** The text in lines no wider than `width`; a word that is longer is cut. */
export function wrap(text: string, width: number, size: number, bold: boolean): string[] {
  const fits = (line: string): boolean => textWidth(line, size, bold) <= width;
  return text.split("\n").flatMap((paragraph) => {
    const lines: string[] = [];
    let line = "";
    for (const word of paragraph.split(/\s+/)) {
      if (line && fits(`${line} ${word}`)) {
        line = `${line} ${word}`;
        continue;
      }
      if (line) lines.push(line);
      line = "";
      for (const letter of word) {
        if (line && !fits(line + letter)) {
          lines.push(line);
          line = "";
        }
        line += letter;
      }
    }
    return [...lines, line];
  });
}
