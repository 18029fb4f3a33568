/** A picture of the whole wall as a texture, which goes on over θ = 0. */

import { CanvasTexture, ClampToEdgeWrapping, LinearFilter, LinearMipmapLinearFilter, RepeatWrapping } from "three";

export function wallTexture(picture: HTMLCanvasElement, anisotropy: number): CanvasTexture {
  const texture = new CanvasTexture(picture);
  texture.wrapS = RepeatWrapping;
  texture.wrapT = ClampToEdgeWrapping;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.magFilter = LinearFilter;
  texture.anisotropy = anisotropy;
  texture.premultiplyAlpha = true;
  texture.flipY = false;
  return texture;
}
