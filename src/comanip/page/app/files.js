// Files in and out: what somebody keeps is made here and goes nowhere else.

export function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let n = 0; n < text.length; n++) bytes[n] = text.charCodeAt(n);
  return bytes;
}

export function numbersOf(base64) {
  const bytes = bytesOf(base64);
  return new Float64Array(bytes.buffer, 0, bytes.length / 8);
}

// A name as part of a file's name
export function plain(name) { return name.replace(/[^\w-]+/g, "-").slice(0, 60) || "x"; }

// Each name once: a second "leader-1" is "leader-1-2".
export function each(names) {
  const taken = new Set();
  return names.map(name => {
    let found = name;
    for (let n = 2; taken.has(found); n++) found = `${name}-${n}`;
    taken.add(found);
    return found;
  });
}

export function download(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name.replace(/[^\w.-]+/g, "-");
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 4000);
}

let silence = 0;
// One line for the person; text, whatever it holds.
export function tell(text) {
  const box = document.getElementById("say");
  box.textContent = String(text).replace(/[\u0000-\u001f\u007f-\u009f\u200e\u200f\u2028-\u202e\u2066-\u2069]/g, " ").slice(0, 400);
  box.hidden = false;
  clearTimeout(silence);
  silence = setTimeout(() => { box.hidden = true; }, 7000);
}

const K = [];
const FIRST = [];
for (let n = 2, found = 0; found < 64; n++) {
  let prime = true;
  for (let i = 2; i * i <= n; i++) if (n % i === 0) { prime = false; break; }
  if (!prime) continue;
  if (found < 8) FIRST.push((Math.sqrt(n) % 1) * 4294967296 >>> 0);
  K.push((Math.cbrt(n) % 1) * 4294967296 >>> 0);
  found++;
}

// FIPS 180-4, of bytes or text; hexadecimal.
export function sha256(content) {
  const bytes = typeof content === "string" ? new TextEncoder().encode(content) : content, size = bytes.length;
  const padded = new Uint8Array(((size + 8) >> 6) * 64 + 64), view = new DataView(padded.buffer), h = FIRST.slice(), w = new Uint32Array(64);
  padded.set(bytes);
  padded[size] = 128;
  view.setUint32(padded.length - 8, Math.floor(size / 536870912));
  view.setUint32(padded.length - 4, (size << 3) >>> 0);
  const turn = (x, n) => (x >>> n) | (x << (32 - n));
  for (let at = 0; at < padded.length; at += 64) {
    for (let i = 0; i < 16; i++) w[i] = view.getUint32(at + 4 * i);
    for (let i = 16; i < 64; i++) {
      const a = w[i - 15], b = w[i - 2];
      w[i] = w[i - 16] + (turn(a, 7) ^ turn(a, 18) ^ (a >>> 3)) + w[i - 7] + (turn(b, 17) ^ turn(b, 19) ^ (b >>> 10));
    }
    let [a, b, c, d, e, f, g, i] = h;
    for (let n = 0; n < 64; n++) {
      const one = (i + (turn(e, 6) ^ turn(e, 11) ^ turn(e, 25)) + ((e & f) ^ (~e & g)) + K[n] + w[n]) | 0;
      const two = ((turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) | 0;
      i = g; g = f; f = e; e = (d + one) | 0; d = c; c = b; b = a; a = (one + two) | 0;
    }
    [a, b, c, d, e, f, g, i].forEach((x, n) => { h[n] = (h[n] + x) | 0; });
  }
  return h.map(x => (x >>> 0).toString(16).padStart(8, "0")).join("");
}

// Python's repr of a float, for numbers as large as these
export function repr(x) {
  if (Number.isNaN(x)) return "nan";
  if (!Number.isFinite(x)) return x > 0 ? "inf" : "-inf";
  if (Object.is(x, -0)) return "-0.0";
  const text = String(x);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

export function round(t) { return Math.round(t * 1e9) / 1e9; }
export function ascii(text) { return text.replace(/[^ -~]/g, c => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`); }
