/** What marks and figures are drawn on: a canvas, or a file of vectors that takes the same calls. */

export interface Drawing {
  fillStyle: string | CanvasGradient | CanvasPattern;
  strokeStyle: string | CanvasGradient | CanvasPattern;
  lineWidth: number;
  lineJoin: CanvasLineJoin;
  font: string;
  textAlign: CanvasTextAlign;
  textBaseline: CanvasTextBaseline;
  save(): void;
  restore(): void;
  translate(x: number, y: number): void;
  scale(x: number, y: number): void;
  beginPath(): void;
  moveTo(x: number, y: number): void;
  lineTo(x: number, y: number): void;
  arc(x: number, y: number, radius: number, from: number, to: number): void;
  rect(x: number, y: number, width: number, height: number): void;
  clip(): void;
  stroke(): void;
  stroke(path: Path2D): void;
  setLineDash(dash: number[]): void;
  fillRect(x: number, y: number, width: number, height: number): void;
  fillText(text: string, x: number, y: number): void;
  strokeText(text: string, x: number, y: number): void;
  drawImage(image: HTMLCanvasElement, x: number, y: number, width: number, height: number): void;
}

export type Line = [x: number, y: number][];

/** A path of straight lines that can be read again, which a browser's own cannot. */
export class TracedPath extends Path2D {
  readonly lines: Line[] = [];

  override moveTo(x: number, y: number): void {
    super.moveTo(x, y);
    this.lines.push([[x, y]]);
  }

  override lineTo(x: number, y: number): void {
    super.lineTo(x, y);
    this.lines[this.lines.length - 1]?.push([x, y]);
  }
}
