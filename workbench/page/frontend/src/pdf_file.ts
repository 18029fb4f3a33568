/** A figure as PDF of one page: layers as pictures, everything else as lines and texts.
 *
 * Written here and not by a library: of these only a page, pictures and lines are needed, which is a hundredth of them.
 */

import type { Line } from "./drawing";
import { hex, property, runsOf } from "./pdf_text";
import type { About } from "./svg_file";
import { type Box, type Colour, FONT, type LineStyle, type TextStyle, VectorDrawing, textWidth } from "./vector_drawing";

const POINTS_PER_MM = 72 / 25.4;
/** Times the size of a text, the pixels of its picture, where no font of ours has its letters. */
const PICTURED_TEXT = 8;

export class PdfFile extends VectorDrawing {
  private readonly content: string[] = [];
  private readonly images: HTMLCanvasElement[] = [];
  private readonly alphas: number[] = [];

  constructor(private readonly width: number, private readonly height: number, private readonly width_mm: number) {
    super();
  }

  async blob(about: About): Promise<Blob> {
    const scale = (this.width_mm * POINTS_PER_MM) / this.width;
    // from here on y runs down, as on a screen
    const place = `${short(scale)} 0 0 ${short(-scale)} 0 ${short(this.height * scale)} cm 1 j`;
    const objects: Uint8Array[] = [];
    const add = (...parts: (string | Uint8Array)[]): number => objects.push(joined(parts));
    add("<< /Type /Catalog /Pages 2 0 R >>");
    add("<< /Type /Pages /Kids [3 0 R] /Count 1 >>");
    const fonts = ["Helvetica", "Helvetica-Bold", "Symbol"].map((name, k) => {
      const coded = name === "Symbol" ? "" : " /Encoding /WinAnsiEncoding";
      return `/F${k} << /Type /Font /Subtype /Type1 /BaseFont /${name}${coded} >>`;
    });
    const states = this.alphas.map((alpha, k) => `/A${k} << /CA ${short(alpha)} /ca ${short(alpha)} >>`);
    const first = 6; // the number of the first picture's object; its opacity follows it
    const pictures = this.images.map((_, k) => `/I${k} ${first + 2 * k} 0 R`);
    add(`<< /Type /Page /Parent 2 0 R /MediaBox [0 0 ${short(this.width * scale)} ${short(this.height * scale)}] /Contents 4 0 R ` +
      `/Resources << /Font << ${fonts.join(" ")} >> /ExtGState << ${states.join(" ")} >> /XObject << ${pictures.join(" ")} >> >> >>`);
    add(...(await stream("", bytes(`${place}\n${this.content.join("\n")}\n`))));
    add(`<< /Title ${property(about.title)} /Subject ${property(about.caption)} /Creator (endoct) >>`);
    for (const image of this.images) {
      const { colours, opacities } = samples(image);
      const size = `/Type /XObject /Subtype /Image /Width ${image.width} /Height ${image.height} /BitsPerComponent 8`;
      add(...(await stream(`${size} /ColorSpace /DeviceRGB /SMask ${objects.length + 2} 0 R`, colours)));
      add(...(await stream(`${size} /ColorSpace /DeviceGray`, opacities)));
    }
    return new Blob(document_(objects) as BlobPart[], { type: "application/pdf" });
  }

  protected putLines(lines: readonly Line[], { colour, width, dash }: LineStyle): void {
    const path = lines.map((line) => line.map(([x, y], k) => `${short(x)} ${short(y)} ${k ? "l" : "m"}`).join(" ")).join(" ");
    this.put(colour, `${rgb(colour)} RG ${short(width)} w [${dash.map(short).join(" ")}] 0 d ${path} S`);
  }

  protected putBox({ x, y, width, height }: Box, colour: Colour): void {
    this.put(colour, `${rgb(colour)} rg ${short(x)} ${short(y)} ${short(width)} ${short(height)} re f`);
  }

  protected putText(text: string, x: number, y: number, style: TextStyle): void {
    const { colour, size, bold, align, outline } = style;
    const wide = textWidth(text, size, bold);
    const left = x - (align === "middle" ? wide / 2 : align === "end" ? wide : 0);
    const runs = runsOf(text);
    if (!runs) {
      this.putImage(pictured(text, style), { x: left - size, y: y - 1.5 * size, width: wide + 2 * size, height: 2 * size });
      return;
    }
    const shown = runs.map(({ symbol, codes }) => `/F${symbol ? 2 : Number(bold)} ${short(size)} Tf ${hex(codes)} Tj`).join(" ");
    const how = outline ? `1 Tr ${short(outline)} w ${rgb(colour)} RG [] 0 d` : `0 Tr ${rgb(colour)} rg`;
    this.put(colour, `BT ${how} 1 0 0 -1 ${short(left)} ${short(y)} Tm ${shown} ET`);
  }

  protected putImage(image: HTMLCanvasElement, { x, y, width, height }: Box): void {
    this.images.push(image);
    this.content.push(`q ${short(width)} 0 0 ${short(-height)} ${short(x)} ${short(y + height)} cm /I${this.images.length - 1} Do Q`);
  }

  protected beginClip({ x, y, width, height }: Box): void {
    this.content.push(`q ${short(x)} ${short(y)} ${short(width)} ${short(height)} re W n`);
  }

  protected endClip(): void {
    this.content.push("Q");
  }

  private put([, , , alpha]: Colour, mark: string): void {
    if (alpha >= 1) {
      this.content.push(mark);
      return;
    }
    if (!this.alphas.includes(alpha)) this.alphas.push(alpha);
    this.content.push(`q /A${this.alphas.indexOf(alpha)} gs ${mark} Q`);
  }
}

/** A text as a picture that reaches its size to both sides, 1.5 sizes above its line and half of one below. */
function pictured(text: string, { colour, size, bold, outline }: TextStyle): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  const scale = PICTURED_TEXT;
  canvas.width = Math.ceil((textWidth(text, size, bold) + 2 * size) * scale);
  canvas.height = Math.ceil(2 * size * scale);
  const drawing = canvas.getContext("2d");
  if (!drawing) return canvas;
  drawing.scale(scale, scale);
  drawing.font = `${bold ? "bold " : ""}${size}px ${FONT}`;
  drawing.lineWidth = outline;
  drawing.lineJoin = "round";
  drawing.fillStyle = drawing.strokeStyle = `rgba(${colour.join(",")})`;
  if (outline) drawing.strokeText(text, size, 1.5 * size);
  else drawing.fillText(text, size, 1.5 * size);
  return canvas;
}

function samples(image: HTMLCanvasElement): { colours: Uint8Array<ArrayBuffer>; opacities: Uint8Array<ArrayBuffer> } {
  const found = image.getContext("2d")?.getImageData(0, 0, image.width, image.height).data ?? new Uint8ClampedArray();
  const opacities = new Uint8Array(found.length / 4);
  const colours = new Uint8Array(3 * opacities.length);
  for (let k = 0; k < opacities.length; k += 1) {
    colours.set(found.subarray(4 * k, 4 * k + 3), 3 * k);
    opacities[k] = found[4 * k + 3] ?? 255;
  }
  return { colours, opacities };
}

async function stream(entries: string, content: Uint8Array<ArrayBuffer>): Promise<(string | Uint8Array)[]> {
  const small = new Blob([content]).stream().pipeThrough(new CompressionStream("deflate"));
  const packed = new Uint8Array(await new Response(small).arrayBuffer());
  return [`<< ${entries} /Filter /FlateDecode /Length ${packed.length} >>\nstream\n`, packed, "\nendstream"];
}

/** The file: every object at the place that the table at its end gives. */
function document_(objects: readonly Uint8Array[]): Uint8Array[] {
  const parts: Uint8Array[] = [bytes("%PDF-1.7\n%"), new Uint8Array([0xe2, 0xe3, 0xcf, 0xd3]), bytes("\n")];
  let at = 15;
  const places = objects.map((object, k) => {
    const place = at;
    const whole = joined([`${k + 1} 0 obj\n`, object, "\nendobj\n"]);
    parts.push(whole);
    at += whole.length;
    return `${String(place).padStart(10, "0")} 00000 n \n`;
  });
  const size = objects.length + 1;
  parts.push(bytes(`xref\n0 ${size}\n0000000000 65535 f \n${places.join("")}trailer\n<< /Size ${size} /Root 1 0 R /Info 5 0 R >>\nstartxref\n${at}\n%%EOF\n`));
  return parts;
}

function joined(parts: readonly (string | Uint8Array)[]): Uint8Array {
  const all = parts.map((part) => (typeof part === "string" ? bytes(part) : part));
  const whole = new Uint8Array(all.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of all) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

function bytes(text: string): Uint8Array<ArrayBuffer> {
  return new TextEncoder().encode(text) as Uint8Array<ArrayBuffer>;
}

function rgb([red, green, blue]: Colour): string {
  return [red, green, blue].map((one) => short(one / 255)).join(" ");
}

function short(value: number): string {
  return String(Number(value.toFixed(4)));
}
