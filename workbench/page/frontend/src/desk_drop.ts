/** Files and folders that are dropped on a study's page, copied into its folder one after the other. */

import { message, named } from "./desk_server";

const MOST_SAID = 3;

type Dropped = [path: string, file: File];

/** Take what is dropped on `target`; `say` how far it is, `refuse` with why, and `done` when all of it is there. */
export function takeDropped(target: HTMLElement, say: (text: string) => void, refuse: (text: string) => void, done: () => void): void {
  target.addEventListener("dragover", (event) => {
    event.preventDefault();
    target.classList.add("dropping");
  });
  target.addEventListener("dragleave", () => target.classList.remove("dropping"));
  target.addEventListener("drop", (event) => {
    event.preventDefault();
    target.classList.remove("dropping");
    // they have to be taken before anything is waited for; a file that no folder holds may have no entry
    const dropped = [...(event.dataTransfer?.items ?? [])].map((item) => item.webkitGetAsEntry() ?? item.getAsFile());
    void copy(dropped.filter((each) => each !== null), say, refuse).then(done);
  });
}

async function copy(dropped: (FileSystemEntry | File)[], say: (text: string) => void, refuse: (text: string) => void): Promise<void> {
  try {
    refuse("");
    const refused: string[] = [];
    const files = (await Promise.all(dropped.map((each) => (each instanceof File ? [[each.name, each] as Dropped] : filesOf(each, ""))))).flat();
    for (const [number, [path, file]] of files.entries()) {
      say(`copying ${number + 1} of ${files.length}: ${path}`);
      const response = await fetch(named("file", path), { method: "POST", headers: { "content-type": "application/octet-stream" }, body: file });
      if (!response.ok) refused.push(await response.text()); // the others are copied all the same
    }
    if (refused.length) throw new Error(`${files.length - refused.length} of ${files.length} copied. ${refused.slice(0, MOST_SAID).join(". ")}`);
  } catch (error) {
    refuse(message(error));
  }
}

async function filesOf(entry: FileSystemEntry, above: string): Promise<Dropped[]> {
  if (entry.name.startsWith(".")) return [];
  const path = `${above}${entry.name}`;
  if (entry.isFile) return [[path, await new Promise<File>((got, failed) => (entry as FileSystemFileEntry).file(got, failed))]];
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const found: FileSystemEntry[] = [];
  for (;;) {
    // a reader gives some hundred at a time
    const some = await new Promise<FileSystemEntry[]>((got, failed) => reader.readEntries(got, failed));
    if (!some.length) break;
    found.push(...some);
  }
  return (await Promise.all(found.map((each) => filesOf(each, `${path}/`)))).flat();
}
