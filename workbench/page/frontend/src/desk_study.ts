/** The page of an open folder: recordings, what can be done with them, and what came of it. */

import { openForm } from "./desk_form";
import { takeDropped } from "./desk_drop";
import { type Pair, PairsPanel } from "./desk_pairs";
import { QueuePanel } from "./desk_queue";
import { ResultsTable } from "./desk_results";
import { ask, message, named, post, type Form, type Found, type Item, type Result, type Unread, type Values } from "./desk_server";
import { followAddress, stepsOf, type Study } from "./desk_steps";
import { button, element, pathText } from "./dom";
import { explain } from "./explain";

const LOOK_MS = 600;

export async function showStudy(main: HTMLElement): Promise<void> {
  await new StudyPage(main).start();
}

class StudyPage {
  private readonly inputs = element("tbody");
  private readonly pairs = new PairsPanel((pairs) => void this.compareAll(pairs));
  private readonly unread = element("div", { class: "unread" });
  private readonly results = new ResultsTable((folders) => this.run("summarise", { folders, output: this.free("results/summary") }), (entry) => stepsOf(entry, this.study), () => void this.showResults());
  private readonly said = element("small", { role: "status" });
  private readonly fault = element("p", { class: "fault", role: "alert" });
  private readonly queue: QueuePanel;
  private forms: Record<string, Form> = {};
  private found: Found = { looking: true, fault: "", inputs: [], unread: { count: 0, files: [] }, pairs: [] };
  private entries: Result[] = [];
  private asked = 0;
  /** Why it is not known what was found, as long as that is so. */
  private lost = "";
  /** What each table shows: it is made anew only for another, as a press of a button that is replaced is lost. */
  private readonly shown = new Map<string, string>();
  private readonly study: Study = {
    form: (command) => this.forms[command], inputs: () => this.found.inputs, paths: () => this.paths(), free: (name) => this.free(name),
    queued: () => this.queue.follow(), refuse: (text) => (this.fault.textContent = text),
  };

  constructor(private readonly main: HTMLElement) {
    const root = main.dataset["root"] ?? "";
    this.queue = new QueuePanel(root, main.dataset["folder"] ?? "", () => void this.look());
  }

  async start(): Promise<void> {
    const head = (...titles: string[]): HTMLElement => element("thead", {}, element("tr", {}, ...titles.map((title) => element("th", { scope: "col" }, title, explain(title)))));
    const look = button("look again", "look through the folder once more", null, () => void this.look());
    const simulate = button("simulate…", "make a specimen with known truth in this folder", null, () => this.run("simulate", { output: this.free("specimen-1"), preset: "quick", seed: 0 }));
    this.main.append(
      element("div", { class: "columns" },
        element("div", {},
          this.fault,
          element("section", { class: "card" }, element("h2", {}, "Recordings", this.said, look, simulate), this.pairs.element,
            element("table", { class: "inputs" }, head("picture", "name", "what it is", "size", "what to do"), this.inputs), this.unread),
          this.results.element),
        this.queue.element));
    try {
      this.forms = await ask<Record<string, Form>>(`${this.main.dataset["root"] ?? ""}/forms.json`);
    } catch (error) {
      this.fault.textContent = message(error);
    }
    takeDropped(this.main, (said) => (this.said.textContent = said), (fault) => (this.fault.textContent = fault), () => void this.look());
    await this.showAll();
    followAddress(this.entries, this.study);
  }

  /** Look through the folder anew. */
  private async look(): Promise<void> {
    this.shown.clear(); // pictures may be others
    try {
      await post("look");
      this.found = { ...this.found, looking: true };
    } catch (error) {
      this.fault.textContent = message(error);
    }
    await this.showAll();
  }

  /** Results are there at once; recordings, as they are found; then it is known which recordings a result is of. */
  private async showAll(): Promise<void> {
    await Promise.all([this.showResults(), this.follow()]);
    await this.showResults();
  }

  private async follow(): Promise<void> {
    for (;;) {
      try {
        this.found = await ask<Found>("found.json");
        if (this.fault.textContent === this.lost) this.fault.textContent = "";
        this.showInputs();
      } catch (error) {
        this.fault.textContent = this.lost = message(error);
      }
      if (!this.found.looking) return;
      await new Promise((done) => setTimeout(done, LOOK_MS));
    }
  }

  private showInputs(): void {
    const { inputs, looking, fault } = this.found;
    this.said.textContent = looking ? `looking… ${inputs.length} found` : inputs.length ? String(inputs.length) : "none found: drop recordings here, or simulate a specimen";
    if (fault) this.fault.textContent = fault;
    const unread = looking ? [] : unreadFiles(this.found.unread, "in this folder");
    const pairs = looking ? [] : this.found.pairs;
    if (this.isNew("inputs", [inputs, this.found.pairs, Object.keys(this.forms)])) this.inputs.replaceChildren(...inputs.map((item) => this.inputRow(item)));
    if (this.isNew("unread", [looking, this.found.unread])) this.unread.replaceChildren(...unread);
    if (this.isNew("pairs", [pairs, this.entries])) this.pairs.show(pairs, this.entries);
  }

  private isNew(table: string, of: unknown): boolean {
    const text = JSON.stringify(of);
    const isNew = this.shown.get(table) !== text;
    this.shown.set(table, text);
    return isNew;
  }

  private inputRow(item: Item): HTMLElement {
    const missing = Object.keys((item.facts["missing"] as Record<string, string> | undefined) ?? {}).length;
    const isRecording = item.kind === "recording";
    const address = named("recording", item.name);
    const picture = isRecording && !item.fault ? [element("img", { src: named("picture.png", item.name), loading: "lazy", alt: "" })] : [];
    const name = isRecording && !item.fault ? element("a", { href: address }, ...pathText(item.name)) : element("span", {}, ...pathText(item.name));
    const doubts = (item.facts["doubts"] as { what: string }[] | undefined) ?? [];
    return element("tr", { "data-name": item.name },
      element("td", {}, ...picture), element("td", {}, name),
      element("td", {}, ...this.whatItIs(item)),
      element("td", {}, String(item.facts["axes"] ?? ""), ...doubts.map((doubt) => element("small", { class: "doubt" }, doubt.what)), ...unreadFiles(item.facts["unread"] as Unread | undefined, "beside it")),
      element("td", {}, element("div", { class: "acts" }, ...(item.fault ? [] : this.acts(item, missing, address)))));
  }

  private whatItIs(item: Item): (Node | string)[] {
    if (item.fault) return [element("span", { class: "fault" }, item.fault)];
    if (item.kind !== "recording") return [{ volume: "CT or labels", plan: "plan of a bore", pose: "pose" }[item.kind]];
    const certainty = String(item.facts["certainty"] ?? "");
    return [String(item.facts["title"] ?? ""), " ", element("small", { title: String(item.facts["seen"] ?? "") }, certainty)];
  }

  private acts(item: Item, missing: number, address: string): Node[] {
    if (item.kind === "pose") return [element("a", { href: named("report", item.name), target: "_blank" }, "report")];
    if (item.kind !== "recording") return [];
    const describe = element("a", { href: address, class: missing ? "chief" : "" }, missing ? `describe it: ${missing} missing` : "sidecar");
    if (missing) return [describe];
    const pair = this.found.pairs.find((both) => both.includes(item.name));
    const sides = pair ? [pair[0], pair[1]] : [item.name];
    const isOfTube = "calibrate" in this.forms;
    return [
      button("unroll…", "unroll this recording", null, () => this.run("unroll", { path: item.name, output: this.free(`results/${flat(item.name)}.zarr`) })),
      button("compare…", "compare it with another side of the same bore", null, () => this.run("compare", this.compared(item, pair))),
      button("pose…", "find the bore in a CT", null, () => this.run("pose", { sides, ct: this.found.inputs.find((each) => each.kind === "volume")?.name ?? "", output: this.free(`results/${flat(item.name)}-pose`) })),
      ...(isOfTube ? [button("calibrate…", "this is a recording of the printed tube: calibrate the instrument", null, () => this.run("calibrate", { modality: String(item.facts["modality"] ?? ""), recording: item.name, target: "", output: this.free(`${flat(item.name)}-calibration.toml`) }))] : []),
      describe,
    ];
  }

  private compared(item: Item, pair: [string, string] | undefined): Values {
    const [a, b] = pair ?? [item.name, ""];
    const at = parentOf(item.name);
    return { a, b, output: this.free(`results/${flat(pair && at ? at : item.name)}`) };
  }

  private async compareAll(pairs: readonly Pair[]): Promise<void> {
    for (const [a, b] of pairs) {
      try {
        const place = placeOf(a);
        if (this.queue.writes(place)) continue; // it is compared already
        const output = this.free(place);
        await post("run", { command: "compare", values: { a, b, output } });
        await this.queue.follow();
      } catch (error) {
        this.fault.textContent = message(error);
      }
    }
  }

  private run(command: string, given: Values): void {
    const form = this.forms[command];
    if (form) openForm(form, given, this.paths(), () => void this.queue.follow());
  }

  private paths(): string[] {
    return [...this.found.inputs.map((item) => item.name), ...this.entries.filter((entry) => !entry.fault).map((entry) => entry.name)];
  }

  /** A name that no result has: the suggested one, with a number where that is taken. */
  private free(name: string): string {
    const taken = new Set([...this.entries.map((entry) => entry.name), ...this.found.inputs.flatMap((item) => [item.name, parentOf(item.name)])]);
    const isWithin = this.entries.some((entry) => name.startsWith(`${entry.name}/`)); // no result lies in another
    const wanted = isWithin ? `results/${flat(name.replace(/^results\//, ""))}` : name;
    const [, stem = wanted, suffix = ""] = /^(.*?)(\.zarr|\.toml)?$/.exec(wanted) ?? [];
    const holds = (place: string): boolean => this.entries.some((entry) => entry.name.startsWith(`${place}/`));
    let free = wanted;
    for (let k = 2; taken.has(free) || holds(free) || this.queue.writes(free); k++) free = `${stem.replace(/-\d+$/, "")}-${k}${suffix}`;
    return free;
  }

  private async showResults(): Promise<void> {
    const asked = ++this.asked;
    try {
      const { entries } = await ask<{ entries: Result[] }>("results.json");
      if (asked < this.asked) return; // whoever asked later gets what is newer
      this.entries = entries;
    } catch (error) {
      this.fault.textContent = message(error);
      return;
    }
    this.showInputs();
    if (this.isNew("results", [this.entries, this.found.inputs])) this.results.show(this.entries); // steps name inputs
  }
}

/** How many files are not recognised, and below it the first of them, each with its reason. */
function unreadFiles(unread: Unread | undefined, where: string): Node[] {
  if (!unread?.count) return [];
  const more = unread.count - unread.files.length;
  const lines = [...unread.files.map((file) => `${file.name}: ${file.why}`), ...(more ? [`and ${more} more`] : [])];
  const summary = `${unread.count} ${unread.count === 1 ? "file" : "files"} not recognised ${where}`;
  return [element("details", {}, element("summary", {}, summary), element("ul", {}, ...lines.map((line) => element("li", {}, line))))];
}

/** Where the comparison of a pair is written, whose first recording is `a`: in folders as the recordings are. */
function placeOf(a: string): string {
  return `results/${parentOf(a) || flat(a)}`;
}

/** A name without folders, and without the suffix of a single file. */
function flat(name: string): string {
  return name.replace(/\.(tiff?|btf|npy|bin|oct|dcm|zarr|avi|mp4|mov|mkv|webm|m4v|png|jpe?g|bmp)$/i, "").replaceAll("/", "-");
}

function parentOf(name: string): string {
  return name.includes("/") ? name.slice(0, name.lastIndexOf("/")) : "";
}
