/** The wall in three dimensions: a bundle of its own, since three is as large as all the rest.
 *
 * The bore frame is right-handed: x right, y down, z inward as one looks in. Here y is up and z toward the eye, so that
 * a place (x, y, z) stands at (x, −y, −z): half a turn about x, which keeps the sense of rotation. With the mouth up,
 * the wall within looks as in the panes: θ to the right, z down.
 */

import {
  BufferAttribute, BufferGeometry, type CanvasTexture, DataTexture, DoubleSide, Mesh, NoBlending, PerspectiveCamera,
  Quaternion, Scene, ShaderMaterial, Spherical, Vector2, Vector3, WebGLRenderTarget, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { FRAGMENT, VERTEX } from "./cylinder_shader";
import { type VolumeMesh, aim, disposeVolume, setLimit, volumeMesh } from "./cylinder_volume";
import type { WallPart } from "./description";
import type { Surface } from "./relief";
import type { Volume } from "./volume";
import { type Place, wrapped } from "./wall";
import { wallTexture } from "./wall_texture";

const FIELD_DEG = 38;
const PITCH_MARGIN_RAD = 0.05;

export interface Marks {
  cursor: Place | null;
  pinned: Place | null;
}

export type Direction = "in" | "aslant" | "side";

export class CylinderScene {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD_DEG, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly target = new WebGLRenderTarget(1, 1);
  private readonly uniforms;
  private readonly mesh: Mesh<BufferGeometry, ShaderMaterial>;
  private volume: VolumeMesh | null = null;
  private isTurned = false;
  private drawing = 0;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly part: WallPart, private readonly drawn: () => void) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.uniforms = {
      layer: { value: null as CanvasTexture | null },
      colours: { value: null as DataTexture | null },
      coded: { value: false },
      bare: { value: false },
      outlines: { value: null as CanvasTexture | null },
      outlined: { value: false },
      extent: { value: new Vector2(part.top_mm, 1) },
      wall: { value: new Vector2(part.top_mm, part.bottom_mm) },
      circumference: { value: 2 * Math.PI * part.radius_mm },
      cut: { value: new Vector2(0, 0) },
      range: { value: new Vector2(part.top_mm, part.bottom_mm) },
      cursor: { value: new Vector3() },
      pinned: { value: new Vector3() },
      pixels: { value: 1 },
      light: { value: 1 },
      picking: { value: false },
    };
    // not blended: where it is pointed at, opacity is part of a number
    const look = { vertexShader: VERTEX, fragmentShader: FRAGMENT, side: DoubleSide, blending: NoBlending };
    const material = new ShaderMaterial({ ...look, uniforms: this.uniforms });
    this.mesh = new Mesh(new BufferGeometry(), material);
    this.mesh.rotation.x = Math.PI;
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
    this.camera.up.set(0, 0, 1); // the mouth is up, and z goes down, as in the panes
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.minDistance = part.radius_mm / 10;
    this.controls.maxDistance = 20 * Math.max(part.radius_mm, part.bottom_mm - part.top_mm);
    this.controls.addEventListener("change", () => this.invalidate());
    for (const [event, isTurned] of [["start", true], ["end", false]] as const) {
      this.controls.addEventListener(event, () => {
        this.isTurned = isTurned;
        if (this.volume) this.invalidate();
      });
    }
    this.look("aslant");
  }

  setSurface({ position, normal, place, triangles }: Surface): void {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(position, 3));
    geometry.setAttribute("normal", new BufferAttribute(normal, 3));
    geometry.setAttribute("place", new BufferAttribute(place, 2));
    geometry.setIndex(new BufferAttribute(triangles, 1));
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
    this.invalidate();
  }

  /** Show the dense volume in place of the wall, of which only marks are left; null: the wall again. */
  setVolume(volume: Volume | null): void {
    if (this.volume) {
      this.scene.remove(this.volume);
      disposeVolume(this.volume);
    }
    const { colours, cut, range, light } = this.uniforms;
    this.volume = volume && volumeMesh(volume, { colours, cut, range, light });
    if (this.volume) this.scene.add(this.volume);
    // marks lie over the volume, in which they would be hidden
    this.uniforms.bare.value = this.volume !== null;
    this.mesh.material.depthTest = this.volume === null;
    this.mesh.renderOrder = 1;
    this.mesh.material.transparent = this.volume !== null;
    this.invalidate();
  }

  setLimit(share: number): void {
    if (this.volume) setLimit(this.volume, share);
    this.invalidate();
  }

  /** Show `picture`, once around the circle and `length_mm` along z; codes where `coded`, else colours. */
  setPicture(picture: HTMLCanvasElement, length_mm: number, coded: boolean): void {
    this.uniforms.layer.value?.dispose();
    this.uniforms.layer.value = wallTexture(picture, this.renderer.capabilities.getMaxAnisotropy());
    this.uniforms.extent.value.set(this.part.top_mm, length_mm);
    this.uniforms.coded.value = coded;
    this.invalidate();
  }

  /** Lay outlines over it: a picture of the whole wall, transparent but for lines; null: none. */
  setOutlines(picture: HTMLCanvasElement | null): void {
    this.uniforms.outlines.value?.dispose();
    this.uniforms.outlines.value = picture && wallTexture(picture, this.renderer.capabilities.getMaxAnisotropy());
    this.uniforms.outlined.value = picture !== null;
    this.invalidate();
  }

  setColours(table: readonly (readonly [number, number, number])[]): void {
    const texture = new DataTexture(new Uint8Array(table.flatMap((colour) => [...colour, 255])), table.length, 1);
    texture.needsUpdate = true;
    this.uniforms.colours.value?.dispose();
    this.uniforms.colours.value = texture;
    this.invalidate();
  }

  /** Cut away `opening_rad` in the middle of which is `theta_rad`, and show only from `from_mm` to `to_mm`. */
  setCut(theta_rad: number, opening_rad: number, from_mm: number, to_mm: number): void {
    this.uniforms.cut.value.set(theta_rad / (2 * Math.PI), opening_rad / (4 * Math.PI));
    this.uniforms.range.value.set(from_mm, to_mm);
    this.invalidate();
  }

  setLight(on: boolean): void {
    this.uniforms.light.value = on ? 1 : 0;
    this.invalidate();
  }

  setMarks({ cursor, pinned }: Marks): void {
    for (const [uniform, spot] of [[this.uniforms.cursor, cursor], [this.uniforms.pinned, pinned]] as const) {
      uniform.value.set((spot?.theta_rad ?? 0) / (2 * Math.PI), spot?.z_mm ?? 0, spot ? 1 : 0);
    }
    this.invalidate();
  }

  /** Look in along the axis, aslant into the mouth, or from the side at all that is shown; the cut toward the eye. */
  look(direction: Direction): void {
    const { radius_mm } = this.part;
    const [from, to] = this.uniforms.range.value.toArray() as [number, number];
    const theta = 2 * Math.PI * this.uniforms.cut.value.x;
    const open = new Vector3(Math.cos(theta), -Math.sin(theta), 0);
    const [length, reach] = [to - from, Math.tan((FIELD_DEG * Math.PI) / 360)];
    const narrow = Math.min(this.camera.aspect, 1);
    const near = Math.min(length / 2, 2.3 * radius_mm);
    const middle = direction === "side" ? (from + to) / 2 : from + near;
    const away = direction === "side"
      ? open.multiplyScalar(Math.max((1.5 * radius_mm) / (reach * this.camera.aspect), (0.53 * length) / reach) + radius_mm)
      // not quite along the axis, but for so much that x is right and y is down
      : direction === "in" ? new Vector3(0, -1e-4, 1).multiplyScalar((1.3 * radius_mm) / (reach * narrow) + near)
        : open.add(new Vector3(0, 0, 0.8)).normalize().multiplyScalar((2.3 * radius_mm) / (reach * narrow));
    this.controls.target.set(0, 0, -middle);
    this.camera.position.copy(this.controls.target).add(away);
    this.controls.update();
    this.invalidate();
  }

  /** Bring a place on the axis into the middle. */
  lookAt(z_mm: number): void {
    const by = -z_mm - this.controls.target.z;
    this.controls.target.z += by;
    this.camera.position.z += by;
    this.controls.update();
  }

  /** Turn about what is looked at, by angles; come nearer by a factor. */
  orbit(across_rad: number, down_rad: number, nearer: number): void {
    const upright = new Quaternion().setFromUnitVectors(this.camera.up, new Vector3(0, 1, 0));
    const from = this.camera.position.clone().sub(this.controls.target).applyQuaternion(upright);
    const place = new Spherical().setFromVector3(from);
    place.theta += across_rad;
    place.phi = Math.min(Math.max(place.phi + down_rad, PITCH_MARGIN_RAD), Math.PI - PITCH_MARGIN_RAD);
    place.radius /= nearer;
    this.camera.position.setFromSpherical(place).applyQuaternion(upright.invert()).add(this.controls.target);
    this.controls.update();
  }

  /** The place on the wall that a pixel of the canvas shows; null where it shows none. */
  pick(x: number, y: number): Place | null {
    const { clientWidth, clientHeight } = this.canvas;
    this.camera.setViewOffset(clientWidth, clientHeight, x, y, 1, 1);
    this.uniforms.picking.value = this.mesh.material.depthTest = true;
    if (this.volume) this.volume.visible = false;
    this.renderer.setRenderTarget(this.target);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    const found = new Uint8Array(4);
    this.renderer.readRenderTargetPixels(this.target, 0, 0, 1, 1, found);
    this.renderer.setRenderTarget(null);
    this.uniforms.picking.value = false;
    this.mesh.material.depthTest = this.volume === null;
    if (this.volume) this.volume.visible = true;
    this.camera.clearViewOffset();
    const [turn, z] = [256 * (found[0] ?? 0) + (found[1] ?? 0), 256 * (found[2] ?? 0) + (found[3] ?? 0)];
    if (z === 0) return null;
    const { top_mm, bottom_mm } = this.part;
    return { theta_rad: wrapped((2 * Math.PI * turn) / 65535), z_mm: top_mm + ((z - 1) / 65534) * (bottom_mm - top_mm) };
  }

  /** Where a point of the bore frame is on the canvas, and whether it lies before the eye. */
  project(x_mm: number, y_mm: number, z_mm: number): { x: number; y: number; isBefore: boolean } {
    const seen = new Vector3(x_mm, -y_mm, -z_mm).project(this.camera);
    return { x: ((seen.x + 1) / 2) * this.canvas.clientWidth, y: ((1 - seen.y) / 2) * this.canvas.clientHeight, isBefore: seen.z < 1 };
  }

  /** The eye in the bore frame, mm. */
  get eye_mm(): [number, number, number] {
    const { x, y, z } = this.camera.position;
    return [x, -y, -z];
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(window.devicePixelRatio || 1);
    this.renderer.setSize(width, height, false);
    this.uniforms.pixels.value = window.devicePixelRatio || 1;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.render(); // at once: a canvas that changes its size is empty until then
    this.drawn();
  }

  /** The cylinder as it is shown, `ratio` pixels for a CSS pixel, as far as graphics go. */
  picture(ratio: number): HTMLCanvasElement {
    const { clientWidth, clientHeight } = this.canvas;
    const made = document.createElement("canvas");
    [made.width, made.height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    const least = Math.min(1, this.largestPicture / 2 / Math.max(made.width, made.height));
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(made.width * least, made.height * least, false);
    this.uniforms.pixels.value = ratio * least;
    this.render();
    made.getContext("2d")?.drawImage(this.canvas, 0, 0, made.width, made.height);
    this.resize();
    return made;
  }

  get largestPicture(): number {
    return this.renderer.capabilities.maxTextureSize;
  }

  dispose(): void {
    this.controls.dispose();
    this.setVolume(null);
    cancelAnimationFrame(this.drawing);
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.uniforms.layer.value?.dispose();
    this.uniforms.colours.value?.dispose();
    this.uniforms.outlines.value?.dispose();
    this.target.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss(); // a browser holds only a few
  }

  private render(): void {
    if (this.volume) aim(this.volume, this.eye_mm, this.isTurned);
    this.renderer.render(this.scene, this.camera);
  }

  private invalidate(): void {
    if (this.drawing) return;
    this.drawing = requestAnimationFrame(() => {
      this.drawing = 0;
      this.render();
      this.drawn();
    });
  }
}
