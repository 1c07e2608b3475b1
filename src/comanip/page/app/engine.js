// The world in WebAssembly: numbers by name, and time that passes in whole milliseconds. See page.c.

export class Engine {
  static async from(bytes) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Engine(instance.exports);
  }

  constructor(wasm) {
    this.wasm = wasm;
    if (wasm._initialize) wasm._initialize();
    const [numbers, vectors] = this.text(wasm.page_names()).split("|").map(part => part.trim().split(" "));
    this.numberAt = new Map(numbers.map((name, n) => [name, n]));
    const most = wasm.page_most_axes();
    this.vectorAt = new Map(vectors.map((name, n) => [name, numbers.length + n * most]));
    this.size = numbers.length + vectors.length * most;
  }

  text(at) {
    const bytes = new Uint8Array(this.wasm.memory.buffer, at);
    let end = 0;
    while (bytes[end]) end++;
    return new TextDecoder().decode(bytes.slice(0, end));
  }

  // Room for these float64 numbers, filled with them; gives where it is.
  room(values) {
    const at = this.wasm.page_room(values.length);
    new Float64Array(this.wasm.memory.buffer, at, values.length).set(values);
    return at;
  }
}

export class World {
  constructor(engine) {
    this.engine = engine;
    this.at = engine.wasm.page_new();
    this.view = null;
  }

  // Memory that grew has other views.
  get all() {
    const buffer = this.engine.wasm.memory.buffer;
    if (!this.view || this.view.buffer !== buffer) this.view = new Float64Array(buffer, this.at, this.engine.size);
    return this.view;
  }

  place(name) {
    const found = this.engine.numberAt.get(name);
    if (found === undefined) throw new Error(`the page's world has no number ${name}`);
    return found;
  }

  get(name) { return this.all[this.place(name)]; }

  set(values) {
    for (const [name, value] of Object.entries(values)) {
      if (typeof value === "number") this.all[this.place(name)] = value;
      else this.all.set(value, this.engine.vectorAt.get(name));
    }
    return this;
  }

  // (d,) of a vector, as a live view
  vector(name) {
    const at = this.engine.vectorAt.get(name);
    if (at === undefined) throw new Error(`the page's world has no vector ${name}`);
    return this.all.subarray(at, at + this.get("axes"));
  }

  // The numbers of a skill, Float64Array; null takes it away.
  skill(numbers) {
    const { wasm } = this.engine, at = numbers ? this.engine.room(numbers) : 0, refused = wasm.page_skill(this.at, at, numbers ? numbers.length : 0);
    if (this.numbersAt) wasm.page_drop(this.numbersAt);
    this.numbersAt = at;
    if (refused) throw new Error(`the page cannot run this skill (${refused})`);
    return this;
  }

  begin() {
    if (!this.engine.wasm.page_begin(this.at)) throw new Error("a number of the page's world is not allowed");
    return this;
  }

  advance(milliseconds) { this.engine.wasm.page_advance(this.at, milliseconds); }

  rearm() { return this.engine.wasm.page_rearm(this.at); }

  get reason() { return this.engine.text(this.engine.wasm.page_reason(this.get("reason"))); }

  // What a skill shows: 0 weights, 1 role, 2 goals; a plain array, empty where there is nothing.
  shown(what) {
    const at = (this.shownAt ??= this.engine.wasm.page_room(512));
    const n = this.engine.wasm.page_shown(this.at, what, at);
    return Array.from(new Float64Array(this.engine.wasm.memory.buffer, at, n));
  }

  // A whole trace, a row of pointer (d) and `holds` a millisecond; gives a row a tick, as page_replay says. For tests.
  replay(trace) {
    const d = this.get("axes"), n = trace.length / (d + 1), substeps = Math.round(this.get("dt_s") / this.get("step_s")), width = 5 * d + 3;
    const from = this.engine.room(trace), to = this.engine.wasm.page_room(Math.ceil(n / substeps) * width);
    const ticks = this.engine.wasm.page_replay(this.at, from, n, to);
    return new Float64Array(this.engine.wasm.memory.buffer, to, ticks * width).slice();
  }
}
