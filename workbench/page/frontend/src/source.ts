/** Where the page's data come from: the server that served it, or the file that it is frozen into. */

import type { Description } from "./description";
import type { Judged, Pair, Placed, SessionState } from "./landmarks";
import type { Drawing, SavedMasks } from "./painting";
import { OVERLAP_PX, TILE_PX, Wall, wrapped } from "./wall";

/** What the server answers where what the page shows was replaced or deleted. */
const GONE = 410;

export type Values = Record<string, number | null>;
/** By layer, lines as flat θ in rad, z in mm, θ, z, …; θ goes on beyond a turn where a line does. */
export type Outlines = Record<string, number[][]>;

/** A picture of a single frame; `axis` says how θ is found in it. */
export interface FramePicture {
  title: string;
  about: string;
  x_label: string;
  y_label: string;
  x_extent: [number, number];
  y_extent: [number, number];
  curves: Record<string, [number | null, number | null][]>;
  /** Where places of the wall are seen in it: at every z and at even steps of θ from 0; null where they are not. */
  seen: { z_mm: number[]; x: (number | null)[][]; y: (number | null)[][] } | null;
  axis: "theta" | "ring" | null;
  ring: Record<"inner_x" | "inner_y" | "inner" | "outer_x" | "outer_y" | "outer" | "roll_rad", number> | null;
  image: string;
}

/** How far a recording was read again, for pictures of all of its frames. */
export interface Reading {
  state: "absent" | "unread" | "reading" | "read" | "failed";
  share: number;
  said: string;
}

/** What `endoct export` can write of the result: `refused` says why not; `choices` null: a number. */
export interface ExportFormat {
  name: string;
  suffix: string;
  opens: string;
  refused: string;
  is_folder: boolean;
  options: { name: string; about: string; choices: string[] | null }[];
}

export interface Exported {
  format: string;
  options: Record<string, string>;
}

export interface Source {
  description: Description;
  /** The finest level of tiles of a layer that there is here. */
  finestLevel(layer: string): number;
  tileUrl(layer: string, level: number, column: number, row: number): string;
  outlines(): Promise<Outlines>;
  /** The pictures of a frame; null where there are none. */
  pictures(side: string, place: number): Promise<FramePicture[] | null>;
  reading(side: string, begin: boolean): Promise<Reading>;
  /** A relief as `readRelief` takes it; null where there is none. */
  relief(layer: string): Promise<ArrayBuffer | null>;
  /** The dense volume as `readVolume` takes it; null where there is none. */
  volume(): Promise<ArrayBuffer | null>;
  /** The values of all layers of numbers at a place; null where they are not to be had. */
  values(theta_rad: number, z_mm: number): Promise<Values | null>;
  /** The landmarks to begin with; null where there can be none. */
  session(): Promise<SessionState | null>;
  /** What landmark pairs say; null where nobody can be asked. */
  judge(pairs: readonly Pair[]): Promise<Judged | null>;
  /** Whether a session is written where the comparison lies; else it is downloaded. */
  readonly canSave: boolean;
  /** Save a session, and return the digest of its file. */
  saveSession(session: SessionState, placed: Placed): Promise<string | null>;
  /** The masks that were drawn on the page, by side. */
  masks(): Promise<SavedMasks>;
  /** The outlines of a drawing as it would be saved, in the frame that is shown. */
  outlineDrawing(drawing: Drawing): Promise<{ lines: number[][] }>;
  /** Save a drawing, and return the command line that scores against it. */
  saveMask(drawing: Drawing & { rater: string; session: string }): Promise<{ command: string }>;
  /** How well each side agrees with a mask that was saved. */
  scoreMask(side: string, mask: string): Promise<{ scores: Record<string, { jaccard: number | null; interval: [number, number] | null }>; command: string }>;
  /** What can be exported, and the folder in which it may stay, "" for none. */
  exports(): Promise<{ formats: ExportFormat[]; beside: string }>;
  exportLine(asked: Exported): Promise<{ command: string }>;
  exportFile(asked: Exported): Promise<{ file: Blob; name: string }>;
  saveExport(asked: Exported): Promise<{ saved: string }>;
  /** Call `told` once what the page shows was replaced or deleted, with a text that says so. */
  onGone(told: (text: string) => void): void;
  /** Find out whether what the page shows is still there. */
  checkPresent(): void;
}

const UNREACHED = "the server does not answer; start endoct again, and load this page anew";
const NOT_SERVED = "masks are drawn, and files exported, where the page is served (endoct serve)";

interface Frozen {
  description: Description;
  outlines: Outlines;
  pictures: Record<string, Record<string, FramePicture[]>>;
  /** By layer, by level, by "column_row": a picture, its kind and its bytes in base64. */
  tiles: Record<string, Record<string, string>[]>;
  session: SessionState | null;
  /** By layer, in base64. */
  reliefs: Record<string, string>;
  type: string;
}

export async function openSource(): Promise<Source> {
  const frozen = document.getElementById("frozen");
  return frozen ? frozenSource(JSON.parse(frozen.textContent ?? "") as Frozen) : servedSource();
}

/** Asks the server about one output, by its digest: another that lies in its place by now is never taken for it. */
class Asker {
  gone = "";
  private readonly output = document.querySelector<HTMLMetaElement>('meta[name="endoct-output"]')?.content ?? "";
  private readonly told: ((text: string) => void)[] = [];

  address(path: string): string {
    return `${path}${path.includes("?") ? "&" : "?"}of=${this.output}`;
  }

  async ask(path: string, how?: RequestInit): Promise<Response> {
    const answer = await fetch(this.address(path), how).catch(() => new Response(UNREACHED, { status: 503 }));
    if (answer.status === GONE && !this.gone) {
      this.gone = await answer.clone().text();
      for (const tell of this.told) tell(this.gone);
    }
    return answer;
  }

  send(path: string, body: unknown): Promise<Response> {
    return this.ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
  }

  onGone(tell: (text: string) => void): void {
    if (this.gone) tell(this.gone);
    else this.told.push(tell);
  }
}

async function servedSource(): Promise<Source> {
  const asker = new Asker();
  const answer = await asker.ask("description.json");
  if (!answer.ok) throw new Error(await answer.text());
  const description = (await answer.json()) as Description;
  const version = Date.now().toString(36);
  const finest = new Map(description.layers.map((layer) => [layer.key, layer.finest_level]));
  return {
    description,
    finestLevel: (layer) => finest.get(layer) ?? 0,
    tileUrl: (layer, level, column, row) =>
      asker.address(`tiles/${version}/${encodeURIComponent(layer)}/${level}/${column}_${row}.png`),
    outlines: async () => {
      const found = await asker.ask("outlines.json");
      return found.ok ? ((await found.json()) as Outlines) : {};
    },
    pictures: async (side, place) => {
      const found = await asker.ask(`pictures/${version}/${encodeURIComponent(side)}/${place}.json`);
      return found.ok ? ((await found.json()) as FramePicture[]) : null;
    },
    reading: async (side, begin) => {
      const found = await asker.ask(`reading/${encodeURIComponent(side)}`, { method: begin ? "POST" : "GET" });
      if (!found.ok) return { state: "failed", share: 0, said: await found.text() };
      return (await found.json()) as Reading;
    },
    relief: async (layer) => {
      const found = await asker.ask(`relief/${version}/${encodeURIComponent(layer)}.bin`);
      return found.ok ? found.arrayBuffer() : null;
    },
    volume: async () => {
      const found = await asker.ask(`volume/${version}.bin`);
      return found.ok ? found.arrayBuffer() : null;
    },
    values: async (theta_rad, z_mm) => {
      const found = await asker.ask(`values.json?theta_rad=${theta_rad}&z_mm=${z_mm}`);
      return found.ok ? ((await found.json()) as Values) : null;
    },
    session: async () => {
      if (description.sides.length < 2) return null;
      const found = await asker.ask("session.json");
      return found.ok ? ((await found.json()) as SessionState) : null;
    },
    judge: async (pairs) => {
      const found = await asker.send("landmarks.json", { pairs });
      return found.ok ? ((await found.json()) as Judged) : null;
    },
    get canSave() {
      return !asker.gone;
    },
    saveSession: async (session, placed) => {
      if (asker.gone) return download(session, placed);
      const found = await asker.send("session.json", { ...placed, based_on: session.saved });
      if (found.status === GONE) throw new Error(`${await found.text()}. Nothing was saved; save again to download the session file.`);
      if (!found.ok) throw new Error(await found.text());
      return ((await found.json()) as { saved: string }).saved;
    },
    masks: async () => answered<SavedMasks>(await asker.ask("masks.json")),
    outlineDrawing: async (drawing) => answered(await asker.send("drawing.json", drawing)),
    saveMask: async (drawing) => answered(await asker.send("masks.json", drawing)),
    scoreMask: async (side, mask) => answered(await asker.send("score.json", { side, mask })),
    exports: async () => answered(await asker.ask("exports.json")),
    exportLine: async (asked) => answered(await asker.send("export-line.json", asked)),
    exportFile: async (asked) => {
      const found = await asker.send("export", asked);
      if (!found.ok) throw new Error(await found.text());
      const [, name = ""] = /filename\*=utf-8''(.+)$|filename="(.+)"/.exec(found.headers.get("content-disposition") ?? "")?.filter(Boolean) ?? [];
      return { file: await found.blob(), name: decodeURIComponent(name) };
    },
    saveExport: async (asked) => answered(await asker.send("export.json", asked)),
    onGone: (told) => asker.onGone(told),
    checkPresent: () => void asker.ask("present"),
  };
}

/** What the server answered. Throws its text where it refused. */
async function answered<T>(response: Response): Promise<T> {
  if (!response.ok) throw new Error(await response.text());
  return (await response.json()) as T;
}

/** Have the browser save a session file. */
function download(session: SessionState, placed: Placed): null {
  const text = JSON.stringify({ format: "endoct-session-1", sides: session.sides, ...placed }, null, 1);
  const link = document.createElement("a");
  link.download = "session.json";
  link.href = URL.createObjectURL(new Blob([`${text}\n`], { type: "application/json" }));
  link.click();
  return null;
}

/** Read values back from the codes of the finest tiles that there are. */
async function frozenValues(frozen: Frozen, theta_rad: number, z_mm: number): Promise<Values> {
  const wall = new Wall(frozen.description.wall);
  const values: Values = {};
  for (const layer of frozen.description.layers) {
    if (layer.kind !== "scalar") continue;
    const level = (frozen.tiles[layer.key]?.length ?? 1) - 1;
    const turns = wall.turnsOf({ theta_rad: wrapped(theta_rad), z_mm });
    const [x, y] = [Math.floor(turns.x * wall.widthPx(level)), Math.floor(turns.y * wall.widthPx(level))];
    const [column, row] = [Math.floor(x / TILE_PX), Math.floor(y / TILE_PX)];
    const bytes = frozen.tiles[layer.key]?.[level]?.[`${column}_${row}`];
    if (bytes === undefined) {
      values[layer.key] = null;
      continue;
    }
    const [top, left] = [Math.max(row * TILE_PX - OVERLAP_PX, 0), column * TILE_PX - OVERLAP_PX];
    const code = await codeAt(`data:${frozen.type};base64,${bytes}`, x - left, y - top);
    values[layer.key] = code === null ? null : layer.low + (code / 255) * (layer.high - layer.low);
  }
  return values;
}

async function codeAt(url: string, x: number, y: number): Promise<number | null> {
  const picture = new Image();
  picture.src = url;
  await picture.decode();
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 1;
  const drawing = canvas.getContext("2d", { willReadFrequently: true }); // graphics memory is slow to read
  drawing?.drawImage(picture, -x, -y);
  const found = drawing?.getImageData(0, 0, 1, 1).data;
  return found && found[3] === 255 ? (found[0] ?? null) : null;
}

function frozenSource(frozen: Frozen): Source {
  const empty = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7";
  return {
    description: frozen.description,
    finestLevel: (layer) => (frozen.tiles[layer]?.length ?? 1) - 1,
    tileUrl: (layer, level, column, row) => {
      const bytes = frozen.tiles[layer]?.[level]?.[`${column}_${row}`];
      return bytes === undefined ? empty : `data:${frozen.type};base64,${bytes}`;
    },
    outlines: () => Promise.resolve(frozen.outlines),
    pictures: (side, place) => Promise.resolve(frozen.pictures[side]?.[String(place)] ?? null),
    relief: (layer) => {
      const text = frozen.reliefs[layer];
      return Promise.resolve(text === undefined ? null : Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);
    },
    volume: () => Promise.resolve(null),
    reading: () => Promise.resolve({ state: "absent", share: 0, said: "" }),
    values: (theta_rad, z_mm) => frozenValues(frozen, theta_rad, z_mm),
    session: () => Promise.resolve(frozen.session),
    judge: () => Promise.resolve(null),
    canSave: false,
    saveSession: (session, placed) => Promise.resolve(download(session, placed)),
    masks: () => Promise.reject(new Error(NOT_SERVED)),
    outlineDrawing: () => Promise.reject(new Error(NOT_SERVED)),
    saveMask: () => Promise.reject(new Error(NOT_SERVED)),
    scoreMask: () => Promise.reject(new Error(NOT_SERVED)),
    exports: () => Promise.reject(new Error(NOT_SERVED)),
    exportLine: () => Promise.reject(new Error(NOT_SERVED)),
    exportFile: () => Promise.reject(new Error(NOT_SERVED)),
    saveExport: () => Promise.reject(new Error(NOT_SERVED)),
    onGone: () => undefined,
    checkPresent: () => undefined,
  };
}
