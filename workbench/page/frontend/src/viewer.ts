/** One OpenSeadragon viewer of one layer, which speaks of places on the wall and of mm per pixel. */

import OpenSeadragon from "openseadragon";
import type { Source } from "./source";
import { tileSource } from "./tile_source";
import type { View, Wall } from "./wall";

/** From the whole of the longest bore in a thumbnail to single samples of the finest. */
export const COARSEST_MM_PER_PX = 0.5;
export const FINEST_MM_PER_PX = 0.00002;

export class LayerViewer {
  readonly viewer: OpenSeadragon.Viewer;
  private layer = "";

  constructor(
    readonly element: HTMLElement,
    private readonly source: Source,
    private readonly wall: Wall,
  ) {
    this.viewer = new OpenSeadragon.Viewer({
      element,
      drawer: "canvas",
      wrapHorizontal: true,
      visibilityRatio: 0,
      showNavigationControl: false,
      showNavigator: false,
      preserveImageSizeOnResize: true,
      preserveViewport: true,
      immediateRender: true,
      blendTime: 0,
      animationTime: 0.35,
      springStiffness: 9,
      zoomPerScroll: 1.25,
      minPixelRatio: 0.6,
      minZoomLevel: 1e-6,
      maxZoomLevel: 1e9,
      maxZoomPixelRatio: Infinity,
      imageLoaderLimit: 6,
      timeout: 300_000, // ms; a tile that is given up leaves a hole that looks as if nothing was observed there
      tileRetryMax: 3,
      clickTimeThreshold: Infinity, // what did not move is a click, however late a busy browser hears of its end
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true, flickEnabled: true },
      gestureSettingsTouch: { clickToZoom: false },
      gestureSettingsPen: { clickToZoom: false },
    } as OpenSeadragon.Options);
    this.viewer.addHandler("tile-load-failed", () => source.checkPresent());
    this.viewer.setKeyboardNavEnabled(false); // keys are the page's: they act on all panes, wherever the focus is
  }

  show(layer: string): void {
    if (layer === this.layer) return;
    this.layer = layer;
    const before = this.viewer.world.getItemAt(0);
    this.viewer.addTiledImage({
      tileSource: tileSource(this.source, this.wall, layer),
      success: () => {
        if (before) this.viewer.world.removeItem(before);
      },
    });
  }

  /** How large it is, as it knows itself, which may be a moment late. */
  size(): string {
    const { x, y } = this.viewer.viewport.getContainerSize();
    return `${x} × ${y}`;
  }

  /** What is shown now, amid an animation too. */
  view(): View {
    const { viewport } = this.viewer;
    const center = viewport.getCenter(true);
    const width = Math.max(viewport.getContainerSize().x, 1);
    return { ...this.wall.placeOf(center), mm_per_px: this.wall.circumference_mm / (viewport.getZoom(true) * width) };
  }

  setView(view: View, immediately = true): void {
    const { viewport } = this.viewer;
    const width = Math.max(viewport.getContainerSize().x, 1);
    const { x, y } = this.wall.turnsOf(view);
    const bounded = Math.min(Math.max(view.mm_per_px, FINEST_MM_PER_PX), COARSEST_MM_PER_PX);
    viewport.zoomTo(this.wall.circumference_mm / (bounded * width), undefined, immediately);
    viewport.panTo(new OpenSeadragon.Point(x, y), immediately);
  }

  /** Single samples are shown as they are; nothing is made up between them. */
  setSmooth(smooth: boolean): void {
    this.viewer.drawer.setImageSmoothingEnabled(smooth);
  }

  /** Whether a double click zooms; where clicks mean places, two of them are two places. */
  setDoubleClickZoom(zooms: boolean): void {
    const { gestureSettingsMouse } = this.viewer as unknown as { gestureSettingsMouse: { dblClickToZoom: boolean } };
    gestureSettingsMouse.dblClickToZoom = zooms;
  }

  destroy(): void {
    this.viewer.destroy();
  }
}
