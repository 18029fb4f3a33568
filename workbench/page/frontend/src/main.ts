import { element } from "./dom";
import { details, heading } from "./heading";
import { openSource } from "./source";
import { Workspace } from "./workspace";

async function start(): Promise<void> {
  const source = await openSource();
  const { description } = source;
  document.title = `endoct: ${description.title}`;
  const workspace = new Workspace(description, source);
  const top = heading(description);
  document.body.append(top, workspace.element, details(description, workspace.quality()));
  // the panes fill what the heading leaves of the window
  const fit = (): void => document.documentElement.style.setProperty("--top", `${top.offsetHeight}px`);
  new ResizeObserver(fit).observe(top);
  fit();
  workspace.start();
}

/** OpenSeadragon adds a style of its own unless there is one already; the page allows none but its file and this, empty. */
function keepOutStyles(): void {
  document.head.append(element("style", { "data-openseadragon-mobile-css": "" }));
}

keepOutStyles();
start().catch((error: unknown) => {
  const message = error instanceof Error ? error.message : String(error);
  document.body.append(element("p", { class: "failed", role: "alert" }, `The page could not be opened: ${message}`));
});
