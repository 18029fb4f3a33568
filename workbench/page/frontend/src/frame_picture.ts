/** A picture of a single frame with its axes, its curves, and the marked place. */

import { context } from "./dom";
import { seenAt } from "./seen";
import type { FramePicture } from "./source";
import type { Place } from "./wall";

const LEFT = 40;
const BELOW = 28;
const TOP = 4;
const RIGHT = 6;
/** One colour for one thing in every picture of a side, as in the figures of a report: Okabe and Ito's. */
const COLOURS = ["#d55e00", "#56b4e9", "#009e73", "#f0e442", "#cc79a7"];
/** Every other curve is dashed, so that two that coincide both show. */
const DASHES = [[], [4, 4]];
const MARK = "#ff2fa0";
const RING_PX = 6;

/** How the curves of one side are drawn. */
export class CurveStyles {
  private readonly labels: string[] = [];

  of(label: string): { colour: string; dash: readonly number[] } {
    if (!this.labels.includes(label)) this.labels.push(label);
    const k = this.labels.indexOf(label);
    return { colour: COLOURS[k % COLOURS.length] ?? MARK, dash: DASHES[k % DASHES.length] ?? [] };
  }
}

/** The marked place in the frame of the side. */
export type Marked = Place;

export function drawPicture(
  canvas: HTMLCanvasElement,
  image: HTMLImageElement,
  picture: FramePicture,
  styles: CurveStyles,
  marked: Marked | null,
): void {
  const drawing = context(canvas);
  if (!drawing) return;
  const ink = getComputedStyle(canvas).color;
  const inPixels = picture.x_label.endsWith("(px)");
  let [wide, tall] = [canvas.clientWidth - LEFT - RIGHT, canvas.clientHeight - TOP - BELOW];
  if (inPixels) {
    // what a camera saw keeps its shape; B-scans are stretched to be seen
    const scale = Math.min(wide / image.naturalWidth, tall / image.naturalHeight);
    [wide, tall] = [image.naturalWidth * scale, image.naturalHeight * scale];
  }
  if (wide < 20 || tall < 20) return;
  drawing.imageSmoothingQuality = "high";
  drawing.drawImage(image, LEFT, TOP, wide, tall);
  const [x0, x1] = picture.x_extent;
  const [y0, y1] = picture.y_extent;
  const toX = (x: number): number => LEFT + ((x - x0) / (x1 - x0 || 1)) * wide;
  const toY = (y: number): number => TOP + ((y - y0) / (y1 - y0 || 1)) * tall;
  drawing.save();
  drawing.beginPath();
  drawing.rect(LEFT, TOP, wide, tall);
  drawing.clip();
  for (const [label, points] of Object.entries(picture.curves)) {
    const { colour, dash } = styles.of(label);
    drawing.strokeStyle = colour;
    drawing.setLineDash([...dash]);
    drawing.lineWidth = 1.3;
    drawing.beginPath();
    let down = false;
    for (const [x, y] of points) {
      if (x === null || y === null) down = false;
      else if (down) drawing.lineTo(toX(x), toY(y));
      else {
        drawing.moveTo(toX(x), toY(y));
        down = true;
      }
    }
    drawing.stroke();
  }
  drawing.setLineDash([]);
  if (marked) drawMark(drawing, picture, marked, toX, toY, tall);
  drawing.restore();
  drawAxes(drawing, picture, ink, wide, tall);
}

function drawMark(
  drawing: CanvasRenderingContext2D,
  picture: FramePicture,
  marked: Marked,
  toX: (x: number) => number,
  toY: (y: number) => number,
  tall: number,
): void {
  const spotted = seenAt(picture, marked);
  if (picture.seen && !spotted) return; // it is not seen in this frame
  const inPixels = picture.x_label.endsWith("(px)");
  drawing.strokeStyle = MARK;
  drawing.lineWidth = 1.6;
  drawing.setLineDash([5, 3]);
  drawing.beginPath();
  if (spotted ? !inPixels : picture.axis === "theta") {
    const x = toX(withinAxis(picture, spotted?.x ?? marked.theta_rad));
    drawing.moveTo(x, TOP);
    drawing.lineTo(x, TOP + tall);
  } else if (!spotted && picture.axis === "ring" && picture.ring) {
    const { ring } = picture;
    const angle = marked.theta_rad - ring.roll_rad;
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    drawing.moveTo(toX(ring.inner_x + ring.inner * cos), toY(ring.inner_y + ring.inner * sin));
    drawing.lineTo(toX(ring.outer_x + ring.outer * cos), toY(ring.outer_y + ring.outer * sin));
  }
  drawing.stroke();
  drawing.setLineDash([]);
  if (spotted && spotted.y !== null) drawTarget(drawing, toX(withinAxis(picture, spotted.x)), toY(spotted.y));
}

/** A ring around a place, with ticks outward, so that the place itself is not covered. */
function drawTarget(drawing: CanvasRenderingContext2D, x: number, y: number): void {
  for (const [colour, wide] of [["#ffffff", 4], [MARK, 2]] as const) {
    drawing.strokeStyle = colour;
    drawing.lineWidth = wide;
    drawing.beginPath();
    drawing.arc(x, y, RING_PX, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
      drawing.moveTo(x + RING_PX * dx, y + RING_PX * dy);
      drawing.lineTo(x + 2 * RING_PX * dx, y + 2 * RING_PX * dy);
    }
    drawing.stroke();
  }
}

/** An angle, brought into the turn that the x axis shows; any other x as it is. */
function withinAxis(picture: FramePicture, x: number): number {
  if (!picture.x_label.endsWith("(rad)")) return x;
  const turn = 2 * Math.PI;
  const from = (picture.x_extent[0] + picture.x_extent[1]) / 2 - Math.PI;
  return ((((x - from) % turn) + turn) % turn) + from;
}

function drawAxes(drawing: CanvasRenderingContext2D, picture: FramePicture, ink: string, wide: number, tall: number): void {
  drawing.strokeStyle = ink;
  drawing.fillStyle = ink;
  drawing.lineWidth = 0.8;
  drawing.strokeRect(LEFT, TOP, wide, tall);
  drawing.font = "10px system-ui, sans-serif";
  const isAngle = picture.x_label.endsWith("(rad)");
  const xs = isAngle ? [0, 90, 180, 270] : [0, 0.5, 1].map((share) => lerp(picture.x_extent, share));
  drawing.textBaseline = "top";
  for (const value of xs) {
    const x = isAngle ? (value * Math.PI) / 180 : value;
    const at = LEFT + ((x - picture.x_extent[0]) / (picture.x_extent[1] - picture.x_extent[0] || 1)) * wide;
    drawing.textAlign = at < LEFT + 6 ? "left" : at > LEFT + wide - 12 ? "right" : "center"; // within the picture's width
    drawing.fillText(isAngle ? `${value}°` : text(value), at, TOP + tall + 2);
  }
  drawing.textAlign = "center";
  drawing.fillText(isAngle ? picture.x_label.replace("(rad)", "(°)") : picture.x_label, LEFT + wide / 2, TOP + tall + 14);
  drawing.textAlign = "right";
  drawing.textBaseline = "middle";
  for (const share of [0, 0.5, 1]) {
    drawing.fillText(text(lerp(picture.y_extent, share)), LEFT - 4, Math.min(Math.max(TOP + share * tall, TOP + 5), TOP + tall - 4));
  }
  drawing.save();
  drawing.translate(9, TOP + tall / 2);
  drawing.rotate(-Math.PI / 2);
  drawing.textAlign = "center";
  drawing.fillText(picture.y_label, 0, 0);
  drawing.restore();
}

function lerp([from, to]: [number, number], share: number): number {
  return from + share * (to - from);
}

function text(value: number): string {
  return String(Number(value.toPrecision(3))).replace("-", "−");
}
