/** The axes of a pane, which lie outside of its picture: θ above, z at the left. */

import type { Drawing } from "./drawing";
import { type Sheet, turnOf } from "./sheet";
import { degrees, roundBelow } from "./wall";

/** Room for them, left of a picture and above it. */
export const AXES_PX = { left: 36, top: 18 };
const DEGREE_STEPS = [90, 45, 30, 15, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
const LEAST_LABEL_PX = 46;
const TICK_PX = 4;

/** Draw both axes; 0, 0 is the upper left corner of the picture. */
export function drawAxes(sheet: Sheet): void {
  const { drawing, paper } = sheet;
  drawing.fillStyle = paper.ink;
  drawing.strokeStyle = paper.ink;
  drawing.lineWidth = 1;
  drawing.font = "10.5px system-ui, sans-serif";
  drawAngles(sheet);
  drawLengths(sheet);
}

/** Angles of the one turn that is marked, which others repeat; its begin and its end have a name too. */
function drawAngles(sheet: Sheet): void {
  const { drawing, width, view } = sheet;
  const { left, right, perTurn } = turnOf(sheet);
  const perDegree = perTurn / 360;
  const step = [...DEGREE_STEPS].reverse().find((value) => value * perDegree >= LEAST_LABEL_PX) ?? 90;
  const middle = (view.theta_rad * 180) / Math.PI;
  drawing.textBaseline = "alphabetic";
  const [from, to] = [Math.max(left, 0) - 0.5, Math.min(right, width) + 0.5];
  for (let k = Math.ceil((middle + (from - width / 2) / perDegree) / step); ; k += 1) {
    const x = width / 2 + (k * step - middle) * perDegree;
    if (x > to) break;
    tick(drawing, x, 0, x, -TICK_PX);
    drawing.textAlign = x > width - 14 ? "right" : "center";
    drawing.fillText(`${angleText(k * step)}°`, Math.min(x, width - 2), -TICK_PX - 2);
  }
}

/** An angle in one turn, 0 for 360. */
function angleText(angle_deg: number): number {
  return Number(degrees((angle_deg * Math.PI) / 180).toFixed(2)) % 360;
}

function drawLengths({ drawing, height, view, wall }: Sheet): void {
  const step_mm = roundBelow(2.2 * LEAST_LABEL_PX * view.mm_per_px);
  const decimals = Math.max(0, -Math.floor(Math.log10(step_mm)));
  drawing.textAlign = "left";
  drawing.textBaseline = "alphabetic";
  drawing.fillText("mm", 2 - AXES_PX.left, -TICK_PX - 2); // of z, below
  drawing.textAlign = "right";
  drawing.textBaseline = "middle";
  const half_mm = (height / 2) * view.mm_per_px;
  const [first_mm, last_mm] = [Math.max(view.z_mm - half_mm, wall.part.top_mm), Math.min(view.z_mm + half_mm, wall.part.bottom_mm)];
  for (let k = Math.ceil(first_mm / step_mm); k * step_mm <= last_mm; k += 1) {
    const y = height / 2 + (k * step_mm - view.z_mm) / view.mm_per_px;
    tick(drawing, 0, y, -TICK_PX, y);
    drawing.fillText((k * step_mm).toFixed(decimals).replace("-", "−"), -TICK_PX - 3, Math.min(Math.max(y, 5), height - 5));
  }
}

function tick(drawing: Drawing, x: number, y: number, toX: number, toY: number): void {
  drawing.beginPath();
  drawing.moveTo(x, y);
  drawing.lineTo(toX, toY);
  drawing.stroke();
}
