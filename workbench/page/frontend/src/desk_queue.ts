/** The queue: every run with its progress, its log and its outcome. It is the same on every page and after a restart. */

import { ask, message, named, post, type Run } from "./desk_server";
import { button, element, pathText } from "./dom";
import { explain } from "./explain";

const EVERY_MS = 700;
const IDLE_MS = 3000;
const WORDS: Record<Run["state"], string> = {
  waiting: "waits", running: "runs", done: "done", unanswered: "done, without an answer", failed: "failed", cancelled: "cancelled",
  lost: "lost: the machine was turned off, or the process was killed",
};

export class QueuePanel {
  readonly element = element("section", { class: "card queue", "aria-label": "queue" });
  private readonly list = element("ol");
  private readonly fault = element("p", { class: "fault", role: "alert" });
  private readonly count = element("small", { role: "status" });
  private readonly rows = new Map<string, RunRow>();
  private timer = 0;

  /** `ended` is called whenever a run has ended; `folder` is the one that is open. */
  constructor(private readonly root: string, private readonly folder: string, private readonly ended: () => void) {
    const clear = button("clear what has ended", "take it off the list; outputs stay", null, () => void this.act("clear"));
    this.element.append(element("h2", {}, "Queue", explain("queue"), this.count, clear), this.fault, this.list);
    void this.follow();
  }

  async follow(): Promise<void> {
    window.clearTimeout(this.timer);
    let busy = false;
    try {
      const { runs } = await ask<{ runs: Run[] }>(`${this.root}/queue.json`);
      this.fault.textContent = "";
      busy = runs.some(isOpen);
      this.show(runs);
    } catch (error) {
      this.fault.textContent = message(error);
    }
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.follow(), busy ? EVERY_MS : IDLE_MS);
  }

  /** Whether a run that waits, or is under way, writes `output` in this folder. */
  writes(output: string): boolean {
    return [...this.rows.values()].some((row) => row.writes(output));
  }

  async act(address: string): Promise<void> {
    try {
      await post(`${this.root}/queue/${address}`);
      await this.follow();
    } catch (error) {
      this.fault.textContent = message(error);
    }
  }

  async log(name: string): Promise<string> {
    try {
      return (await ask<{ log: string }>(`${this.root}/queue/${name}/log.json`)).log;
    } catch (error) {
      return message(error);
    }
  }

  /** Rows are kept, and so is what the pointer is on; only what has changed in them is set. */
  private show(runs: readonly Run[]): void {
    const [now, waiting] = ["running", "waiting"].map((state) => runs.filter((run) => run.state === state).length);
    this.count.textContent = now || waiting ? `${now} under way, ${waiting} waiting` : runs.length ? "nothing is under way" : "empty";
    const names = new Set(runs.map((run) => run.name));
    for (const [name, row] of this.rows) {
      if (names.has(name)) continue;
      row.element.remove();
      this.rows.delete(name);
    }
    let hasEnded = false;
    for (const run of runs) {
      let row = this.rows.get(run.name);
      if (!row) {
        row = new RunRow(this, run, run.folder === this.folder);
        this.rows.set(run.name, row);
      }
      hasEnded = row.update(run) || hasEnded;
    }
    // what is open stands first, in the order in which it runs; then what has ended, the latest first
    const order = [...runs.filter(isOpen), ...runs.filter((run) => !isOpen(run)).reverse()];
    order.forEach((run, k) => {
      const row = this.rows.get(run.name)?.element;
      if (row && this.list.children[k] !== row) this.list.insertBefore(row, this.list.children[k] ?? null);
    });
    if (hasEnded) this.ended();
  }
}

class RunRow {
  readonly element: HTMLElement;
  private readonly state = element("span", { class: "state" });
  private readonly stages = element("div");
  private readonly said = element("p");
  private readonly links = element("span");
  private readonly details = element("div", { hidden: "" });
  private readonly log = element("pre");
  private readonly cancel: HTMLButtonElement;
  private readonly again: HTMLButtonElement;
  private readonly more: HTMLButtonElement;
  private last: Run | null = null;

  constructor(private readonly queue: QueuePanel, run: Run, private readonly isHere: boolean) {
    this.cancel = button("cancel", "end it; nothing is left half-written", null, () => void queue.act(`${run.name}/cancel`));
    this.again = button("again", "queue the same command once more", null, () => void queue.act(`${run.name}/repeat`));
    this.more = button("log", "what it printed, and its command line", false, () => void this.toggle());
    this.details.append(element("code", { class: "command" }, run.command), this.log);
    this.element = element("li", {},
      element("div", { class: "line" },
        element("strong", {}, run.verb), element("span", { class: "output", title: run.command }, ...pathText(run.output || run.command)), this.state),
      this.stages, this.said, ...(isHere ? [] : [element("small", {}, run.folder)]),
      element("div", { class: "line buttons" }, this.links, this.cancel, this.again, this.more),
      this.details);
  }

  /** Set what `run` has changed, and say whether it has ended since. */
  update(run: Run): boolean {
    const before = this.last;
    this.last = run;
    const isNew = before?.state !== run.state;
    this.element.className = run.state;
    this.state.textContent = WORDS[run.state] + (run.seconds === null ? "" : ` ${time(run.seconds)}`);
    this.setStages(run.stages);
    this.said.textContent = run.state === "failed" ? run.last_line : "";
    this.said.className = run.state === "failed" ? "fault" : "";
    this.cancel.hidden = !isOpen(run);
    this.again.hidden = isOpen(run);
    const hasReport = this.isHere && run.verb === "pose" && run.output && (run.state === "done" || run.state === "unanswered");
    if (isNew) this.links.replaceChildren(...(hasReport ? [element("a", { href: named("report", run.output), target: "_blank" }, "report")] : []));
    if (!this.details.hidden && (isNew || isOpen(run))) void this.read();
    return before !== null && isOpen(before) && !isOpen(run);
  }

  writes(output: string): boolean {
    return this.isHere && this.last !== null && isOpen(this.last) && this.last.output === output;
  }

  private setStages(stages: Readonly<Record<string, number>>): void {
    const titles = Object.keys(stages);
    if (titles.join() !== [...this.stages.children].map((each) => each.firstChild?.textContent).join()) {
      this.stages.replaceChildren(...titles.map((title) => element("label", { class: "share" }, title, element("progress", { max: "1" }))));
    }
    this.stages.querySelectorAll("progress").forEach((bar, k) => (bar.value = stages[titles[k] ?? ""] ?? 0));
  }

  private async toggle(): Promise<void> {
    this.details.hidden = !this.details.hidden;
    this.more.setAttribute("aria-pressed", String(!this.details.hidden));
    if (!this.details.hidden) await this.read();
  }

  private async read(): Promise<void> {
    this.log.textContent = (await this.queue.log(this.last?.name ?? "")) || "nothing printed yet";
  }
}

function isOpen(run: Run): boolean {
  return run.state === "running" || run.state === "waiting";
}

export function time(seconds: number): string {
  return seconds < 100 ? `${Math.round(seconds)} s` : `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}
