// Recordings in and out: what was done on the page as a recording of comanip, and one that somebody opens as a lesson. What a file
// says is data; names in it are text.

import { ascii, repr, round, sha256 } from "./files.js";

const SIGNATURE = "# comanip recording ", CSV_VERSION = 2, MOST_LETTERS = 60e6, MOST_FRAMES = 200000;
// Each channel of a take: name -> [key in the take, unit]
const CHANNELS = {
  "hand.position": ["position", "m"], "hand.velocity": ["velocity", "m/s"], "hand.sensor_force": ["sensor_force", "N"], "hand.force_estimate": ["force", "N"],
  "command.velocity": ["command_velocity", "m/s"], "partner.force": ["pull_n", "N"], "partner.position": ["end_position", "m"], "beam.tilt": ["tilt", "rad"], "hand.true_force": ["true_force", "N"],
};
const FORCES = ["hand.force_estimate", "hand.force", "hand.sensor_force"];

// What stands with every recording: eq. (3) needs the object, and learning needs the role.
function aboutTake(task, extra) {
  return { task: task.name, load_mass_kg: task.mass_kg, load_share: task.share, gravity_m_per_s2: task.gravity, made_by: "comanip page: a person at a pointer, exact beam", ...extra };
}

// {metadata, channels: [{name, unit, frame, axes, time (T,), rows (T, d)}]}
export function recordingOf(task, take, extra) {
  const axes = task.axes.map(axis => axis.name), time = take.position.map((_, t) => round(t * take.dt));
  const channels = Object.entries(CHANNELS).map(([name, [key, unit]]) => ({ name, unit, frame: "task", axes, time, rows: take[key] }));
  return { metadata: aboutTake(task, extra), channels };
}

// As formats/csv_file.write_csv: stamps of all channels in one column, a cell without a value where a channel has none.
export function csvOf({ metadata, channels }) {
  const layout = Object.fromEntries(channels.map(c => [c.name, { unit: c.unit, frame: c.frame, axes: c.axes }]));
  const first = `${SIGNATURE}${ascii(JSON.stringify({ version: CSV_VERSION, channels: layout, metadata }))}`;
  const time = [...new Set(channels.flatMap(c => c.time))].sort((a, b) => a - b), at = new Map(time.map((t, n) => [t, n]));
  const columns = channels.map(c => { const rows = new Array(time.length).fill(null); c.time.forEach((t, n) => { rows[at.get(t)] = c.rows[n]; }); return rows; });
  const lines = [["time", ...channels.flatMap(c => c.axes.map(axis => cell(`${c.name}.${axis}`)))].join(",")];
  time.forEach((t, n) => lines.push([repr(t), ...channels.flatMap((c, k) => columns[k][n]?.map(repr) ?? c.axes.map(() => ""))].join(",")));
  const body = lines.join("\n") + "\n";
  return `${first}\n# sha256=${sha256(`${first}\n${body}`)}\n${body}`;
}

function cell(text) { return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text; }

export function recordingCsv(task, take, extra) { return csvOf(recordingOf(task, take, extra)); }

// A recording that comanip wrote as CSV. Errors in one line.
export function readCsv(text) {
  if (text.length > MOST_LETTERS) throw new Error(`larger than ${MOST_LETTERS / 1e6} MB: no lesson is`);
  const letters = text.replace(/\r\n/g, "\n");
  if (!letters.startsWith(SIGNATURE)) throw new Error("no recording of comanip: comanip convert FILE lesson.csv --position ... --force ... makes one of other tables");
  const [first, second] = letters.split("\n", 2), checked = /^# sha256=([0-9a-f]{64})$/.exec(second ?? "");
  const head = readable(() => JSON.parse(first.slice(SIGNATURE.length)));
  if (head.version > CSV_VERSION) throw new Error(`written as version ${String(head.version).slice(0, 20)}; this page reads up to ${CSV_VERSION}`);
  const body = letters.slice(first.length + 1 + (checked ? second.length + 1 : 0));
  if (checked && checked[1] !== sha256(`${first}\n${body}`)) throw new Error("its checksum (line 2) does not fit: a digit was changed, or lines are missing");
  const channels = readable(() => Object.entries(head.channels).map(([name, c]) => ({ name, unit: String(c.unit), frame: String(c.frame), axes: c.axes.map(String), time: [], rows: [] })));
  const width = 1 + channels.reduce((sum, c) => sum + c.axes.length, 0), lines = body.slice(behindHeader(body)).split("\n");
  if (lines[lines.length - 1] === "") lines.pop();
  lines.forEach((line, n) => {
    const cells = line.split(",");
    if (cells.length !== width) throw new Error(`frame ${n} has ${cells.length} cells, want ${width}: cut or ragged`);
    let from = 1;
    for (const channel of channels) {
      const own = cells.slice(from, (from += channel.axes.length));
      if (own.every(one => one !== "")) { channel.time.push(numberOf(cells[0], n, "time")); channel.rows.push(own.map(one => numberOf(one, n, channel.name))); }
    }
  });
  return { metadata: readable(() => ({ ...head.metadata })), channels };
}

function readable(made) {
  try { return made(); } catch (error) { throw new Error(`line 1 is a damaged comanip header (${String(error.message).slice(0, 60)})`); }
}

// Behind the line of names, in which a name with a comma or a line break stands in quotes
function behindHeader(body) {
  let quoted = false;
  for (let n = 0; n < body.length; n++) {
    if (body[n] === '"') quoted = !quoted;
    else if (body[n] === "\n" && !quoted) return n + 1;
  }
  return body.length;
}

function numberOf(text, frame, name) {
  const value = text === "nan" ? NaN : text === "inf" ? Infinity : text === "-inf" ? -Infinity : text.trim() === "" ? undefined : Number(text);
  if (value === undefined || (Number.isNaN(value) && text !== "nan")) throw new Error(`${name.slice(0, 60)}, frame ${frame}: ${JSON.stringify(text.slice(0, 40))} is not a number`);
  return value;
}

// A recording as a lesson of this page's task: {take, recording, time, role or ""}. Errors in one line.
export function lessonOf(recording, task) {
  const axes = task.axes.map(axis => axis.name), named = name => recording.channels.find(one => one.name === name), fail = what => { throw new Error(what); };
  const place = named("hand.position") ?? fail(`no channel hand.position; it has: ${recording.channels.map(one => one.name).join(", ").slice(0, 120) || "none"}`);
  if (place.axes.join() !== axes.join()) fail(`it is along ${place.axes.join(", ").slice(0, 60)}; this page carries along ${axes.join(", ")}`);
  if (place.unit !== "m") fail(`hand.position is in ${JSON.stringify(place.unit.slice(0, 20))}; want m`);
  const force = FORCES.map(named).find(one => one && one.rows.length && one.axes.join() === axes.join()) ?? fail(`no force along ${axes.join(", ")}: want ${FORCES.join(" or ")}`);
  const { time, rows } = place, n = rows.length;
  if (n < 10 || n > MOST_FRAMES) fail(`${n} frames of hand.position; want 10 to ${MOST_FRAMES}`);
  if (time.some((t, i) => !Number.isFinite(t) || (i && t <= time[i - 1]))) fail("the stamps of hand.position do not increase");
  if (!rows.every(row => row.every(Number.isFinite)) || !force.rows.every(row => row.every(Number.isFinite))) fail("a position or force that is no finite number");
  const end = named("partner.position"), tilt = named("beam.tilt"), seen = (one, width) => (one && one.rows.length && one.axes.length === width ? heldAt(one, time) : null);
  const take = {
    dt: (time[n - 1] - time[0]) / (n - 1), start: rows[0].slice(), position: rows, force: heldAt(force, time), end_position: seen(end, axes.length) ?? rows,
    tilt: tilt && tilt.rows.length ? heldAt(tilt, time) : rows.map(() => [0]),
  };
  const { role } = recording.metadata;
  return { take, recording, time, role: role === "leader" || role === "follower" ? role : "" };
}

// Rows of a channel at these stamps: the last that was known then
function heldAt(channel, time) {
  let at = 0;
  return time.map(t => { while (at + 1 < channel.time.length && channel.time[at + 1] <= t + 1e-9) at++; return channel.rows[at]; });
}

// The part of a recording between two stamps, both included; stamps stay what they were.
export function within(recording, from, to) {
  const channels = recording.channels.map(c => { const kept = c.time.map((t, n) => n).filter(n => c.time[n] >= from && c.time[n] <= to); return { ...c, time: kept.map(n => c.time[n]), rows: kept.map(n => c.rows[n]) }; });
  return { metadata: { ...recording.metadata, trimmed_to_s: [from, to] }, channels };
}
