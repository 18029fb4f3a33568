/** The row of switches over the panes. */

import { button, element } from "./dom";
import type { Placer } from "./placer";
import type { State } from "./state";

export interface Actions {
  addPane(): void;
  home(): void;
  save(): void;
  /** Write a file for another program; null where nobody can. */
  export: (() => void) | null;
  /** Begin or end drawing a mask; null where none can be saved. */
  draw: (() => void) | null;
}

export const MOST_PANES = 6;

const KEYS: readonly (readonly [string, string])[] = [
  ["drag, wheel, pinch", "move and zoom; panes that are linked go along"],
  ["click", "mark a place, and see the B-scan and the frame there"],
  ["arrow keys", "step the marked place by a frame and by a degree; without one, move the view"],
  ["C", "a cursor in the first pane, then in the next: arrow keys move it, by a pixel with Shift; Enter clicks there, Escape ends it"],
  ["+ −", "zoom"],
  ["0", "the whole wall"],
  ["L", "link and unlink the panes"],
  ["B", "blink: the second layer on and off"],
  ["O", "outlines on and off"],
  ["R", "ruler: click two places"],
  ["M", "landmarks: click a place on one side and on the other"],
  ["N", "notes on places: click one and write, or a note to change it"],
  ["D", "draw a mask: E adds or erases, [ ] the brush, Enter closes an outline"],
  ["Ctrl+Z", "take back the last step with landmarks and notes, or the last shape; with Shift, make it again"],
  ["in the cylinder", "drag or arrow keys turn it, wheel and + − come nearer; a click marks a place"],
  ["Escape", "forget the marked place, the ruler, the selected cell"],
];

const OF_WALL: Readonly<Record<string, string>> = {
  "wall-cells": "outlines of the cells of the one wall of both sides",
  "wall-contradictions": "where one side surely shows a cell, and the other surely shows wall",
};

export function toolbar(state: State, placer: Placer, actions: Actions): HTMLElement {
  const bar = element("div", { class: "toolbar", role: "toolbar", "aria-label": "panes" });
  const draw = (): void => {
    const toggle = (label: string, title: string, on: boolean, act: () => void): HTMLButtonElement =>
      button(label, title, on, act);
    const outlines = state.description.outlines.map((outline) => {
      const made = toggle(outline.title, OF_WALL[outline.layer] ?? (outline.is_drawn ? "outlines of the cells as drawn by hand" : `outlines of the cells of ${outline.side}`), state.outlines.has(outline.layer), () => {
        if (!state.outlines.delete(outline.layer)) state.outlines.add(outline.layer);
        state.tell("marks");
        draw();
      });
      const swatch = element("i");
      swatch.style.background = outline.colour;
      made.prepend(swatch);
      return made;
    });
    const add = button("+ pane", "one pane more", null, actions.addPane);
    add.disabled = state.panes.length >= MOST_PANES;
    const keys = element("details", { class: "keys" }, element("summary", {}, "Keys"),
      element("dl", {}, ...KEYS.flatMap(([key, what]) => [element("dt", {}, key), element("dd", {}, what)])));
    bar.replaceChildren(
      add,
      toggle(state.linked ? "linked" : "not linked", "panes go together, by mm per pixel (L)", state.linked, () => {
        state.linked = !state.linked;
        state.tell("link");
      }),
      button("whole wall", "show all of the wall (0)", null, actions.home),
      ...(outlines.length ? [element("span", { class: "label" }, "outlines"), ...outlines,
        toggle("numbers", "numbers of the cells", state.numbers, () => {
          state.numbers = !state.numbers;
          state.tell("marks");
          draw();
        })] : []),
      toggle("ruler", "length, angle and area on the wall: click two places (R)", state.measuring, () => {
        state.measuring = !state.measuring;
        state.ruler = null;
        state.tell("marks");
      }),
      ...(state.description.sides.length > 1 ? [toggle("landmarks", "pairs of one place on both sides: click on one and the other (M)", state.landmarks.active, () => placer.toggle()),
      toggle("notes", "notes on places: click one and write (N)", state.landmarks.noting, () => placer.toggle("noting"))] : []),
      ...(actions.draw ? [toggle("draw", "draw or correct a mask of one side (D)", state.painting.active, actions.draw)] : []),
      toggle("3-D", "the wall as a cylinder, cut open", state.cylinder, () => {
        state.cylinder = !state.cylinder;
        state.tell("panes");
      }),
      button("save view", "save what the panes show as PNG, SVG or PDF", null, actions.save),
      ...(actions.export ? [button("export…", "files for napari, Fiji, 3D Slicer, ParaView; the figures as PDF and SVG", null, actions.export)] : []),
      keys,
    );
  };
  for (const change of ["panes", "link", "marks", "landmarks", "painting"] as const) state.on(change, draw);
  draw();
  return bar;
}
