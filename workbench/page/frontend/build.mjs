// Bundles src/ to ../bundle/page.js, in whose first line stands the digest of what it was made from.
import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const own = readdirSync("src").filter((name) => /\.(ts|css)$/.test(name)).map((name) => `src/${name}`);
const sources = [...own, "build.mjs", "package.json", "package-lock.json"].sort();
const digest = createHash("sha256");
for (const name of sources) digest.update(name).update("\0").update(readFileSync(name)).update("\0");

const bundle = "../bundle";
const program = { bundle: true, minify: true, format: "iife", target: "es2021", charset: "utf8", legalComments: "none" };
await build({ ...program, entryPoints: ["src/folder.ts"], outfile: `${bundle}/folder.js` });
await build({
  ...program,
  entryPoints: ["src/main.ts"],
  outfile: `${bundle}/page.js`,
  banner: { js: `/* sources ${digest.digest("hex")}; contains OpenSeadragon (BSD-3-Clause), see notices.txt */` },
});
await build({ entryPoints: ["src/page.css"], outfile: `${bundle}/page.css`, minify: true, charset: "utf8" });
const licence = readFileSync("node_modules/openseadragon/LICENSE.txt", "utf8").trim();
const { version } = JSON.parse(readFileSync("node_modules/openseadragon/package.json", "utf8"));
writeFileSync(`${bundle}/notices.txt`, `page.js contains OpenSeadragon ${version}, https://openseadragon.github.io\n\n${licence}\n`);
