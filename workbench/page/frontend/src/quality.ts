/** Numbers per frame along the bore, with the limits of sound recordings; what lies beyond is marked. */

import type { FramesPart, SeriesPart } from "./description";
import { context, element } from "./dom";
import { addPlots } from "./folding";
import type { State } from "./state";

const [LEFT, RIGHT, TOP, BELOW] = [52, 10, 4, 16];
const NEAR_PX = 12;

/** Which frames a series speaks against, by their places. */
export function doubted(series: SeriesPart): number[] {
  const [low, high] = series.usual ?? [null, null];
  return series.values.flatMap((value, k) => {
    if (value === null) return [];
    if (series.is_flag) return value ? [k] : [];
    return (low !== null && value < low) || (high !== null && value > high) ? [k] : [];
  });
}

export function plotQuality(more: HTMLElement, state: State, go: (z_mm: number) => void): void {
  for (const frames of state.description.frames) {
    if (!frames.quality.length || !frames.z_mm.length) continue;
    const bad = new Set(frames.quality.flatMap(doubted));
    const said = bad.size ? `${bad.size} of ${frames.z_mm.length} ${frames.frame_dim}s beyond a limit` : "nothing beyond a limit";
    const plots = frames.quality.map((series) => plot(state, frames, series, go));
    const about = element("p", { class: "soft" }, "Shaded: where sound recordings lie. A click goes to the frame.");
    addPlots(more, frames.side, said, [about, ...plots]);
  }
}

function plot(state: State, frames: FramesPart, series: SeriesPart, go: (z_mm: number) => void): HTMLElement {
  const bad = doubted(series);
  const canvas = element("canvas", { tabindex: "0", role: "img", "aria-label": spoken(frames, series, bad) });
  const draw = (): void => drawSeries(canvas, state, frames, series, bad);
  canvas.addEventListener("click", (event) => {
    const xs = frames.z_mm.map((z_mm) => Math.abs(placeOf(canvas, frames, z_mm) - event.offsetX));
    const nearest = xs.indexOf(Math.min(...xs));
    const z_mm = frames.z_mm[nearest];
    if (z_mm !== undefined && (xs[nearest] ?? Infinity) < NEAR_PX) go(z_mm);
  });
  new ResizeObserver(draw).observe(canvas);
  state.on("cursor", draw);
  const title = series.unit && series.unit !== "1" ? `${series.title} (${series.unit})` : series.title;
  return element("figure", {}, element("figcaption", {}, title), canvas);
}

function spoken(frames: FramesPart, series: SeriesPart, bad: number[]): string {
  const where = bad.join(", ");
  return `${series.title} of every ${frames.frame_dim}; ${bad.length ? `beyond the limits: ${where}` : "none beyond the limits"}`;
}

function range(frames: FramesPart): [number, number] {
  return [Math.min(...frames.z_mm), Math.max(...frames.z_mm)];
}

function placeOf(canvas: HTMLCanvasElement, frames: FramesPart, z_mm: number): number {
  const [first, last] = range(frames);
  const share = last > first ? (z_mm - first) / (last - first) : 0.5; // of a single frame in the middle
  return LEFT + share * (canvas.clientWidth - LEFT - RIGHT);
}

function drawSeries(canvas: HTMLCanvasElement, state: State, frames: FramesPart, series: SeriesPart, bad: number[]): void {
  if (!canvas.clientWidth) return; // folded away
  const drawing = context(canvas);
  if (!drawing) return;
  const style = getComputedStyle(canvas);
  const [ink, soft, shade, alarm] = ["--ink", "--soft", "--good-paper", "--bad"].map((name) => style.getPropertyValue(name));
  const tall = canvas.clientHeight - TOP - BELOW;
  const wide = canvas.clientWidth - LEFT - RIGHT;
  const known = series.values.filter((value): value is number => value !== null);
  const usual: readonly (number | null)[] = series.usual ?? [];
  const limits = usual.filter((value): value is number => value !== null);
  const [low, high] = series.is_flag ? [0, 1] : [Math.min(...known, ...limits), Math.max(...known, ...limits)];
  const spare = (high - low || 1) * 0.08;
  const toY = (value: number): number => TOP + tall * (1 - (value - low + spare) / (high - low + 2 * spare));
  if (series.usual) {
    const [least, most] = series.usual;
    drawing.fillStyle = shade ?? "";
    const top = most === null ? TOP : toY(most);
    drawing.fillRect(LEFT, top, wide, (least === null ? TOP + tall : toY(least)) - top);
  }
  drawing.strokeStyle = soft ?? "";
  drawing.lineWidth = 0.7;
  drawing.strokeRect(LEFT, TOP, wide, tall);
  const chosen = new Set(bad);
  series.values.forEach((value, k) => {
    if (value === null) return;
    drawing.fillStyle = (chosen.has(k) ? alarm : ink) ?? "";
    drawing.beginPath();
    drawing.arc(placeOf(canvas, frames, frames.z_mm[k] ?? 0), toY(value), chosen.has(k) ? 3 : 1.7, 0, 2 * Math.PI);
    drawing.fill();
  });
  const { pinned } = state;
  if (pinned) {
    const x = placeOf(canvas, frames, pinned.z_mm);
    drawing.fillStyle = "#ff2fa0";
    if (x >= LEFT && x <= LEFT + wide) drawing.fillRect(x - 0.6, TOP, 1.2, tall);
  }
  drawing.fillStyle = soft ?? "";
  drawing.font = "10px system-ui, sans-serif";
  drawing.textBaseline = "middle";
  drawing.textAlign = "right";
  for (const value of series.is_flag ? [0, 1] : [low, high]) {
    drawing.fillText(series.is_flag ? (value ? "yes" : "no") : text(value), LEFT - 5, toY(value));
  }
  drawing.textBaseline = "top";
  const [first, last] = range(frames);
  const ends = last > first ? ([[first, "left"], [(first + last) / 2, "center"], [last, "right"]] as const) : ([[first, "center"]] as const);
  for (const [z_mm, align] of ends) {
    drawing.textAlign = align;
    drawing.fillText(`${z_mm.toFixed(1).replace("-", "−")} mm`, placeOf(canvas, frames, z_mm), TOP + tall + 3);
  }
}

function text(value: number): string {
  return String(Number(value.toPrecision(3))).replace("-", "−");
}
