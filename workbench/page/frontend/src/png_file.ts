/** PNG with what a canvas does not write: how large a pixel is, and the caption. */

/** `png` with its resolution in dots per inch, so that other programs know the size that is meant, and its caption. */
export async function described(png: Blob, dpi: number, caption: string): Promise<Blob> {
  const whole = new Uint8Array(await png.arrayBuffer());
  const perMetre = Math.round(dpi / 0.0254);
  const size = new DataView(new ArrayBuffer(9));
  size.setUint32(0, perMetre);
  size.setUint32(4, perMetre);
  size.setUint8(8, 1); // per metre
  const text = new TextEncoder().encode(`Description\0\0\0\0\0${caption}`);
  const after = 8 + 25; // the signature and the first chunk, which says how many pixels there are
  return new Blob([whole.slice(0, after), chunk("pHYs", new Uint8Array(size.buffer)), chunk("iTXt", text), whole.slice(after)], { type: "image/png" });
}

function chunk(name: string, content: Uint8Array): Uint8Array<ArrayBuffer> {
  const made = new Uint8Array(12 + content.length);
  const view = new DataView(made.buffer);
  view.setUint32(0, content.length);
  made.set(new TextEncoder().encode(name), 4);
  made.set(content, 8);
  view.setUint32(8 + content.length, checksum(made.subarray(4, 8 + content.length)));
  return made;
}

/** CRC-32 as PNG has it. */
function checksum(of: Uint8Array): number {
  let sum = 0xffffffff;
  for (const byte of of) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit += 1) sum = sum & 1 ? (sum >>> 1) ^ 0xedb88320 : sum >>> 1;
  }
  return (sum ^ 0xffffffff) >>> 0;
}
