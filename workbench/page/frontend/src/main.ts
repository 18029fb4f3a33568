import { element } from "./dom";
import { details, heading } from "./heading";
import { openSource } from "./source";
import { Workspace } from "./workspace";

async function start(): Promise<void> {
  const source = await openSource();
  const { description } = source;
  document.title = `endoct: ${description.title}`;
  const workspace = new Workspace(description, source);
  document.body.append(heading(description), workspace.element, details(description, workspace.quality()));
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
