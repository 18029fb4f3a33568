/** What a figure is made of: a pane, or the cylinder, that can be drawn at any fineness. */

import { drawAxes } from "./axes";
import type { Drawing } from "./drawing";
import { type Paths, drawMarks } from "./marks";
import { paneRaster } from "./raster";
import { WHITE } from "./sheet";
import type { Source } from "./source";
import type { State } from "./state";
import { LENS_PX, type Shot } from "./together";
import type { View, Wall } from "./wall";

/** Where it lies on the screen, and how large it is, in CSS pixels. */
export interface Subject {
  left: number;
  top: number;
  width: number;
  height: number;
  title: string;
  layers: readonly string[];
  /** The place in the middle and the scale; null where the scale is not the same everywhere. */
  view: View | null;
  /** The same with another height, about the same middle. */
  withHeight(height: number): Subject;
  /** What is below the marks, `ratio` pixels for a CSS pixel; `told` hears of every tile that it takes. */
  picture(ratio: number, told: () => void): Promise<HTMLCanvasElement>;
  marks(drawing: Drawing): void;
  /** What lies outside of the picture, from its upper left corner. */
  axes(drawing: Drawing): void;
}

/** What panes are drawn from. */
export interface Shown {
  state: State;
  source: Source;
  wall: Wall;
  paths: Paths;
}

export function paneSubject(shot: Shot, left: number, top: number, page: Shown): Subject {
  const { state, source, wall, paths } = page;
  const { width, height, view } = shot;
  const layers = shownLayers(shot, state);
  return {
    left, top, width, height, view, layers,
    title: paneTitle(shot, state),
    withHeight: (high) => {
      const pointer = { x: shot.pointer.x, y: shot.pointer.y - (height - high) / 2 };
      return paneSubject({ ...shot, height: high, pointer }, left, top, page);
    },
    picture: (ratio, told) => paneRaster(shot, ratio, state, source, wall, told),
    marks: (drawing) => {
      drawMarks({ drawing, width, height, view, wall, paper: WHITE }, state, paths, layers);
      drawBorder(drawing, shot);
    },
    axes: (drawing) => drawAxes({ drawing, width, height, view, wall, paper: WHITE }),
  };
}

/** What is in a pane, by its layers and how they are brought together. */
function paneTitle({ shown }: Shot, state: State): string {
  const [first, second] = [state.layer(shown.layer).title, state.layer(shown.second).title];
  switch (shown.mode) {
    case "swipe":
      return `${first} | ${second}`;
    case "opacity":
      return `${first} + ${Math.round(100 * shown.share)} % ${second}`;
    case "blink":
      return state.secondShown ? second : first;
    case "checker":
      return `${first} and ${second}, checkerboard`;
    case "lens":
      return `${first}, in the lens ${second}`;
    default:
      return first;
  }
}

/** The layers that can be seen in a pane. */
function shownLayers({ shown }: Shot, state: State): string[] {
  if (shown.mode === "single") return [shown.layer];
  if (shown.mode === "blink") return [state.secondShown ? shown.second : shown.layer];
  return shown.layer === shown.second ? [shown.layer] : [shown.layer, shown.second];
}

/** Where the second layer begins. */
function drawBorder(drawing: Drawing, { shown, width, height, pointer }: Shot): void {
  if (shown.mode !== "swipe" && shown.mode !== "lens") return;
  for (const [colour, wide] of [["#111", 3], ["#ffffff", 1.5]] as const) {
    drawing.strokeStyle = colour;
    drawing.lineWidth = wide;
    drawing.beginPath();
    if (shown.mode === "lens") drawing.arc(pointer.x, pointer.y, LENS_PX, 0, 2 * Math.PI);
    else {
      drawing.moveTo(shown.share * width, 0);
      drawing.lineTo(shown.share * width, height);
    }
    drawing.stroke();
  }
}
