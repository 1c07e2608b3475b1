// One lift after the other: the world runs while somebody holds, a take is kept, and an end is noticed.

import { World } from "./engine.js";
import { lengthOf, judged } from "./judge.js";
import { clamp } from "./scene.js";

export const WEIGHS_S = 0.32, BLENDS_S = 0.15, LONGEST_S = 40, RESTS_S = 1.7, RESTS_M = 0.008, MOST_BEHIND_MS = 250;
const BACK_MS = 900;
export const KEPT = ["position", "velocity", "sensor_force", "force", "true_force", "tilt", "command_velocity", "end_position", "pull_n"];

// The order of chances from a seed: what a trial gives is the same again.
export function chances(seed) {
  let state = (Math.imul(seed | 0, 0x9e3779b1) ^ 0x85ebca6b) >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let z = Math.imul(state ^ (state >>> 15), state | 1);
    z ^= z + Math.imul(z ^ (z >>> 7), z | 61);
    return ((z ^ (z >>> 14)) >>> 0) / 4294967296;
  };
}

// What a person is asked for: the end of this way, and the way itself where it is not straight.
export function asking(way, shown) {
  const first = way[0], rows = way.map(row => row.map((x, n) => x - first[n])), goal = rows[rows.length - 1], far = rows.map(lengthOf), size = lengthOf(goal);
  const longest = far.reduce((a, b) => Math.max(a, b)), length = rows.reduce((sum, row, n) => sum + (n ? lengthOf(row.map((x, i) => x - rows[n - 1][i])) : 0), 0);
  return { goal: shown ? goal : null, guide: shown && length > 1.1 * size ? rows : null, extent: size < 0.5 * longest ? longest : 0 };
}

export class Session {
  // config: what the export wrote; hooks: {began, ticked, ended, held}
  constructor(engine, config, hooks = {}) {
    this.engine = engine;
    this.config = config;
    this.hooks = hooks;
    this.world = new World(engine);
    this.start = config.task.axes.map(axis => axis.start);
    this.phase = "idle"; // idle, runs, ended, back
    this.prepare({ robot: { kind: "mass-damper" }, seed: 1, goal: null });
  }

  // setup: {robot: {kind: "skill", numbers} | {kind: "mass-damper", kg, ns_per_m} | {kind: "planned", way: {step_s, rows (T, d) from the start}, onset_s}, seed, asked,
  //  goal (d,) or null, guide: rows (T, d) that show the way to it, extent: how far that way goes from the start}
  prepare(setup) {
    const { task, hand, robot } = this.config, kind = setup.robot.kind;
    this.setup = setup;
    this.world.set({
      ...robot, ...hand, axes: task.axes.length, mass_kg: setup.mass_kg ?? task.mass_kg, stated_mass_kg: task.mass_kg, length_m: task.length_m, share: task.share,
      gravity: task.gravity, axial: task.axial, start: this.start, seed: setup.seed, holds: 1,
      robot: { skill: 0, "mass-damper": 1, planned: 2, holds: 3 }[kind], robot_kg: setup.robot.kg ?? 6, robot_ns_per_m: setup.robot.ns_per_m ?? 20,
      robot_attraction_per_s: 4, plan_runs: 0, plan_position: this.start, plan_velocity: this.start.map(() => 0),
    });
    if (this.numbers !== setup.robot.numbers) this.world.skill(setup.robot.numbers ?? null);
    this.numbers = setup.robot.numbers;
    this.reset();
  }

  reset() {
    this.world.set({ holds: 1 }).begin();
    this.take = { dt: this.world.get("dt_s"), start: this.start.slice(), weights: [], role: [], mode: [], phase: [], ...Object.fromEntries(KEPT.map(name => [name, []])) };
    this.last = this.start.map(() => 0);
    this.stillS = 0;
    this.anchor = this.start.map(() => 0);
    this.goneAt = null;
    this.farthest = 0;
    this.letGo = false;
    this.led = false;
    this.ticksSeen = 0;
    this.behindMs = 0;
    this.phase = "idle";
  }

  // Somebody takes hold: the lift begins, or goes on where it was let go.
  takes() {
    if (this.phase === "idle") {
      this.reset();
      this.phase = "runs";
      this.hooks.began?.(this);
    } else if (this.phase === "runs") {
      this.letGo = false;
      const world = this.world;
      for (const name of ["place", "drawn", "aim", "pointer"]) world.vector(name).set(world.vector("end_position"));
      world.vector("place_speed").set(world.vector("end_velocity"));
      world.vector("aim_speed").fill(0);
      world.set({ holds: 1 });
    }
  }

  lets(now) {
    if (this.phase === "runs") {
      this.letGo = true;
      this.letGoAt = this.world.get("time_s");
      this.world.set({ holds: 0 });
      if (this.atGoal() && this.world.get("mode") === 0) this.finish();
    } else if (this.phase === "ended") this.goBack(now);
  }

  here() { return Array.from(this.world.vector("end_position"), (x, n) => x - this.start[n]); }

  atGoal() {
    const place = Array.from(this.world.vector("position"), (x, n) => x - this.start[n]), goal = this.setup.goal;
    return goal ? lengthOf(place.map((x, n) => x - goal[n])) < 0.04 && this.stillS > 0.25 : this.stillS > 0.6 && lengthOf(place) > 0.05;
  }

  // `milliseconds` pass; `target` (d,) from the start is where the pointer is now, null where nobody holds.
  advance(milliseconds, target, now) {
    if (this.phase === "back" && now >= this.backUntil) { this.reset(); this.hooks.ready?.(this); }
    if (this.phase !== "runs") return;
    this.behindMs += Math.min(milliseconds, MOST_BEHIND_MS);
    const steps = Math.floor(this.behindMs), world = this.world, pointer = world.vector("pointer");
    this.behindMs -= steps;
    const from = this.last, to = target ?? from;
    for (let n = 1; n <= steps && this.phase === "runs"; n++) {
      const t = world.get("time_s"), share = clamp((t - WEIGHS_S) / BLENDS_S, 0, 1);
      if (!this.letGo) for (let i = 0; i < to.length; i++) pointer[i] = this.start[i] + share * (from[i] + (to[i] - from[i]) * (n / steps));
      if (this.setup.robot.way) this.plan(t);
      world.advance(1);
      if (world.get("ticks") !== this.ticksSeen) this.ticked();
    }
    this.last = to.slice();
  }

  // Where a robot with a plan means to be at time t [s]
  plan(t) {
    const { way, onset_s } = this.setup.robot, phase = (t - onset_s) / way.step_s, last = way.rows.length - 1, n = clamp(Math.floor(phase), 0, last - 1), share = clamp(phase - n, 0, 1), goes = phase > 0 && phase < last;
    const place = this.world.vector("plan_position"), speed = this.world.vector("plan_velocity");
    for (let i = 0; i < this.start.length; i++) {
      const a = way.rows[n][i], b = way.rows[n + 1][i];
      place[i] = this.start[i] + a + share * (b - a);
      speed[i] = goes ? (b - a) / way.step_s : 0;
    }
    this.world.set({ plan_runs: phase > 0 ? 1 : 0 });
  }

  ticked() {
    const world = this.world, take = this.take, dt = take.dt;
    this.ticksSeen = world.get("ticks");
    for (const name of KEPT) take[name].push(Array.from(world.vector(name)));
    take.mode.push(world.get("mode"));
    take.phase.push(world.get("phase_s"));
    take.weights.push(world.shown(0));
    take.role.push(world.shown(1));
    const place = take.position[take.position.length - 1].map((x, n) => x - this.start[n]);
    if (this.goneAt === null && lengthOf(place) > 0.01) {
      this.goneAt = world.get("time_s");
      this.led = world.get("acts") === 1 || world.get("acts") === 2;
    }
    this.farthest = Math.max(this.farthest, lengthOf(place));
    this.stillS = lengthOf(place.map((x, n) => x - this.anchor[n])) < RESTS_M ? this.stillS + dt : 0;
    if (this.stillS === 0) this.anchor = place;
    this.hooks.ticked?.(this);
    const t = world.get("time_s"), ended = this.goneAt !== null && this.stillS > RESTS_S && !this.letGo && this.restCounts(place);
    if (ended || t > LONGEST_S || (this.letGo && t - this.letGoAt > 6)) this.finish();
  }

  // A rest on the way is no end while there is a goal farther on, nor one at the start of a way that comes back to it.
  restCounts(place) {
    const goal = this.setup.goal;
    if (this.world.get("mode") !== 0) return false;
    if (this.farthest < 0.5 * (this.setup.extent ?? 0)) return this.stillS > 6;
    if (!goal || this.led) return (this.setup.ends ?? []).some(end => lengthOf(place.map((x, n) => x - end[n])) < 0.05) || this.stillS > 6;
    return lengthOf(place.map((x, n) => x - goal[n])) < 0.05 || this.stillS > 6;
  }

  finish() {
    this.phase = "ended";
    this.endedAt = this.world.get("time_s");
    const leads = this.setup.asked === "leader" || (this.setup.asked === "auto" && this.led);
    const asked = leads ? { ends: this.setup.ends, starts: this.setup.asked === "leader", goal: null } : { goal: this.setup.goal, ends: null };
    this.verdict = this.take.position.length > 60 ? judged(this.take, { ...asked, onset_s: null }) : null;
    if (this.verdict && this.letGo && !this.atGoal()) this.verdict.failures.unshift("you let go");
    this.verdict = this.verdict && { ...this.verdict, success: this.verdict.failures.length === 0 };
    this.hooks.ended?.(this);
  }

  goBack(now) {
    if (this.phase !== "ended") return;
    this.phase = "back";
    this.backFrom = { robot: this.shownPlace("position"), person: this.shownPlace("end_position") };
    this.backUntil = now + BACK_MS;
  }

  shownPlace(name) { return Array.from(this.world.vector(name), (x, n) => x - this.start[n]); }

  // What the scene draws, now.
  shown(now, target) {
    const world = this.world, runs = this.phase === "runs";
    let robot = this.shownPlace("position"), person = this.shownPlace("end_position");
    if (this.phase === "back") {
      const u = clamp(1 - (this.backUntil - now) / BACK_MS, 0, 1), left = 1 - u * u * u * (10 + u * (-15 + 6 * u));
      robot = this.backFrom.robot.map(x => x * left);
      person = this.backFrom.person.map(x => x * left);
    }
    const speed = world.vector("velocity");
    return {
      robot, person, force: runs ? Array.from(world.vector("force")) : this.start.map(() => 0), tilt: runs ? lengthOf(Array.from(world.vector("tilt"))) * Math.sign(world.vector("tilt")[0] || 1) : 0,
      pullN: lengthOf(Array.from(world.vector("stretch_n"))), mode: runs || this.phase === "ended" ? world.get("mode") : 0, lets: this.letGo, goal: this.setup.goal, guide: this.setup.guide, now,
      looks: runs ? -speed[speed.length - 1] * 6 : 0, blinks: now % 4300 < 130, weighs: runs && target ? world.get("time_s") / WEIGHS_S : 0, invites: this.phase === "idle" && !target,
    };
  }
}
