/** Texts in the fonts that every reader of PDF has: Helvetica for Latin, Symbol for the Greek and the signs we use. */

const WIN_ANSI = "€\0‚ƒ„…†‡ˆ‰Š‹Œ\0Ž\0\0‘’“”•–—˜™š›œ\0žŸ"; // from 0x80
const SYMBOL: Readonly<Record<string, number>> = {
  "−": 0x2d, α: 0x61, β: 0x62, δ: 0x64, Δ: 0x44, θ: 0x71, λ: 0x6c, μ: 0x6d, π: 0x70, ρ: 0x72, σ: 0x73, φ: 0x66, ω: 0x77,
  "≤": 0xa3, "≥": 0xb3, "≈": 0xbb, "⌀": 0xc6, "→": 0xae,
};

/** Part of a text in one font: its codes. */
export interface Run {
  symbol: boolean;
  codes: number[];
}

/** The text in runs, or null where neither font has all of its letters. */
export function runsOf(text: string): Run[] | null {
  const runs: Run[] = [];
  for (const letter of text) {
    const latin = winAnsi(letter);
    const code = latin ?? SYMBOL[letter];
    if (code === undefined) return null;
    const last = runs[runs.length - 1];
    if (last && last.symbol === (latin === undefined)) last.codes.push(code);
    else runs.push({ symbol: latin === undefined, codes: [code] });
  }
  return runs;
}

function winAnsi(letter: string): number | undefined {
  const code = letter.codePointAt(0) ?? 0;
  if ((code >= 0x20 && code < 0x7f) || (code >= 0xa0 && code <= 0xff)) return code;
  const place = code > 0xff ? WIN_ANSI.indexOf(letter) : -1;
  return place < 0 ? undefined : 0x80 + place;
}

export function hex(codes: readonly number[]): string {
  return `<${codes.map((code) => code.toString(16).padStart(2, "0")).join("")}>`;
}

/** A text for the properties of a document, in any script. */
export function property(text: string): string {
  const codes = [0xfe, 0xff];
  for (let k = 0; k < text.length; k += 1) codes.push(text.charCodeAt(k) >> 8, text.charCodeAt(k) & 0xff);
  return hex(codes);
}
