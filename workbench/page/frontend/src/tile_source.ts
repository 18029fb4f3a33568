/** Tiles of a layer as OpenSeadragon asks for them; they reach into their neighbours around the circle too. */

import OpenSeadragon from "openseadragon";
import type { Source } from "./source";
import { OVERLAP_PX, TILE_PX, type Wall } from "./wall";

export function tileSource(source: Source, wall: Wall, layer: string): OpenSeadragon.TileSource {
  const finest = source.finestLevel(layer);
  const made = new OpenSeadragon.TileSource({
    width: wall.widthPx(finest),
    height: wall.heightPx(finest),
    tileSize: TILE_PX,
    tileOverlap: OVERLAP_PX,
    minLevel: 0,
    maxLevel: finest,
  } as OpenSeadragon.TileSourceOptions);
  made.getTileUrl = (level: number, x: number, y: number) => source.tileUrl(layer, level, x, y);
  // Said to be opaque, or each would be cleared before it is drawn, with its neighbour's rim: a hairline at every seam.
  made.hasTransparency = () => false;
  made.getTileBounds = (level: number, x: number, y: number, isSource?: boolean) => {
    const height = wall.heightPx(level);
    const top = Math.max(y * TILE_PX - OVERLAP_PX, 0);
    const tall = Math.min((y + 1) * TILE_PX + OVERLAP_PX, height) - top;
    const wide = TILE_PX + 2 * OVERLAP_PX;
    if (isSource) return new OpenSeadragon.Rect(0, 0, wide, tall);
    const turn = wall.widthPx(level);
    return new OpenSeadragon.Rect((x * TILE_PX - OVERLAP_PX) / turn, top / turn, wide / turn, tall / turn);
  };
  return made;
}
