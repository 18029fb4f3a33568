// Bundles src/ to ../bundle/*.js, in whose first lines stands the digest of what they were made from.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const own = readdirSync("src").filter((name) => /\.(ts|css)$/.test(name)).map((name) => `src/${name}`);
const sources = [...own, "build.mjs", "package.json", "package-lock.json"].sort();
const digest = createHash("sha256");
for (const name of sources) digest.update(name).update("\0").update(readFileSync(name)).update("\0");

const bundle = "../bundle";
const made = digest.digest("hex");
/** The page's program; and that of the cylinder, as large again, which is fetched when it is asked for. */
const programs = [
  { entry: "src/main.ts", name: "page.js", globalName: undefined, contains: "OpenSeadragon (BSD-3-Clause)" },
  { entry: "src/folder.ts", name: "folder.js", globalName: undefined, contains: "" },
  { entry: "src/desk.ts", name: "desk.js", globalName: undefined, contains: "" },
  { entry: "src/cylinder_scene.ts", name: "cylinder.js", globalName: "endoctCylinder", contains: "three.js (MIT)" },
];
for (const { entry, name, globalName, contains } of programs) {
  await build({
    entryPoints: [entry],
    outfile: `${bundle}/${name}`,
    bundle: true,
    minify: true,
    format: "iife",
    globalName,
    target: "es2021",
    charset: "utf8",
    legalComments: "none",
    banner: { js: `/* sources ${made}${contains && `; contains ${contains}, see notices.txt`} */` },
  });
}
for (const name of ["page.css", "desk.css"]) {
  await build({ entryPoints: [`src/${name}`], outfile: `${bundle}/${name}`, minify: true, charset: "utf8" });
}
const notice = (name, program, folder, file, address) => {
  const licence = readFileSync(`node_modules/${folder}/${file}`, "utf8").trim();
  const { version } = JSON.parse(readFileSync(`node_modules/${folder}/package.json`, "utf8"));
  return `${program} contains ${name} ${version}, ${address}\n\n${licence}\n`;
};
writeFileSync(`${bundle}/notices.txt`, [
  notice("OpenSeadragon", "page.js", "openseadragon", "LICENSE.txt", "https://openseadragon.github.io"),
  notice("three.js", "cylinder.js", "three", "LICENSE", "https://threejs.org"),
].join("\n\n"));
