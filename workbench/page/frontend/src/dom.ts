/** Elements of the page. Texts go in as texts, so that no name from a file becomes markup. */

type Child = Node | string | null;

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Readonly<Record<string, string>> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children.filter((child): child is Node | string => child !== null));
  return made;
}

export function button(label: string, title: string, pressed: boolean | null, act: () => void): HTMLButtonElement {
  const made = element("button", { type: "button", title }, label);
  if (pressed !== null) made.setAttribute("aria-pressed", String(pressed));
  if (!/[\p{L}\p{N}]/u.test(label)) made.setAttribute("aria-label", title); // a sign is read out as nothing
  made.addEventListener("click", act);
  return made;
}

export function select(
  label: string,
  options: readonly (readonly [value: string, title: string])[],
  chosen: string,
  act: (value: string) => void,
): HTMLSelectElement {
  const made = element("select", { "aria-label": label, title: label });
  for (const [value, title] of options) made.append(element("option", { value }, title));
  made.value = chosen;
  made.addEventListener("change", () => act(made.value));
  return made;
}

/** Draw anew what may be written in: its text is taken first, and the focus and the caret are put back. */
export function redraw(body: HTMLElement, draw: () => void): void {
  const active = document.activeElement;
  const at = active instanceof HTMLElement && body.contains(active) ? active.dataset["at"] : undefined;
  const caret = active instanceof HTMLInputElement ? ([active.selectionStart, active.selectionEnd] as const) : null;
  if (at) (active as HTMLElement).blur(); // what is written there is taken
  draw();
  const again = at ? body.querySelector<HTMLElement>(`[data-at="${at}"]`) : null;
  again?.focus();
  if (caret && again instanceof HTMLInputElement) again.setSelectionRange(...caret);
}

/** A canvas's context in CSS pixels, cleared; its store is as fine as the screen. */
export function context(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
  const scale = window.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * scale));
  const height = Math.max(1, Math.round(canvas.clientHeight * scale));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const drawing = canvas.getContext("2d");
  drawing?.setTransform(scale, 0, 0, scale, 0, 0);
  drawing?.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  return drawing;
}

/** Have the browser save a file. */
/** A path as text that breaks after its folders, not inside a name. */
export function pathText(path: string): (string | HTMLElement)[] {
  return path.split("/").flatMap((part, k, all) => (k < all.length - 1 ? [`${part}/`, element("wbr")] : [part]));
}

export function download(file: Blob, name: string): void {
  const link = element("a", { download: name });
  link.href = URL.createObjectURL(file);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
