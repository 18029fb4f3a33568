/** The form of a command, in a dialog: what it takes, and the command line that it stands for. */

import { message, post, type Form, type FormField, type Values } from "./desk_server";
import { button, element } from "./dom";

const WAIT_MS = 250;

type Control = HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement;

/** Open the form of a command with `given` values; `paths` are suggested where one is wanted. */
export function openForm(form: Form, given: Values, paths: readonly string[], queued: () => void): void {
  const controls = new Map<string, Control>();
  const line = element("code", { class: "command" });
  const fault = element("p", { class: "fault", role: "alert" });
  const run = element("button", { type: "submit", class: "chief" }, "Run");
  const copy = button("copy", "copy the command line", null, () => void navigator.clipboard.writeText(line.textContent ?? ""));
  const suggested = element("datalist", { id: "suggested" }, ...paths.map((path) => element("option", { value: path })));
  const fields = form.fields.map((field) => [field, row(field, given[field.name], controls)] as const);
  const chief = fields.filter(([field]) => field.required || field.name in given).map(([, made]) => made);
  const others = fields.filter(([field]) => !field.required && !(field.name in given)).map(([, made]) => made);
  const body = element("form", { method: "dialog" },
    element("h2", {}, form.title), ...chief,
    ...(others.length ? [element("details", {}, element("summary", {}, `${others.length} more`), ...others)] : []),
    suggested, element("div", { class: "line" }, line, copy), fault,
    element("div", { class: "line buttons" }, run, button("Close", "do not run it", null, () => dialog.close())));
  const dialog = element("dialog", { "aria-label": form.title }, body);

  const values = (): Values => Object.fromEntries(form.fields.flatMap((field) => {
    const control = controls.get(field.name);
    return control ? [[field.name, valueOf(field, control)] as const] : [];
  }));
  let [waiting, checks] = [0, 0];
  const check = async (isNew = false): Promise<void> => {
    const mine = ++checks;
    let [command, refused] = ["", ""];
    try {
      ({ command } = await post<{ command: string }>("command", { command: form.command, values: values() }));
    } catch (error) {
      refused = message(error);
    }
    if (mine !== checks) return; // a slow answer undoes no later one
    line.textContent = command;
    fault.textContent = isNew ? "" : refused; // nothing is wrong before anything was typed
    run.disabled = !command;
  };
  body.addEventListener("input", () => {
    window.clearTimeout(waiting);
    waiting = window.setTimeout(() => void check(), WAIT_MS);
  });
  body.addEventListener("submit", (event) => {
    event.preventDefault();
    run.disabled = true;
    post("run", { command: form.command, values: values() }).then(
      () => {
        dialog.close();
        queued();
      },
      (error: unknown) => {
        fault.textContent = message(error);
        run.disabled = false;
      },
    );
  });
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  void check(true);
}

function row(field: FormField, given: Values[string] | undefined, controls: Map<string, Control>): HTMLElement {
  const control = made(field, given);
  control.id = `field-${field.name}`;
  controls.set(field.name, control);
  const name = field.name.replaceAll("_", " ");
  const label = element("label", { for: control.id }, name, field.flag ? "" : "", element("small", {}, field.about));
  return element("div", { class: `field ${field.kind}` }, label, control);
}

function made(field: FormField, given: Values[string] | undefined): Control {
  if (field.kind === "switch") {
    const box = element("input", { type: "checkbox" });
    box.checked = given === true;
    return box;
  }
  if (field.kind === "choice") {
    const none = field.default === null ? [element("option", { value: "" }, "")] : [];
    const list = element("select", {}, ...none, ...field.choices.map((choice) => element("option", { value: choice }, choice)));
    list.value = String(given ?? field.default ?? "");
    return list;
  }
  if (field.kind === "lines" || field.kind === "paths") {
    const area = element("textarea", { rows: "2", spellcheck: "false", placeholder: field.kind === "paths" ? "one a line" : `${field.hint}, one a line` });
    area.value = Array.isArray(given) ? given.join("\n") : "";
    return area;
  }
  const attributes: Record<string, string> = { type: "text", spellcheck: "false", placeholder: field.hint };
  if (field.kind === "path") attributes["list"] = "suggested";
  if (field.kind === "number") attributes["inputmode"] = "decimal";
  const input = element("input", attributes);
  input.value = given !== undefined ? String(given) : field.default !== null ? String(field.default) : "";
  return input;
}

function valueOf(field: FormField, control: Control): Values[string] {
  if (control instanceof HTMLInputElement && field.kind === "switch") return control.checked;
  if (field.kind === "lines" || field.kind === "paths") return control.value.split("\n").map((each) => each.trim()).filter(Boolean);
  return control.value.trim();
}
