/** The start page: recent folders, and folders to choose from. */

import { ask, message, post } from "./desk_server";
import { button, element } from "./dom";

interface Listed {
  folder: string;
  above: string;
  names: string[];
}

export async function showHome(main: HTMLElement): Promise<void> {
  const root = main.dataset["root"] ?? "";
  const recent = JSON.parse(main.dataset["recent"] ?? "[]") as { folder: string; opened: string; address: string }[];
  const path = element("input", { type: "text", "aria-label": "path of a folder", placeholder: "/path/of/a/folder", spellcheck: "false" });
  const fault = element("p", { class: "fault", role: "alert" });
  const list = element("ul", { class: "folders" });
  const open = async (isSample = false): Promise<void> => {
    try {
      fault.textContent = "";
      const folder = path.value.trim();
      const { address } = await post<{ address: string }>(`${root}/open`, { folder });
      if (isSample) {
        const { names } = await ask<Listed>(`${root}/folders.json?in=${encodeURIComponent(folder)}`);
        let output = "sample";
        for (let k = 2; names.includes(output); k += 1) output = `sample-${k}`;
        await post(`${address}run`, { command: "demo", values: { output } });
      }
      location.assign(address);
    } catch (error) {
      fault.textContent = message(error);
    }
  };
  const look = async (folder: string): Promise<void> => {
    try {
      fault.textContent = "";
      const listed = await ask<Listed>(`${root}/folders.json?in=${encodeURIComponent(folder)}`);
      path.value = listed.folder;
      const rows = listed.names.map((name) =>
        element("li", {}, button(name, `look into ${name}`, null, () => void look(`${listed.folder === "/" ? "" : listed.folder}/${name}`))));
      list.replaceChildren(element("li", {}, button("‹ the folder above", listed.above, null, () => void look(listed.above))), ...rows);
    } catch (error) {
      fault.textContent = message(error);
    }
  };
  const form = element("form", { class: "line" }, path, element("button", { type: "submit", class: "chief" }, "Open this folder"),
    button("Try it here", "simulate a bore in this folder, compare its recordings, and see what comes of it: half a minute", null, () => void open(true)));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    void open();
  });
  const rows = recent.map((each) =>
    element("li", {}, element("a", { href: each.address }, each.folder), " ", element("small", {}, each.opened)));
  main.append(
    ...(rows.length ? [element("section", { class: "card" }, element("h2", {}, "Recent"), element("ul", { class: "recent" }, ...rows))] : []),
    element("section", { class: "card" }, element("h2", {}, "Open a folder"), form, fault, list),
  );
  const quit = button("Quit", "end endoct; runs that are under way go on, and those that wait go on when it is opened again", null, () => {
    post(`${root}/quit`).then(() => main.replaceChildren(element("p", { role: "status" }, "endoct has ended. This window can be closed.")), (error: unknown) => (fault.textContent = message(error)));
  });
  main.append(element("p", { class: "line" }, quit));
  await look("");
}
