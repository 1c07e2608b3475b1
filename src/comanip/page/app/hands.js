// The person's hand: pointer, finger, keys or gamepad, all as a place (d,) of the pointer in the task's frame.

import { clamp } from "./scene.js";

const KEY_M_PER_S = 0.3, STICK_M_PER_S = 0.45, SPEEDS_UP_M_PER_S2 = 1.6, AHEAD_M = 0.11;
export const KEYS = {
  ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowRight: [1, 0], ArrowLeft: [-1, 0],
  w: [0, 1], s: [0, -1], d: [1, 0], a: [-1, 0],
};

// takes() when somebody takes hold, lets() when somebody lets go; `here()` is where the handle is now (d,), from the start.
export class Hands {
  constructor(scene, { takes, lets, here }) {
    this.scene = scene;
    Object.assign(this, { takes, lets, here });
    this.target = null; // (d,) of the pointer from the start [m]; null: nobody holds
    this.kind = "";
    this.keys = new Set();
    this.speed = [0, 0];
    this.events = 0;
    const canvas = scene.canvas;
    canvas.addEventListener("pointerdown", event => this.down(event));
    for (const name of ["pointermove", "pointerrawupdate"]) canvas.addEventListener(name, event => this.move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(name, event => this.up(event));
    canvas.addEventListener("keydown", event => this.key(event, true));
    canvas.addEventListener("keyup", event => this.key(event, false));
    canvas.addEventListener("blur", () => this.keys.clear());
    canvas.addEventListener("contextmenu", event => event.preventDefault());
  }

  down(event) {
    if (event.button > 0 || this.target) return;
    const box = this.scene.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    const [hx, hy] = this.scene.handle ?? [x, y], reach = Math.max(60, 0.28 * this.scene.scale);
    if (Math.hypot(x - hx, y - hy) > reach) return;
    this.scene.canvas.setPointerCapture(event.pointerId);
    this.id = event.pointerId;
    this.from = [event.clientX, event.clientY];
    this.begin = this.here();
    this.hold("pointer", this.begin.slice());
  }

  hold(kind, target) {
    this.kind = kind;
    this.target = target;
    this.takes();
  }

  move(event) {
    if (this.kind !== "pointer" || event.pointerId !== this.id) return;
    this.events++;
    this.when = event.timeStamp;
    const by = this.scene.moved(event.clientX - this.from[0], event.clientY - this.from[1]);
    this.target = this.begin.map((x, n) => x + by[n]);
  }

  up(event) {
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
    if (!this.target) this.hold("keys", this.here());
    if (this.kind === "pointer") return;
    this.kind = "keys";
    this.keys.add(name);
  }

  // Once a frame: keys and sticks move the pointer on at a speed, and never far ahead of the hand.
  step(seconds) {
    const stick = this.gamepad();
    if (!this.target || this.kind === "pointer") return;
    let [across, along] = stick;
    for (const name of this.keys) { across += KEYS[name][0] * KEY_M_PER_S; along += KEYS[name][1] * KEY_M_PER_S; }
    const wanted = [across, along], place = this.here();
    for (const n of [0, 1]) this.speed[n] += clamp(wanted[n] - this.speed[n], -SPEEDS_UP_M_PER_S2 * seconds, SPEEDS_UP_M_PER_S2 * seconds);
    const by = this.scene.moved(this.speed[0] * seconds * this.scene.scale, -this.speed[1] * seconds * this.scene.scale);
    this.target = this.target.map((x, n) => clamp(x + by[n], place[n] - AHEAD_M, place[n] + AHEAD_M));
  }

  gamepad() {
    const pads = typeof navigator !== "undefined" && navigator.getGamepads ? navigator.getGamepads() : [];
    const pad = [...pads].find(one => one && one.connected);
    if (!pad) return [0, 0];
    const pressed = pad.buttons.some(button => button.pressed);
    if (pressed && !this.padWas) this.target ? this.release() : this.hold("gamepad", this.here());
    this.padWas = pressed;
    this.pad = pad;
    const dead = value => (Math.abs(value) < 0.12 ? 0 : value);
    return [dead(pad.axes[0] ?? 0) * STICK_M_PER_S, -dead(pad.axes[1] ?? 0) * STICK_M_PER_S];
  }

  // Force as rumble and vibration, where there is something that can: strength in [0, 1].
  feel(strength, now) {
    if (now < (this.feltUntil ?? 0) || strength < 0.12) return;
    this.feltUntil = now + 120;
    if (this.kind === "gamepad") this.pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: 130, strongMagnitude: strength, weakMagnitude: strength * 0.4 })?.catch?.(() => {});
    if (this.kind === "pointer" && navigator.vibrate && matchMedia("(pointer: coarse)").matches) navigator.vibrate(Math.round(8 + 30 * strength));
  }
}
