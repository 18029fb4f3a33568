/** The pages of `endoct open`: which of them this is stands in the document. */

import { foldExplanations } from "./explain";
import { showHome } from "./desk_home";
import { showRecording } from "./desk_recording";
import { showStudy } from "./desk_study";

const main = document.querySelector<HTMLElement>("main.desk");
if (main) {
  foldExplanations();
  const pages: Record<string, (main: HTMLElement) => Promise<void>> = { home: showHome, study: showStudy, recording: showRecording };
  void pages[main.dataset["page"] ?? ""]?.(main);
}
