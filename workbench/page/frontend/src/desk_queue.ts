/** The queue: every run with its progress, its log and its outcome. It is the same on every page and after a restart. */

import { ask, message, named, post, type Run } from "./desk_server";
import { button, element } from "./dom";

const EVERY_MS = 700;
const IDLE_MS = 3000;
const WORDS: Record<Run["state"], string> = {
  waiting: "waits", running: "runs", done: "done", doubted: "done, with doubts", failed: "failed", cancelled: "cancelled",
  lost: "lost: the machine was turned off, or the process was killed",
};

export class QueuePanel {
  readonly element = element("section", { class: "card queue", "aria-label": "queue" });
  private readonly list = element("ol");
  private readonly fault = element("p", { class: "fault", role: "alert" });
  private readonly count = element("small", { role: "status" });
  private readonly open = new Set<string>();
  private states = "";
  private timer = 0;

  /** `ended` is called whenever a run has ended; `folder` is the one that is open. */
  constructor(private readonly root: string, private readonly folder: string, private readonly ended: () => void) {
    const clear = button("clear", "take off the list what has ended; outputs stay", null, () => void this.act("clear"));
    this.element.append(element("h2", {}, "Queue", this.count, clear), this.fault, this.list);
    void this.follow();
  }

  async follow(): Promise<void> {
    window.clearTimeout(this.timer);
    let busy = false;
    try {
      const { runs } = await ask<{ runs: Run[] }>(`${this.root}/queue.json`);
      this.fault.textContent = "";
      busy = runs.some((run) => run.state === "running" || run.state === "waiting");
      await this.show(runs);
    } catch (error) {
      this.fault.textContent = message(error);
    }
    this.timer = window.setTimeout(() => void this.follow(), busy ? EVERY_MS : IDLE_MS);
  }

  private async show(runs: readonly Run[]): Promise<void> {
    const [now, waiting] = ["running", "waiting"].map((state) => runs.filter((run) => run.state === state).length);
    this.count.textContent = now || waiting ? `${now} under way, ${waiting} waiting` : runs.length ? "nothing is under way" : "empty";
    const rows = await Promise.all(runs.slice().reverse().map((run) => this.row(run)));
    const active = document.activeElement instanceof HTMLElement ? document.activeElement.dataset["act"] : undefined;
    this.list.replaceChildren(...rows);
    if (active) this.list.querySelector<HTMLElement>(`[data-act="${active}"]`)?.focus();
    const states = runs.map((run) => `${run.name} ${run.state === "running" || run.state === "waiting"}`).join();
    if (this.states && states !== this.states) this.ended();
    this.states = states;
  }

  private async row(run: Run): Promise<HTMLElement> {
    const busy = run.state === "running" || run.state === "waiting";
    const act = (label: string, title: string, does: () => void): HTMLButtonElement => {
      const made = button(label, title, null, does);
      made.dataset["act"] = `${label} ${run.name}`;
      return made;
    };
    const more = this.open.has(run.name);
    const log = more ? [element("code", { class: "command" }, run.command), element("pre", {}, (await this.log(run.name)) || "nothing printed yet")] : [];
    const stages = Object.entries(run.stages).map(([title, share]) =>
      element("label", { class: "stage" }, title, element("progress", { max: "1", value: String(share) })));
    const here = run.folder === this.folder;
    const report = here && run.verb === "pose" && (run.state === "done" || run.state === "doubted") && run.output;
    return element("li", { class: run.state },
      element("div", { class: "line" },
        element("strong", {}, run.verb), element("span", { class: "output", title: run.command }, run.output || run.command),
        element("span", { class: "state" }, WORDS[run.state], run.seconds === null ? "" : ` ${time(run.seconds)}`)),
      ...stages,
      ...(busy || run.state === "failed" ? [element("p", { class: run.state === "failed" ? "fault" : "" }, run.state === "running" ? "" : run.last_line)] : []),
      ...(here ? [] : [element("small", {}, run.folder)]),
      element("div", { class: "line buttons" },
        ...(report ? [element("a", { href: named("report", run.output), target: "_blank" }, "report")] : []),
        ...(busy ? [act("cancel", "end it; nothing is left half-written", () => void this.act(`${run.name}/cancel`))]
          : [act("again", "queue the same command once more", () => void this.act(`${run.name}/repeat`))]),
        act(more ? "less" : "log", "what it printed, and its command line", () => this.toggle(run.name))),
      ...log);
  }

  private async log(name: string): Promise<string> {
    try {
      return (await ask<{ log: string }>(`${this.root}/queue/${name}/log.json`)).log;
    } catch (error) {
      return message(error);
    }
  }

  private toggle(name: string): void {
    if (!this.open.delete(name)) this.open.add(name);
    void this.follow();
  }

  private async act(address: string): Promise<void> {
    try {
      await post(`${this.root}/queue/${address}`);
      await this.follow();
    } catch (error) {
      this.fault.textContent = message(error);
    }
  }
}

export function time(seconds: number): string {
  return seconds < 100 ? `${Math.round(seconds)} s` : `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}
