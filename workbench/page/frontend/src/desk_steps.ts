/** What to do next about a result of the list: buttons that fill in a form, and links to the tools of its page. */

import { openForm } from "./desk_form";
import { message, named, post, type Form, type Item, type NextStep, type Result, type Values } from "./desk_server";
import { button, element } from "./dom";

/** More runs than this nobody begins by one click. */
const MOST_OTHERS = 12;

export interface Study {
  form(command: string): Form | undefined;
  inputs(): readonly Item[];
  paths(): string[];
  /** A name for an output that nothing has. */
  free(name: string): string;
  queued(): Promise<void>;
  refuse(text: string): void;
}

export function stepsOf(entry: Result, study: Study): HTMLElement[] {
  const [first, ...others] = entry.steps.map((step, k) => [act(entry, step, k, study), " ", element("small", {}, step.why)]);
  if (!first) return [];
  const more = element("details", {}, element("summary", {}, `${others.length} more to try`), element("ol", {}, ...others.map((each) => element("li", {}, ...each))));
  return [element("div", { class: "next" }, ...first, ...(others.length ? [more] : []))];
}

/** Do the step that the address asks for, or compare against the masks that it names, as the page of a result leads here. */
export function followAddress(entries: readonly Result[], study: Study): void {
  const asked = new URLSearchParams(location.search);
  const entry = entries.find((each) => each.name === asked.get("of"));
  const step = entry?.steps[Number(asked.get("step") ?? NaN)];
  const [sides, masks] = [asked.getAll("side"), asked.getAll("mask")];
  if (!entry || !(step || masks.length)) return;
  history.replaceState(null, "", location.pathname); // once
  if (!step) {
    const [a = "", b = ""] = sides.map((side) => `${entry.name}/panoramas/${side}.zarr`);
    const form = study.form("compare");
    const values = { a, b, output: study.free(`${entry.name}-drawn`), truth: masks.map((name) => `${entry.name}/masks/${sides[0]}/${name}.png`) };
    if (form) openForm(form, values, study.paths(), () => void study.queued());
    return;
  }
  if (step.does === "describe") location.assign(named("recording", step.recording));
  else compare(entry, step, study);
}

function act(entry: Result, step: NextStep, k: number, study: Study): HTMLElement {
  if (step.values) {
    const others = othersOf(step, study);
    const all = step.does === "other" && others.length > 0 && others.length <= MOST_OTHERS;
    const label = all ? `${step.what.replace("…", "")} ${others.length === 1 ? others[0] : `the ${others.length} others of its kind`}` : step.what;
    return button(label, all ? others.join(", ") : "fill in the form of a new comparison", null, () => compare(entry, step, study));
  }
  if (step.does === "describe") return element("a", { href: named("recording", step.recording) }, step.what);
  if (step.does === "nothing") return element("span", {}, step.what);
  return element("a", { href: `${entry.address}#step=${k}` }, step.what);
}

function compare(entry: Result, step: NextStep, study: Study): void {
  const [values, others] = [step.values ?? {}, othersOf(step, study)];
  if (step.does === "other" && others.length && others.length <= MOST_OTHERS) {
    void compareOthers(entry, values, others, study);
    return;
  }
  const form = study.form("compare");
  if (form) openForm(form, { ...values, output: study.free(entry.name) }, study.paths(), () => void study.queued());
}

async function compareOthers(entry: Result, values: Values, others: readonly string[], study: Study): Promise<void> {
  try {
    for (const b of others) {
      const output = study.free(`${entry.name}-with-${b.replace(/\/[^/]*$/, "").replaceAll("/", "-")}`);
      await post("run", { command: "compare", values: { ...values, b, output } });
    }
  } catch (error) {
    study.refuse(message(error));
  }
  await study.queued();
}

/** The recordings of the study that could be the other side: of the same kind, and described. */
function othersOf(step: NextStep, study: Study): string[] {
  const items = study.inputs();
  const former = items.find((item) => item.name === step.recording);
  if (step.does !== "other" || !former) return [];
  return items.filter((item) => item !== former && item.kind === "recording" && !item.fault && item.facts["modality"] === former.facts["modality"]
    && !Object.keys((item.facts["missing"] as object | undefined) ?? {}).length).map((item) => item.name);
}
