// The person's hand: pointer, finger, keys or gamepad, all as a place (d,) of the pointer in the task's frame.

import { clamp } from "./scene.js";

const KEY_M_PER_S = 0.3, STICK_M_PER_S = 0.45, SPEEDS_UP_M_PER_S2 = 1.6, AHEAD_M = 0.11, WHEEL_M_PER_PX = 0.0002, LINE_PX = 16;
const RELAXES_S = 0.8;
// across, along, and into the picture: the axis that a flat picture has no room for
export const KEYS = {
  ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0], ArrowRight: [1, 0, 0], ArrowLeft: [-1, 0, 0],
  w: [0, 1, 0], s: [0, -1, 0], d: [1, 0, 0], a: [-1, 0, 0],
  e: [0, 0, 1], q: [0, 0, -1], PageUp: [0, 0, 1], PageDown: [0, 0, -1],
};

// takes() when somebody takes hold, lets() when somebody lets go, moves() when the pointer has moved; `here()` is where the handle is
// now (d,), from the start.
export class Hands {
  constructor(scene, { takes, lets, moves, here }) {
    this.scene = scene;
    Object.assign(this, { takes, lets, moves, here });
    this.target = null; // (d,) of the pointer from the start [m]; null: nobody holds
    this.kind = "";
    this.keys = new Set();
    this.speed = [0, 0, 0];
    this.deep = 0; // [m] that wheel, keys or a second finger have moved into the picture since the handle was taken
    this.second = null;
    this.seen = -Infinity; // when the browser saw what was answered last [ms]
    const canvas = scene.canvas;
    canvas.addEventListener("pointerdown", event => this.down(event));
    for (const name of ["pointermove", "pointerrawupdate"]) canvas.addEventListener(name, event => this.move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(name, event => this.up(event));
    canvas.addEventListener("wheel", event => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", event => this.key(event, true));
    canvas.addEventListener("keyup", event => this.key(event, false));
    canvas.addEventListener("blur", () => this.keys.clear());
    canvas.addEventListener("contextmenu", event => event.preventDefault());
  }

  down(event) {
    if (event.button > 0) return;
    if (this.target) { this.secondFinger(event); return; }
    const box = this.scene.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    const [hx, hy] = this.scene.handle ?? [x, y], reach = Math.max(60, 0.28 * this.scene.scale);
    if (Math.hypot(x - hx, y - hy) > reach) return;
    this.scene.canvas.setPointerCapture(event.pointerId);
    this.id = event.pointerId;
    this.from = this.now = [event.clientX, event.clientY];
    this.begin = this.here();
    this.hold("pointer", this.begin.slice());
  }

  hold(kind, target) {
    this.kind = kind;
    this.target = target;
    this.deep = 0;
    this.second = this.was = null;
    this.steered = [false, false, false]; // by keys, sticks or a wheel since the handle was taken
    this.speed.fill(0);
    this.takes();
  }

  move(event) {
    if (this.second && event.pointerId === this.second.id) { this.dive(this.second.deep + (this.second.y - event.clientY) / this.scene.scale); return; }
    if (this.kind !== "pointer" || event.pointerId !== this.id) return;
    const { timeStamp, clientX, clientY } = event;
    // a browser tells a movement at once as raw, and a frame or two later again; in some, stamps are so coarse that many are alike
    if (timeStamp < this.seen || (timeStamp === this.seen && clientX === this.now[0] && clientY === this.now[1])) return;
    this.seen = this.when = timeStamp;
    this.now = [clientX, clientY];
    this.point();
    this.moves();
  }

  // The target is where the pointer shows, also where it has been moved into the picture since.
  point() {
    const by = this.scene.moved(this.now[0] - this.from[0], this.now[1] - this.from[1], this.deep);
    this.target = this.begin.map((x, n) => x + by[n]);
  }

  // A second finger, up and down, while the first one holds
  secondFinger(event) {
    if (this.scene.depth < 0 || this.kind !== "pointer" || event.pointerId === this.id || this.second) return;
    this.scene.canvas.setPointerCapture(event.pointerId);
    this.second = { id: event.pointerId, y: event.clientY, deep: this.deep };
  }

  wheel(event) {
    if (!this.target || this.scene.depth < 0) return;
    event.preventDefault();
    this.dive(this.deep - event.deltaY * (event.deltaMode === 1 ? LINE_PX : 1) * WHEEL_M_PER_PX);
  }

  // `metres` into the picture from where the handle was taken
  dive(metres) {
    const n = this.scene.depth;
    if (n < 0 || !this.target) return;
    if (metres !== this.deep) this.steered[2] = true;
    const by = metres - this.deep, place = this.here()[n];
    this.deep = metres;
    if (this.kind === "pointer") this.point();
    else this.target = this.target.map((x, i) => (i === n ? clamp(x + by, place - AHEAD_M, place + AHEAD_M) : x));
  }

  up(event) {
    if (this.second && event.pointerId === this.second.id) { this.second = null; return; }
    if (this.kind === "pointer" && event.pointerId === this.id) this.release();
  }

  release() {
    if (!this.target) return;
    this.target = null;
    this.kind = "";
    this.lets();
  }

  key(event, pressed) {
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (name === " " || name === "Enter") {
      event.preventDefault();
      if (pressed && !event.repeat) this.target ? this.release() : this.hold("keys", this.here());
      return;
    }
    if (!KEYS[name]) return;
    event.preventDefault();
    if (!pressed) { this.keys.delete(name); return; }
    if (KEYS[name][2] && this.scene.depth < 0) return;
    if (!this.target) this.hold("keys", this.here());
    if (this.kind === "pointer" && !KEYS[name][2]) return;
    if (this.kind !== "pointer") this.kind = "keys";
    this.keys.add(name);
  }

  // Once a frame: keys and sticks move the pointer on at a speed, and never far ahead of the hand.
  step(seconds) {
    const wanted = this.gamepad();
    if (!this.target) return;
    for (const name of this.keys) KEYS[name].forEach((to, n) => { wanted[n] += to * KEY_M_PER_S; });
    wanted.forEach((to, n) => { if (to) this.steered[n] = true; this.speed[n] += clamp(to - this.speed[n], -SPEEDS_UP_M_PER_S2 * seconds, SPEEDS_UP_M_PER_S2 * seconds); });
    const [across, along, deep] = this.speed.map(v => v * seconds);
    if (deep) this.dive(this.deep + deep);
    const { scene } = this, place = this.here(), free = n => !this.steered[n];
    if (scene.depth >= 0 && free(2) && !this.second) this.goesAlong(scene.depth, place, seconds);
    if (this.kind !== "pointer") {
      const by = scene.moved(across * scene.scale, -along * scene.scale, 0);
      this.target = this.target.map((x, n) => (n === scene.depth ? x : clamp(x + by[n], place[n] - AHEAD_M, place[n] + AHEAD_M)));
      for (const [n, way] of [[scene.level, 0], [scene.up, 1]]) if (n >= 0 && free(way)) this.goesAlong(n, place, seconds);
    }
    this.was = place;
  }

  // Along an axis that nobody has steered a hand goes along, and relaxes.
  goesAlong(n, place, seconds) {
    const off = this.target[n] - place[n], moved = place[n] - (this.was ?? place)[n];
    const by = (moved * off < 0 ? moved : 0) - off * Math.min(seconds / RELAXES_S, 1);
    this.target[n] += by;
    if (n !== this.scene.depth) return;
    this.deep += by;
    if (this.kind === "pointer") this.point();
  }

  gamepad() {
    const pads = typeof navigator !== "undefined" && navigator.getGamepads ? navigator.getGamepads() : [];
    const pad = [...pads].find(one => one && one.connected);
    if (!pad) return [0, 0, 0];
    const pressed = pad.buttons.some(button => button.pressed);
    if (pressed && !this.padWas) this.target ? this.release() : this.hold("gamepad", this.here());
    this.padWas = pressed;
    this.pad = pad;
    const dead = value => (Math.abs(value) < 0.12 ? 0 : value);
    return [dead(pad.axes[0] ?? 0) * STICK_M_PER_S, -dead(pad.axes[1] ?? 0) * STICK_M_PER_S, -dead(pad.axes[3] ?? 0) * STICK_M_PER_S];
  }

  // Force as rumble and vibration, where there is something that can: strength in [0, 1].
  feel(strength, now) {
    if (now < (this.feltUntil ?? 0) || strength < 0.12) return;
    this.feltUntil = now + 120;
    if (this.kind === "gamepad") this.pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: 130, strongMagnitude: strength, weakMagnitude: strength * 0.4 })?.catch?.(() => {});
    if (this.kind === "pointer" && navigator.vibrate && matchMedia("(pointer: coarse)").matches) navigator.vibrate(Math.round(8 + 30 * strength));
  }
}
