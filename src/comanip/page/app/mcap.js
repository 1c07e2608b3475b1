// Recordings as MCAP with ROS 2 messages, as formats/mcap_file.py has them: written without chunks or compression, with one checksum
// of what is about them; read with chunks, too, as long as they are not compressed.

import { ascii, repr, sha256 } from "./files.js";
import { recordingOf } from "./recordings.js";

const RECORD = "comanip", MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const HEADER = 1, FOOTER = 2, SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, CHUNK = 6, METADATA = 12, DATA_END = 15, MOST_MCAP_BYTES = 60e6;
const WIDTHS = { "geometry_msgs/msg/PointStamped": 3, "geometry_msgs/msg/Vector3Stamped": 3, "geometry_msgs/msg/WrenchStamped": 6 };

class Bytes {
  constructor() { this.parts = []; this.size = 0; }
  put(bytes) { this.parts.push(bytes); this.size += bytes.length; return this; }
  whole(kind, values, size) {
    const bytes = new Uint8Array(size), view = new DataView(bytes.buffer);
    values.forEach((value, n) => view[kind]((n * size) / values.length, value, true));
    return this.put(bytes);
  }
  u16(value) { return this.whole("setUint16", [value], 2); }
  u32(value) { return this.whole("setUint32", [value], 4); }
  u64(value) { return this.whole("setBigUint64", [BigInt(value)], 8); }
  f64(values) { return this.whole("setFloat64", values, 8 * values.length); }
  text(value) { const bytes = new TextEncoder().encode(value); return this.u32(bytes.length).put(bytes); }
  map(values) {
    const inside = new Bytes();
    for (const [key, value] of Object.entries(values)) inside.text(key).text(value);
    return this.u32(inside.size).put(inside.done());
  }
  done() {
    const all = new Uint8Array(this.size);
    let at = 0;
    for (const part of this.parts) { all.set(part, at); at += part.length; }
    return all;
  }
}

// As zlib's, of everything before the end of the data: the reader asks for it
function crc32(bytes) {
  let crc = -1;
  for (const byte of bytes) {
    crc ^= byte;
    for (let n = 0; n < 8; n++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc >>> 0;
}

function schemaOf({ axes, unit }) {
  if (!axes.every(axis => "xyz".includes(axis))) return "std_msgs/msg/Float64MultiArray";
  return { m: "geometry_msgs/msg/PointStamped", N: "geometry_msgs/msg/WrenchStamped" }[unit] ?? "geometry_msgs/msg/Vector3Stamped";
}

function padded(bytes, multiple) {
  const out = new Uint8Array(Math.ceil(bytes.length / multiple) * multiple);
  out.set(bytes);
  return out;
}

function withNul(text) { const bytes = new TextEncoder().encode(text + "\0"); return new Bytes().u32(bytes.length).put(bytes).done(); }

// CDR of one frame, as formats/cdr.py lays it out
function message(schema, channel, row, ns) {
  const out = new Bytes().put(new Uint8Array([0, 1, 0, 0]));
  if (WIDTHS[schema]) {
    const values = new Array(WIDTHS[schema]).fill(NaN);
    channel.axes.forEach((axis, n) => { values["xyz".indexOf(axis)] = row[n]; });
    const stamp = new Bytes().u32(Math.floor(ns / 1e9)).u32(ns % 1e9).put(withNul(channel.frame));
    return out.put(padded(stamp.done(), 8)).f64(values).done();
  }
  const layout = new Bytes().u32(1).put(withNul(channel.axes.join(",")));
  const shape = new Bytes().put(padded(layout.done(), 4)).u32(channel.axes.length).u32(channel.axes.length).u32(0);
  return out.put(padded(new Bytes().put(padded(shape.done(), 4)).u32(channel.axes.length).done(), 8)).f64(row).done();
}

export function mcapOf({ metadata, channels }, schemas) {
  const file = new Bytes().put(new Uint8Array(MAGIC));
  const record = (opcode, body) => { const bytes = body.done(); file.put(new Uint8Array([opcode])).u64(bytes.length).put(bytes); };
  const stamps = channels.map(c => c.time.map(t => Math.round(t * 1e9))), all = channels.flatMap(c => c.time), shift = stamps.flat().reduce((low, ns) => Math.min(low, ns), 0);
  record(HEADER, new Bytes().text("ros2").text("comanip page"));
  const layout = Object.fromEntries(channels.map(c => [c.name, [c.unit, c.frame, c.axes, c.rows.length]])), clock = [all.reduce((a, b) => Math.min(a, b), Infinity), all.reduce((a, b) => Math.max(a, b), -Infinity)];
  const texts = {
    version: "1", recording: ascii(JSON.stringify(metadata)), channels: ascii(JSON.stringify(layout)), clock: `[${shift}, ${all.length ? clock.map(repr).join(", ") : "0.0, 0.0"}]`,
  };
  texts.sha256 = digest(texts);
  record(METADATA, new Bytes().text(RECORD).map(texts));
  const known = new Map();
  channels.forEach((channel, id) => {
    const schema = schemaOf(channel);
    if (!known.has(schema)) {
      known.set(schema, known.size + 1);
      const body = new TextEncoder().encode(schemas[schema]);
      record(SCHEMA, new Bytes().u16(known.get(schema)).text(schema).text("ros2msg").u32(body.length).put(body));
    }
    const about = { [RECORD]: JSON.stringify([channel.name, channel.unit, channel.frame, channel.axes]), offered_qos_profiles: "" };
    record(CHANNEL, new Bytes().u16(id + 1).u16(known.get(schema)).text(`/${channel.name.replaceAll(".", "/")}`).text("cdr").map(about));
  });
  const order = channels.flatMap((_, id) => stamps[id].map((ns, n) => [ns, id, n])).sort((a, b) => a[0] - b[0] || a[1] - b[1] || a[2] - b[2]);
  for (const [ns, id, n] of order) record(MESSAGE, new Bytes().u16(id + 1).u32(n).u64(ns - shift).u64(ns - shift).put(message(schemaOf(channels[id]), channels[id], channels[id].rows[n], ns - shift)));
  record(DATA_END, new Bytes().u32(crc32(file.done())));
  record(FOOTER, new Bytes().u64(0).u64(0).u32(0));
  return file.put(new Uint8Array(MAGIC)).done();
}

// Metadata records carry no checksum of their own, so ours brings one.
function digest(texts) { return sha256(Object.keys(texts).filter(key => key !== "sha256").sort().map(key => `${key}=${texts[key]}`).join("\0")); }

export function recordingMcap(task, take, extra, schemas = task.schemas) { return mcapOf(recordingOf(task, take, extra), schemas); }

class Reader {
  constructor(bytes) { this.bytes = bytes; this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength); this.at = 0; }
  get left() { return this.bytes.length - this.at; }
  take(n) {
    if (!(n <= this.left)) throw new Error("cut short, or damaged");
    this.at += n;
    return this.bytes.subarray(this.at - n, this.at);
  }
  u8() { return this.take(1)[0]; }
  u16() { this.take(2); return this.view.getUint16(this.at - 2, true); }
  u32() { this.take(4); return this.view.getUint32(this.at - 4, true); }
  u64() { this.take(8); return Number(this.view.getBigUint64(this.at - 8, true)); }
  text() { return new TextDecoder().decode(this.take(this.u32())); }
  map() {
    const inside = new Reader(this.take(this.u32())), found = new Map();
    while (inside.left) { const key = inside.text(); found.set(key, inside.text()); }
    return found;
  }
}

// A recording that comanip, or this page, wrote. Errors in one line.
export function readMcap(bytes) {
  if (bytes.length > MOST_MCAP_BYTES) throw new Error(`larger than ${MOST_MCAP_BYTES / 1e6} MB: no lesson is`);
  const whole = new Reader(bytes), found = { schemas: new Map(), channels: new Map(), metadata: null };
  if (bytes.length < 16 || !MAGIC.every((byte, n) => whole.u8() === byte)) throw new Error("no MCAP file");
  walk(whole, found, bytes);
  if (!found.metadata) throw new Error("no recording of comanip: comanip convert FILE lesson.csv --position ... --force ... makes one of other bags");
  const texts = Object.fromEntries(found.metadata);
  if (digest(texts) !== texts.sha256) throw new Error("the metadata record is damaged (its sha256 does not match)");
  const shift = JSON.parse(texts.clock)[0];
  const channels = [...found.channels.values()].map(one => decoded(one, found.schemas.get(one.schema), shift));
  return { metadata: JSON.parse(texts.recording), channels };
}

function walk(reader, found, whole) {
  while (reader.left > 8) {
    const from = reader.at, opcode = reader.u8(), body = new Reader(reader.take(reader.u64()));
    if (opcode === DATA_END) { const crc = body.u32(); if (crc && crc !== crc32(whole.subarray(0, from))) throw new Error("damaged: its checksum does not fit"); return; }
    if (opcode === SCHEMA) { const id = body.u16(); found.schemas.set(id, body.text()); }
    else if (opcode === CHANNEL) {
      const id = body.u16(), schema = body.u16();
      body.text(); body.text();
      const about = body.map().get(RECORD);
      if (about !== undefined) found.channels.set(id, found.channels.get(id) ?? { schema, about, stamps: [], rows: [] });
    } else if (opcode === MESSAGE) {
      const channel = found.channels.get(body.u16());
      body.u32();
      const ns = body.u64();
      body.u64();
      if (channel) { channel.stamps.push(ns); channel.rows.push(body.take(body.left)); }
    } else if (opcode === METADATA) { if (body.text() === RECORD) found.metadata = body.map(); }
    else if (opcode === CHUNK) {
      body.u64(); body.u64(); body.u64();
      const crc = body.u32(), compression = body.text(), records = body.take(body.u64());
      if (compression) throw new Error(`compressed with ${compression.slice(0, 20)}, which a browser does not read: comanip convert lesson.mcap lesson.csv, and open that`);
      if (crc && crc !== crc32(records)) throw new Error("damaged: a chunk's checksum does not fit");
      walk(new Reader(records), found, whole);
    }
  }
}

// As formats/cdr.decode: the values stand last in each message
function decoded({ about, stamps, rows }, schema, shift) {
  const [name, unit, frame, axes] = JSON.parse(about).map((part, n) => (n === 3 ? part.map(String) : String(part))), width = WIDTHS[schema] ?? axes.length;
  const at = axes.map((axis, n) => (WIDTHS[schema] ? "xyz".indexOf(axis) : n));
  if (at.some(n => n < 0) || rows.some(row => row.length < 8 * width + 4)) throw new Error(`channel ${name.slice(0, 60)}: messages that do not fit its axes`);
  const values = rows.map(row => { const view = new DataView(row.buffer, row.byteOffset, row.byteLength); return at.map(n => view.getFloat64(row.length - 8 * (width - n), true)); });
  return { name, unit, frame, axes, time: stamps.map(ns => (ns + shift) / 1e9), rows: values };
}

// Files [[name, bytes]] as one ZIP, stored as they are
export function zipOf(files) {
  const out = new Bytes(), list = new Bytes();
  for (const [name, bytes] of files) {
    const at = out.size, label = new TextEncoder().encode(name), about = record => record.u16(0x0800).u16(0).u16(0).u16(0x21).u32(crc32(bytes)).u32(bytes.length).u32(bytes.length).u16(label.length).u16(0);
    about(out.u32(0x04034b50).u16(20)).put(label).put(bytes);
    about(list.u32(0x02014b50).u16(20).u16(20)).u16(0).u16(0).u16(0).u32(0).u32(at).put(label);
  }
  const from = out.size;
  return out.put(list.done()).u32(0x06054b50).u16(0).u16(0).u16(files.length).u16(files.length).u32(list.size).u32(from).u16(0).done();
}
