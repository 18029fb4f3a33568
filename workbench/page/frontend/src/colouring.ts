/** Codes of tiles to colours: an SVG filter for every layer, so that contrast and colours change without new tiles. */

import { COLOUR_MAPS } from "./colour_maps";
import type { LayerPart } from "./description";

export interface Colouring {
  map: string;
  low: number;
  high: number;
}

const CODES = 256;
const SVG = "http://www.w3.org/2000/svg";

/** Red, green and blue of a colour map at a share from 0 to 1, each 0 to 1. */
export function colourAt(map: string, share: number): [number, number, number] {
  const colours = COLOUR_MAPS[map] ?? "000000ffffff";
  const last = colours.length / 6 - 1;
  const place = Math.min(Math.max(share, 0), 1) * last;
  const before = Math.min(Math.floor(place), last - 1);
  const channel = (index: number, k: number): number =>
    parseInt(colours.slice(6 * index + 2 * k, 6 * index + 2 * k + 2), 16) / 255;
  const mixed = (k: number): number =>
    channel(before, k) + (place - before) * (channel(before + 1, k) - channel(before, k));
  return [mixed(0), mixed(1), mixed(2)];
}

export function firstColouring(layer: LayerPart): Colouring {
  return { map: layer.unit === "mm" ? "magma_r" : "grey", low: layer.shown_low, high: layer.shown_high };
}

/** The share of the colour map that a value has. */
export function shareOf(value: number, colouring: Colouring): number {
  return (value - colouring.low) / (colouring.high - colouring.low || 1);
}

/** Red, green and blue from 0 to 255 for every code of a layer. */
export function lookUpTable(layer: LayerPart, colouring: Colouring): [number, number, number][] {
  return Array.from({ length: CODES }, (_, code) => {
    const value = layer.low + (code / (CODES - 1)) * (layer.high - layer.low);
    const [red, green, blue] = colourAt(colouring.map, shareOf(value, colouring));
    return [Math.round(255 * red), Math.round(255 * green), Math.round(255 * blue)];
  });
}

/** Red, green and blue from 0 to 255 for every code, where the whole map is spread over all codes. */
export function wholeMap(map: string): [number, number, number][] {
  return Array.from({ length: CODES }, (_, code) => colourAt(map, code / (CODES - 1)).map((one) => Math.round(255 * one)) as [number, number, number]);
}

/** The colour map with bright colours for the most, as of what is brightness. */
export function brightLast(map: string): string {
  return map === "magma_r" ? "magma" : map;
}

/** The filters of the page, each named `colours-<number of the layer>`. */
export class Filters {
  private readonly root = document.createElementNS(SVG, "svg");

  constructor(private readonly layers: readonly LayerPart[]) {
    this.root.setAttribute("class", "filters");
    this.root.setAttribute("aria-hidden", "true");
    document.body.append(this.root);
  }

  /** What to set as the CSS filter of pictures of `layer`. */
  css(layer: LayerPart): string {
    return layer.kind === "scalar" ? `url(#${this.name(layer)})` : "none";
  }

  set(layer: LayerPart, colouring: Colouring): void {
    const name = this.name(layer);
    const filter = document.createElementNS(SVG, "filter");
    filter.id = name;
    filter.setAttribute("color-interpolation-filters", "sRGB");
    filter.setAttribute("x", "0");
    filter.setAttribute("y", "0");
    filter.setAttribute("width", "1");
    filter.setAttribute("height", "1");
    const transfer = document.createElementNS(SVG, "feComponentTransfer");
    const table = lookUpTable(layer, colouring);
    (["feFuncR", "feFuncG", "feFuncB"] as const).forEach((channel, k) => {
      const values = document.createElementNS(SVG, channel);
      values.setAttribute("type", "table");
      values.setAttribute("tableValues", table.map((colour) => ((colour[k] ?? 0) / 255).toFixed(4)).join(" "));
      transfer.append(values);
    });
    filter.append(transfer);
    document.getElementById(name)?.remove();
    this.root.append(filter);
  }

  private name(layer: LayerPart): string {
    return `colours-${this.layers.indexOf(layer)}`;
  }
}
