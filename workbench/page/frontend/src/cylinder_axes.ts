/** Around the cylinder: θ at its mouth, and z in mm along an edge of the cut. */

import type { Drawing } from "./drawing";
import { INK, label, line } from "./marks";
import { roundBelow } from "./wall";

const TICKS = 5;
const LEAST_PX = 17;

interface Projection {
  project(x_mm: number, y_mm: number, z_mm: number): { x: number; y: number; isBefore: boolean };
}

export function drawCylinderAxes(drawing: Drawing, scene: Projection, radius_mm: number, range_mm: [number, number], edge_rad: number): void {
  const [from, to] = range_mm;
  const at = (theta_rad: number, r: number, z_mm: number): { x: number; y: number; isBefore: boolean } =>
    scene.project(r * Math.cos(theta_rad), r * Math.sin(theta_rad), z_mm);
  drawing.font = "11px system-ui, sans-serif";
  drawing.textAlign = "center";
  drawing.textBaseline = "middle";
  for (let degrees = 0; degrees < 360; degrees += 90) {
    const theta = (degrees * Math.PI) / 180;
    const [inner, outer, text] = [at(theta, radius_mm, from), at(theta, 1.06 * radius_mm, from), at(theta, 1.16 * radius_mm, from)];
    if (!inner.isBefore || !text.isBefore) continue;
    line(drawing, inner.x, inner.y, outer.x, outer.y, 1);
    label(drawing, degrees ? `${degrees}°` : "θ 0°", text.x, text.y);
  }
  const step = roundBelow(Math.max((to - from) / TICKS, 1e-6));
  const decimals = Math.max(0, -Math.floor(Math.log10(step)));
  const ends = [at(edge_rad, radius_mm, from), at(edge_rad, radius_mm, to)] as const;
  if (ends.every((end) => end.isBefore)) line(drawing, ends[0].x, ends[0].y, ends[1].x, ends[1].y, 1);
  let last = { x: Infinity, y: Infinity };
  drawing.fillStyle = INK;
  for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9; k += 1) {
    const [tick, end, text] = [1, 1.06, 1.2].map((r) => at(edge_rad, r * radius_mm, k * step)) as [typeof last & { isBefore: boolean }, typeof last, typeof last];
    if (!tick.isBefore || Math.hypot(text.x - last.x, text.y - last.y) < LEAST_PX) continue;
    line(drawing, tick.x, tick.y, end.x, end.y, 1);
    label(drawing, `${(k * step).toFixed(decimals)} mm`.replace("-", "−"), text.x, text.y);
    last = text;
  }
}
