/** Export: choose what another program opens, see the command line that writes it, and get the file. */

import { button, download, element, select } from "./dom";
import type { Exported, ExportFormat, Source } from "./source";

const WAIT_MS = 150;

export async function askToExport(source: Source): Promise<void> {
  const said = element("p", { class: "said", "aria-live": "polite" }, "looking what there is…");
  const body = element("div");
  const close = button("close", "close the dialog", null, () => dialog.close());
  const dialog = element("dialog", { class: "save export", "aria-label": "export" }, element("h2", {}, "Export for another program"), body, said);
  dialog.addEventListener("keydown", (event) => event.stopPropagation()); // keys are for its fields, not for the panes
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
  try {
    const { formats, beside } = await source.exports();
    said.textContent = "";
    fill(body, formats, beside, source, said, close);
  } catch (error) {
    said.textContent = message(error);
    body.append(close);
  }
}

function fill(body: HTMLElement, formats: readonly ExportFormat[], beside: string, source: Source, said: HTMLElement, close: HTMLElement): void {
  const options = element("div", { class: "fields" });
  const line = element("code", { class: "command", tabindex: "0", "aria-label": "command line" });
  let chosen = formats.find((one) => !one.refused);
  let given: Record<string, string> = {};
  let [timer, checks] = [0, 0];
  const asked = (): Exported => ({ format: chosen?.name ?? "", options: given });
  const check = async (): Promise<void> => {
    const mine = ++checks;
    let [command, refused] = ["", ""];
    try {
      ({ command } = await source.exportLine(asked()));
    } catch (error) {
      refused = message(error);
    }
    if (mine === checks) [line.textContent, said.textContent] = [command, refused]; // a slow answer undoes no later one
  };
  const later = (): void => {
    window.clearTimeout(timer);
    timer = window.setTimeout(() => void check(), WAIT_MS);
  };
  const get = button("download", "have the browser save the file", null, () => void write(async () => {
    const { file, name } = await source.exportFile(asked());
    download(file, name);
    return `${name} is downloaded.`;
  }));
  const save = button("save beside the result", beside || "the result is a part of another output", null, () =>
    void write(async () => `Saved: ${(await source.saveExport(asked())).saved}`));
  const write = async (act: () => Promise<string>): Promise<void> => {
    const pressed = document.activeElement;
    [get.disabled, save.disabled, said.textContent] = [true, true, "writing…"];
    try {
      said.textContent = await act();
    } catch (error) {
      said.textContent = message(error);
    }
    [get.disabled, save.disabled] = [chosen?.is_folder ?? true, !beside];
    if (pressed instanceof HTMLElement) pressed.focus();
  };
  const choose = (one: ExportFormat): void => {
    chosen = one;
    given = Object.fromEntries(one.options.map((option) => [option.name, option.choices?.[0] ?? ""]));
    options.replaceChildren(...one.options.map(({ name, about, choices }) => {
      const set = (value: string): void => {
        given[name] = value;
        later();
      };
      if (choices) return element("label", {}, `${about} `, select(about, choices.map((each) => [each, each || "usual"] as const), choices[0] ?? "", set));
      const typed = element("input", { type: "text", inputmode: "decimal", placeholder: "usual", "aria-label": about });
      typed.addEventListener("input", () => set(typed.value.trim()));
      return element("label", {}, `${about} `, typed);
    }));
    get.disabled = one.is_folder;
    save.disabled = !beside;
    void check();
  };
  const list = element("div", { class: "formats", role: "radiogroup", "aria-label": "format" }, ...formats.map((one) => {
    const radio = element("input", { type: "radio", name: "format", value: one.name });
    radio.disabled = one.refused !== "";
    radio.checked = one === chosen;
    radio.addEventListener("change", () => choose(one));
    return element("label", { class: one.refused ? "none" : "" }, radio, element("b", {}, one.name), element("code", {}, one.suffix),
      element("span", {}, one.refused || `${one.opens}${one.is_folder ? "; a folder: saved beside the result" : ""}`));
  }));
  body.append(list, options, line, element("footer", {}, get, save, close));
  if (chosen) choose(chosen);
}

function message(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
