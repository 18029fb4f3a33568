/** The program that draws the cylinder: fetched when first asked for, or already in the file that the page is. */

import type { CylinderScene } from "./cylinder_scene";
import { element } from "./dom";

export interface CylinderProgram {
  CylinderScene: typeof CylinderScene;
}

declare global {
  var endoctCylinder: CylinderProgram | undefined;
}

/** Why nothing can be drawn in three dimensions here; "" where it can. */
export function whyNoCylinder(): string {
  const found = document.createElement("canvas").getContext("webgl2");
  found?.getExtension("WEBGL_lose_context")?.loseContext(); // browsers hold only a few
  return found ? "" : "This browser has no WebGL 2, or it is switched off: there is no view in three dimensions.";
}

export async function cylinderProgram(): Promise<CylinderProgram> {
  if (!globalThis.endoctCylinder) {
    await new Promise((done, failed) => {
      const script = element("script", { src: "cylinder.js" });
      script.addEventListener("load", done);
      script.addEventListener("error", () => failed(new Error("the program for it could not be fetched; is the server still there?")));
      document.head.append(script);
    });
  }
  const program = globalThis.endoctCylinder;
  if (!program) throw new Error("the program for it does not run here");
  return program;
}
