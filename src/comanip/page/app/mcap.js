// A take as MCAP with ROS 2 messages, as formats/mcap_file.py reads it: no chunks, no compression, one checksum of what is about it.

import { aboutTake, ascii, channelsOf, repr, round, sha256 } from "./files.js";

const RECORD = "comanip", MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const HEADER = 1, FOOTER = 2, SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, METADATA = 12, DATA_END = 15;
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
    const stamp = new Bytes().u32(Math.floor(ns / 1e9)).u32(ns % 1e9).put(withNul("task"));
    return out.put(padded(stamp.done(), 8)).f64(values).done();
  }
  const layout = new Bytes().u32(1).put(withNul(channel.axes.join(",")));
  const shape = new Bytes().put(padded(layout.done(), 4)).u32(channel.axes.length).u32(channel.axes.length).u32(0);
  return out.put(padded(new Bytes().put(padded(shape.done(), 4)).u32(channel.axes.length).done(), 8)).f64(row).done();
}

export function recordingMcap(task, take, extra, schemas = task.schemas) {
  const file = new Bytes().put(new Uint8Array(MAGIC)), n = take.position.length, channels = channelsOf(task, take);
  const record = (opcode, body) => { const bytes = body.done(); file.put(new Uint8Array([opcode])).u64(bytes.length).put(bytes); };
  const times = Array.from({ length: n }, (_, t) => Math.round(t * take.dt * 1e9));
  record(HEADER, new Bytes().text("ros2").text("comanip page"));
  const layout = Object.fromEntries(channels.map(c => [c.name, [c.unit, "task", c.axes, n]]));
  const texts = {
    version: "1", recording: ascii(JSON.stringify(aboutTake(task, extra))), channels: ascii(JSON.stringify(layout)), clock: `[0, 0.0, ${repr(round((n - 1) * take.dt))}]`,
  };
  texts.sha256 = sha256(Object.keys(texts).sort().map(key => `${key}=${texts[key]}`).join("\0"));
  record(METADATA, new Bytes().text(RECORD).map(texts));
  const known = new Map();
  channels.forEach((channel, id) => {
    const schema = schemaOf(channel);
    if (!known.has(schema)) {
      known.set(schema, known.size + 1);
      const body = new TextEncoder().encode(schemas[schema]);
      record(SCHEMA, new Bytes().u16(known.get(schema)).text(schema).text("ros2msg").u32(body.length).put(body));
    }
    const about = { [RECORD]: JSON.stringify([channel.name, channel.unit, "task", channel.axes]), offered_qos_profiles: "" };
    record(CHANNEL, new Bytes().u16(id + 1).u16(known.get(schema)).text(`/${channel.name.replaceAll(".", "/")}`).text("cdr").map(about));
  });
  for (let t = 0; t < n; t++)
    channels.forEach((channel, id) => record(MESSAGE, new Bytes().u16(id + 1).u32(t).u64(times[t]).u64(times[t]).put(message(schemaOf(channel), channel, channel.rows[t], times[t]))));
  record(DATA_END, new Bytes().u32(crc32(file.done())));
  record(FOOTER, new Bytes().u64(0).u64(0).u32(0));
  return file.put(new Uint8Array(MAGIC)).done();
}
