import { element } from "./dom";
import { foldExplanations } from "./explain";
import { fold } from "./folding";
import { followSteps } from "./next_steps";
import { openSource } from "./source";
import { Workspace } from "./workspace";

async function start(top: HTMLElement, more: HTMLElement): Promise<void> {
  const source = await openSource();
  source.onGone((text) => top.append(element("p", { class: "gone", role: "alert" }, text)));
  const workspace = new Workspace(source.description, source);
  fold(more);
  foldExplanations();
  workspace.plotQuality(more);
  top.after(workspace.element);
  followSteps(top, workspace.tools);
  // the panes fill what the heading leaves of the window
  const fit = (): void => document.documentElement.style.setProperty("--top", `${top.offsetHeight}px`);
  new ResizeObserver(fit).observe(top);
  fit();
  workspace.start();
  const asked = /^#step=(\d+)$/.exec(location.hash); // the list of results leads to a tool of this page
  if (asked) requestAnimationFrame(() => top.querySelectorAll<HTMLElement>(".next li")[Number(asked[1])]?.querySelector<HTMLElement>(".act")?.click());
}

/** OpenSeadragon adds a style of its own unless there is one already; the page allows none but its file and this, empty. */
function keepOutStyles(): void {
  document.head.append(element("style", { "data-openseadragon-mobile-css": "" }));
}

const top = document.querySelector<HTMLElement>("header.top");
const more = document.querySelector<HTMLElement>("section.more");
if (top && more) {
  keepOutStyles();
  start(top, more).catch((error: unknown) => {
    const message = error instanceof Error ? error.message : String(error);
    top.after(element("p", { class: "failed", role: "alert" }, `The panes could not be opened: ${message}`));
    more.classList.add("ready"); // what can be read without them is read below
  });
}
