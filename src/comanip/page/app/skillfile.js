// A skill file that somebody opens: read strictly, as learned/file.py does. What it says is data, and never markup or code.

import { ascii, sha256 } from "./files.js";
import { prepared } from "./prepare.js";

const FIELDS = "format version role law settings axes dt_s units workspace_m ends_m model clock provenance sha256 paths onsets_s starts_m".split(" ");
const MOST_BYTES = 20e6, DEEPEST = 40;

// JSON as Python reads it, and each object in canonical form beside it: numbers keep their letters, so that the checksum can be made.
export function parsed(text) {
  let at = 0;
  const fail = what => { throw new Error(`not a skill file: ${what} at letter ${at + 1}`); };
  const blank = () => { while (at < text.length && " \t\n\r".includes(text[at])) at++; };
  const word = (letters, value) => { if (!text.startsWith(letters, at)) fail("unknown word"); at += letters.length; return [value, letters]; };
  const string = () => {
    const found = /"(?:[^"\\\u0000-\u001f]|\\(?:["\\/bfnrt]|u[0-9a-fA-F]{4}))*"/y;
    found.lastIndex = at;
    const match = found.exec(text);
    if (!match) fail("a text that does not end");
    at += match[0].length;
    const value = JSON.parse(match[0]);
    return [value, quoted(value)];
  };
  const number = () => {
    const found = /-?(?:0|[1-9]\d*)(?:\.\d+)?(?:[eE][+-]?\d+)?/y;
    found.lastIndex = at;
    const match = found.exec(text);
    if (!match || !match[0]) fail("neither number, text, list nor object");
    at += match[0].length;
    const value = Number(match[0]);
    if (!Number.isFinite(value)) fail("a number beyond all numbers");
    return [value, match[0]];
  };
  const value = depth => {
    if (depth > DEEPEST) fail("too deep a nest");
    blank();
    const letter = text[at];
    if (letter === "{") {
      at++;
      const content = Object.create(null), letters = Object.create(null);
      blank();
      if (text[at] === "}") { at++; return [content, "{}", letters]; }
      for (;;) {
        blank();
        const [key] = string();
        if (key in content) fail(`field ${JSON.stringify(key).slice(0, 40)} a second time`);
        blank();
        if (text[at++] !== ":") fail("no colon");
        [content[key], letters[key]] = value(depth + 1);
        blank();
        const next = text[at++];
        if (next === "}") break;
        if (next !== ",") fail("no comma");
      }
      return [content, canonical(letters), letters];
    }
    if (letter === "[") {
      at++;
      const content = [], letters = [];
      blank();
      if (text[at] === "]") { at++; return [content, "[]"]; }
      for (;;) {
        const [one, said] = value(depth + 1);
        content.push(one);
        letters.push(said);
        blank();
        const next = text[at++];
        if (next === "]") return [content, `[${letters.join(",")}]`];
        if (next !== ",") fail("no comma");
      }
    }
    if (letter === '"') return string();
    if (letter === "t") return word("true", true);
    if (letter === "f") return word("false", false);
    if (letter === "n") return word("null", null);
    return number();
  };
  const [content, , letters] = value(0);
  blank();
  if (at < text.length) fail("something after the end");
  return { content, letters };
}

export function quoted(text) { return ascii(JSON.stringify(text)).replace(/\\u([0-9a-f]{4})/gi, (_, digits) => `\\u${digits.toLowerCase()}`); }

export function canonical(letters, without = "") {
  return `{${Object.keys(letters).filter(key => key !== without).sort().map(key => `${quoted(key)}:${letters[key]}`).join(",")}}`;
}

export function checkedSkill(text) {
  if (text.length > MOST_BYTES) throw new Error(`larger than ${MOST_BYTES / 1e6} MB: no skill file is`);
  const { content, letters } = parsed(text);
  if (!letters || content.format !== "comanip.skill") throw new Error('not a skill file: it lacks "format": "comanip.skill"');
  if (content.version !== 3) throw new Error(`written as version ${String(content.version).slice(0, 20)}; the page reads version 3: learn it again with this comanip`);
  const has = Object.keys(content), stray = has.filter(key => !FIELDS.includes(key)), absent = FIELDS.filter(key => !has.includes(key));
  if (stray.length || absent.length) throw new Error(`unknown fields [${stray.join(", ").slice(0, 80)}], missing fields [${absent.join(", ")}]`);
  if (sha256(canonical(letters, "sha256")) !== content.sha256) throw new Error("the content does not match its sha256: it was damaged or edited by hand");
  return content;
}

// The content of a skill file for the page's task, and the numbers that the world takes: see prepare.js.
export function readSkill(text, config) {
  const content = checkedSkill(text), axes = config.task.axes.map(axis => axis.name);
  if (!["leader", "follower", "natural"].includes(content.role)) throw new Error("it states no role, leader or follower");
  if (content.axes.join() !== axes.join()) throw new Error(`it is for the axes ${content.axes.join(", ").slice(0, 60)}; this page lifts along ${axes.join(", ")}`);
  if (!content.paths.length) throw new Error("it stores no path of its lessons: learn it again with this comanip");
  check(content, axes.length);
  return { content, numbers: skills => numbersFor(skills, config) };
}

// What the page can be told with these skills -> the numbers of that robot.
export function numbersFor(skills, config) {
  const told = ["leader", "follower"].filter(role => skills[role]);
  return Object.fromEntries([...told, ...(told.length === 2 ? ["auto"] : [])].map(role => [role, prepared(skills, role, config.prepare)]));
}

// Shapes and numbers of all that `prepared` reads.
function check(content, d) {
  const fail = what => { throw new Error(`a field is missing or malformed: ${what}`); };
  const list = (value, size, what) => { if (!Array.isArray(value) || (size >= 0 && value.length !== size)) fail(what); return value; };
  const number = (value, what) => { if (typeof value !== "number" || !Number.isFinite(value)) fail(what); return value; };
  const rows = (value, n, width, what) => list(value, n, what).forEach(row => list(row, width, what).forEach(x => number(x, what)));
  const { model } = content;
  if (!model || model.kind !== "hmm") fail("model: the page runs hmm alone");
  const D = list(model.channels, -1, "model.channels").length, K = list(model.means, -1, "model.means").length;
  const known = ["position", "force", "velocity"].flatMap(group => content.axes.map(axis => `${group}.${axis}`));
  if (K < 1 || K > 256 || D !== known.length || !known.every(name => model.channels.includes(name))) fail("model.channels: position, force and velocity of each axis");
  rows(model.means, K, D, "model.means");
  list(model.covariances, K, "model.covariances").forEach(S => rows(S, D, D, "model.covariances"));
  rows(model.transition, K, K, "model.transition");
  list(model.initial, K, "model.initial").forEach(x => number(x, "model.initial"));
  rows(content.workspace_m, d, 2, "workspace_m");
  rows(content.ends_m, -1, d, "ends_m");
  if (!content.ends_m.length || content.paths.length > 16 || !(content.dt_s >= 0.0002 && content.dt_s <= 0.05)) fail("ends_m, paths or dt_s");
  list(content.onsets_s, -1, "onsets_s").forEach(x => number(x, "onsets_s"));
  if (typeof content.settings !== "object" || content.settings === null) fail("settings");
  Object.values(content.settings).forEach(x => number(x, "settings"));
  for (const path of content.paths) {
    const n = list(path.position_m, -1, "paths").length;
    if (n < 2 || n > 100000 || !(number(path.step_s, "step_s") > 0)) fail("paths");
    rows(path.position_m, n, d, "position_m");
    rows(path.force_n, n, d, "force_n");
    list(path.spread_m, n, "spread_m").forEach(x => number(x, "spread_m"));
    rows(path.ends_m, -1, d, "paths.ends_m");
  }
}
