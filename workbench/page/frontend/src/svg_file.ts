/** A figure as SVG: layers as pictures, everything else as lines and texts. */

import type { Line } from "./drawing";
import { type Box, type Colour, FONT, type LineStyle, type TextStyle, VectorDrawing } from "./vector_drawing";

export interface About {
  title: string;
  caption: string;
}

export class SvgFile extends VectorDrawing {
  private readonly parts: string[] = [];
  private names = 0;

  constructor(private readonly width: number, private readonly height: number, private readonly width_mm: number) {
    super();
  }

  blob(about: About): Blob {
    const { width, height, width_mm } = this;
    const head =
      `<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" ` +
      `xmlns:xlink="http://www.w3.org/1999/xlink" width="${short(width_mm)}mm" height="${short((width_mm * height) / width)}mm" ` +
      `viewBox="0 0 ${short(width)} ${short(height)}" font-family="${escaped(FONT)}">\n`;
    const said = `<title>${escaped(about.title)}</title>\n<desc>${escaped(about.caption)}</desc>\n`;
    return new Blob([head, said, ...this.parts, "</svg>\n"], { type: "image/svg+xml" });
  }

  protected putLines(lines: readonly Line[], { colour, width, dash }: LineStyle): void {
    const path = lines.map((line) => `M${line.map(([x, y]) => `${short(x)} ${short(y)}`).join("L")}`).join("");
    const dashed = dash.length ? ` stroke-dasharray="${dash.map(short).join(" ")}"` : "";
    this.put(`<path d="${path}" fill="none" ${paint("stroke", colour)} stroke-width="${short(width)}" stroke-linejoin="round"${dashed}/>`);
  }

  protected putBox(box: Box, colour: Colour): void {
    this.put(`<rect ${sides(box)} ${paint("fill", colour)}/>`);
  }

  protected putText(text: string, x: number, y: number, { colour, size, bold, align, outline }: TextStyle): void {
    const look = outline
      ? `fill="none" ${paint("stroke", colour)} stroke-width="${short(outline)}" stroke-linejoin="round" aria-hidden="true"`
      : paint("fill", colour);
    const weight = bold ? ' font-weight="bold"' : "";
    this.put(`<text x="${short(x)}" y="${short(y)}" font-size="${short(size)}" text-anchor="${align}"${weight} ${look}>${escaped(text)}</text>`);
  }

  protected putImage(image: HTMLCanvasElement, box: Box): void {
    // the older name of the address is the one that every reader knows
    this.put(`<image ${sides(box)} preserveAspectRatio="none" xlink:href="${image.toDataURL("image/png")}"/>`);
  }

  protected beginClip(box: Box): void {
    this.names += 1;
    this.put(`<clipPath id="clip${this.names}"><rect ${sides(box)}/></clipPath>\n<g clip-path="url(#clip${this.names})">`);
  }

  protected endClip(): void {
    this.put("</g>");
  }

  private put(part: string): void {
    this.parts.push(`${part}\n`);
  }
}

function sides({ x, y, width, height }: Box): string {
  return `x="${short(x)}" y="${short(y)}" width="${short(width)}" height="${short(height)}"`;
}

function paint(what: "fill" | "stroke", [red, green, blue, alpha]: Colour): string {
  const hex = [red, green, blue].map((one) => Math.round(one).toString(16).padStart(2, "0")).join("");
  return `${what}="#${hex}"${alpha < 1 ? ` ${what}-opacity="${short(alpha)}"` : ""}`;
}

function short(value: number): string {
  return String(Number(value.toFixed(3)));
}

/** A text as XML has it, without what XML cannot hold. */
function escaped(text: string): string {
  const held = [...text].filter((one) => /[\t\n\r\u0020-\ud7ff\ue000-\ufffd]|[\u{10000}-\u{10ffff}]/u.test(one)).join("");
  return held.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/"/g, "&quot;");
}
