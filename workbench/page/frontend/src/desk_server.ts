/** What the pages ask the server of `endoct open`, and what it answers. */

import type { FramePicture } from "./source";

export interface Item {
  name: string;
  kind: "recording" | "volume" | "plan" | "pose";
  facts: Record<string, unknown>;
  fault: string;
}

/** Files that nothing reads: how many, and of the first ones why. */
export interface Unread {
  count: number;
  files: { name: string; why: string }[];
}

export interface Found {
  looking: boolean;
  fault: string;
  inputs: Item[];
  unread: Unread;
  pairs: [endoscope: string, oct: string][];
}

/** What can be done about a result; `values` of a form that compares again. */
export interface NextStep {
  does: "compare" | "other" | "show" | "read" | "landmarks" | "draw" | "describe" | "nothing";
  what: string;
  why: string;
  /** The recording that it concerns. */
  recording: string;
  values?: Values;
}

export interface Result {
  name: string;
  kind: "comparison" | "recording" | "specimen" | "summary";
  about: string;
  level: "trusted" | "uncertain" | "doubted" | "unaligned" | null;
  headline: string;
  jaccard: number | null;
  interval: [number, number] | null;
  doubts: string[];
  steps: NextStep[];
  written: string;
  /** The recordings that were compared, and whether one was changed since. */
  of: string[];
  changed: boolean;
  note: string;
  fault: string;
  address: string;
  thumbnail: string;
}

export interface Run {
  name: string;
  command: string;
  verb: string;
  folder: string;
  output: string;
  state: "waiting" | "running" | "done" | "unanswered" | "failed" | "cancelled" | "lost";
  seconds: number | null;
  stages: Record<string, number>;
  last_line: string;
}

export interface FormField {
  name: string;
  flag: string;
  kind: "text" | "number" | "choice" | "switch" | "path" | "paths" | "lines";
  about: string;
  required: boolean;
  choices: string[];
  default: string | number | boolean | null;
  whole: boolean;
  hint: string;
}

export interface Form {
  command: string;
  title: string;
  fields: FormField[];
}

export type Values = Record<string, string | number | boolean | string[]>;

export interface SidecarField {
  key: string;
  kind: "number" | "choice" | "text" | "toml";
  unit: string;
  about: string;
  choices: string[];
  low: number | null;
  high: number | null;
  required: boolean;
  one_of: string;
  value: string;
  stated: string;
  cited: string;
  default: string;
}

export interface Sidecar {
  sidecar: string;
  modality: string;
  title: string;
  stated_by: string;
  digest: string | null;
  fields: SidecarField[];
  missing: Record<string, string>;
}

export interface Preview {
  missing: Record<string, string>;
  fault: string;
  frame: number;
  frames: number;
  pictures: FramePicture[];
}

async function answered<T>(asked: Promise<Response>): Promise<T> {
  let response: Response;
  try {
    response = await asked;
  } catch {
    throw new Error("the server does not answer; run `endoct open` again: what was queued is still there");
  }
  if (!response.ok) throw new Error(await response.text());
  return (await response.json()) as T;
}

export function ask<T>(address: string): Promise<T> {
  return answered(fetch(address, { cache: "no-store" }));
}

export function post<T>(address: string, content: unknown = {}): Promise<T> {
  return answered(
    fetch(address, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(content) }),
  );
}

export function named(address: string, name: string): string {
  return `${address}?name=${encodeURIComponent(name)}`;
}

export function message(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
