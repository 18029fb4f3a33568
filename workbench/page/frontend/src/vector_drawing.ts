/** Calls of a canvas turned into a few kinds of marks on a page, for files that keep them as vectors. */

import { type Drawing, type Line, TracedPath } from "./drawing";

export const FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif";

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** Red, green, blue from 0 to 255, and opacity from 0 to 1. */
export type Colour = [red: number, green: number, blue: number, alpha: number];

export interface LineStyle {
  colour: Colour;
  width: number;
  dash: readonly number[];
}

export interface TextStyle {
  colour: Colour;
  size: number;
  bold: boolean;
  align: "start" | "middle" | "end";
  /** Of the line around letters; 0: letters are filled. */
  outline: number;
}

interface Kept extends Pick<Drawing, "fillStyle" | "strokeStyle" | "lineWidth" | "lineJoin" | "font" | "textAlign" | "textBaseline"> {
  dash: number[];
  at: { x: number; y: number; scale: number };
  clipped: Box | null;
  clips: number;
}

const CORNERS = 48;
/** From where a text is put down to the line that its letters stand on, in heights of the letters. */
const DOWN: Partial<Record<CanvasTextBaseline, number>> = { middle: 0.35, top: 0.8, bottom: -0.21 };

/** Moves and scalings are taken in here; what reaches the four methods below is in the units of the page. */
export abstract class VectorDrawing implements Drawing, Kept {
  fillStyle: string | CanvasGradient | CanvasPattern = "#000";
  strokeStyle: string | CanvasGradient | CanvasPattern = "#000";
  lineWidth = 1;
  lineJoin: CanvasLineJoin = "miter";
  font = "10px sans-serif";
  textAlign: CanvasTextAlign = "start";
  textBaseline: CanvasTextBaseline = "alphabetic";
  dash: number[] = [];
  at = { x: 0, y: 0, scale: 1 };
  clipped: Box | null = null;
  clips = 0;
  private readonly stack: Kept[] = [];
  private lines: Line[] = [];
  private box: Box | null = null;

  protected abstract putLines(lines: readonly Line[], style: LineStyle): void;
  protected abstract putBox(box: Box, colour: Colour): void;
  protected abstract putText(text: string, x: number, y: number, style: TextStyle): void;
  protected abstract putImage(image: HTMLCanvasElement, box: Box): void;
  protected abstract beginClip(box: Box): void;
  protected abstract endClip(): void;

  save(): void {
    const { fillStyle, strokeStyle, lineWidth, lineJoin, font, textAlign, textBaseline, dash, at, clipped, clips } = this;
    this.stack.push({ fillStyle, strokeStyle, lineWidth, lineJoin, font, textAlign, textBaseline, dash, at, clipped, clips });
  }

  restore(): void {
    const kept = this.stack.pop();
    if (!kept) return;
    for (let open = this.clips; open > kept.clips; open -= 1) this.endClip();
    Object.assign(this, kept);
  }

  translate(x: number, y: number): void {
    this.at = { ...this.at, ...this.placed(x, y) };
  }

  /** Scales along both axes alike; no mark needs more. */
  scale(by: number): void {
    this.at = { ...this.at, scale: this.at.scale * by };
  }

  beginPath(): void {
    this.lines = [];
    this.box = null;
  }

  moveTo(x: number, y: number): void {
    this.lines.push([this.point(x, y)]);
  }

  lineTo(x: number, y: number): void {
    this.lines[this.lines.length - 1]?.push(this.point(x, y));
  }

  arc(x: number, y: number, radius: number, from: number, to: number): void {
    this.lines.push(Array.from({ length: CORNERS + 1 }, (_, k) => {
      const angle = from + ((to - from) * k) / CORNERS;
      return this.point(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
    }));
  }

  rect(x: number, y: number, width: number, height: number): void {
    this.box = this.boxed(x, y, width, height);
  }

  clip(): void {
    if (!this.box) return;
    this.clipped = this.box;
    this.clips += 1;
    this.beginClip(this.box);
  }

  stroke(path?: Path2D): void {
    const lines = path instanceof TracedPath ? path.lines.map((line) => line.map(([x, y]) => this.point(x, y))) : this.lines;
    const { scale } = this.at;
    const width = this.lineWidth * scale;
    const shown = lines.filter((line) => line.length > 1 && this.isInView(line, width));
    if (!shown.length) return;
    this.putLines(shown, { colour: colourOf(this.strokeStyle), width, dash: this.dash.map((one) => one * scale) });
  }

  setLineDash(dash: number[]): void {
    this.dash = dash;
  }

  fillRect(x: number, y: number, width: number, height: number): void {
    this.putBox(this.boxed(x, y, width, height), colourOf(this.fillStyle));
  }

  fillText(text: string, x: number, y: number): void {
    this.writeText(text, x, y, this.fillStyle, 0);
  }

  strokeText(text: string, x: number, y: number): void {
    this.writeText(text, x, y, this.strokeStyle, this.lineWidth * this.at.scale);
  }

  drawImage(image: HTMLCanvasElement, x: number, y: number, width: number, height: number): void {
    this.putImage(image, this.boxed(x, y, width, height));
  }

  private writeText(text: string, x: number, y: number, style: Kept["fillStyle"], outline: number): void {
    const size = Number(/([\d.]+)px/.exec(this.font)?.[1] ?? 10) * this.at.scale;
    const placed = this.placed(x, y);
    const align = ({ center: "middle", right: "end", end: "end" } as const)[this.textAlign as string] ?? "start";
    const bold = /\b(bold|[6-9]00)\b/.test(this.font);
    const down = DOWN[this.textBaseline] ?? 0;
    this.putText(text, placed.x, placed.y + down * size, { colour: colourOf(style), size, bold, align, outline });
  }

  private placed(x: number, y: number): { x: number; y: number } {
    return { x: this.at.x + x * this.at.scale, y: this.at.y + y * this.at.scale };
  }

  private point(x: number, y: number): [number, number] {
    const placed = this.placed(x, y);
    return [placed.x, placed.y];
  }

  private boxed(x: number, y: number, width: number, height: number): Box {
    return { ...this.placed(x, y), width: width * this.at.scale, height: height * this.at.scale };
  }

  /** Lines beside the view would be cut off by whoever shows the file, but they would be in it. */
  private isInView(line: Line, spare: number): boolean {
    if (!this.clipped) return true;
    const { x, y, width, height } = this.clipped;
    const [xs, ys] = [line.map(([one]) => one), line.map(([, one]) => one)];
    const meets = (values: number[], from: number, to: number): boolean =>
      values.some((value) => value >= from - spare) && values.some((value) => value <= to + spare);
    return meets(xs, x, x + width) && meets(ys, y, y + height);
  }
}

/** "#123", "#112233" or "rgba(1, 2, 3, 0.4)" as numbers; nothing else is drawn with. */
function colourOf(style: Kept["fillStyle"]): Colour {
  const text = String(style);
  if (text.startsWith("#")) {
    const digits = text.length < 7 ? [...text.slice(1)].map((one) => one + one) : (text.slice(1).match(/../g) ?? []);
    const [red = 0, green = 0, blue = 0] = digits.map((one) => parseInt(one, 16));
    return [red, green, blue, 1];
  }
  const [red = 0, green = 0, blue = 0, alpha = 1] = (text.match(/[\d.]+/g) ?? []).map(Number);
  return [red, green, blue, alpha];
}

/** How wide a text is, in the units of its `size`. */
export function textWidth(text: string, size: number, bold: boolean): number {
  const drawing = document.createElement("canvas").getContext("2d");
  if (!drawing) return 0.5 * size * text.length;
  drawing.font = `${bold ? "bold " : ""}100px ${FONT}`;
  return (drawing.measureText(text).width * size) / 100;
}
