// Robot, beam and person on a 2-D canvas. It draws what it is told and remembers nothing but colours and where things are.

const STILL = matchMediaSafe("(prefers-reduced-motion: reduce)");
function matchMediaSafe(query) { return typeof matchMedia === "function" ? matchMedia(query) : { matches: false }; }
export function calm() { return STILL.matches; }

export const COLOURS = {};
const FORCE_M_PER_N = 0.05, LONGEST_M = 0.5; // of its arrow: 2 N, a usual pull, show beyond the gripper
const DEPTH = [0.4, 0.28]; // of a metre into the picture: to the right, and up
const NAMES = "paper sky ground card ink soft line robot robot-2 person person-2 beam goal force hold comply run band trousers trousers-2".split(" ");
export function takeColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) COLOURS[name.replace("-2", "2")] = style.getPropertyValue(`--${name}`).trim();
}

// A canvas as large as it is shown, in its own pixels: [context, width, height], or null while it has no size.
export function fitted(canvas) {
  const ratio = Math.min(globalThis.devicePixelRatio || 1, 2), w = canvas.clientWidth, h = canvas.clientHeight;
  if (!w || !h) return null;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [g, w, h];
}

export class Scene {
  constructor(canvas, task) {
    this.canvas = canvas;
    this.setTask(task);
    this.burst = 0;
  }

  // task: {axes: [{name, up, start}], length_m, from_above}
  setTask(task) {
    this.task = task;
    this.up = task.axes.findIndex(axis => axis.up !== 0);
    this.level = task.axes.findIndex((axis, n) => n !== this.up);
    this.above = this.up < 0 && task.axes.length > 1;
    if (this.above) { this.level = 0; this.up = 1; }
    this.depth = task.axes.findIndex((axis, n) => n !== this.up && n !== this.level); // into the picture; -1: there is none
    this.length = task.length_m;
  }

  layout(w, h) {
    const wide = this.length + (this.level >= 0 ? 1.95 : 1.5), tall = this.above ? 1.5 : 1.34;
    const scale = Math.min(w / wide, h / tall), seen = h / scale;
    this.w = w; this.h = h; this.scale = scale;
    this.bottom = this.above ? -seen / 2 : seen > 1.95 ? -(seen - 1.95) / 2 - 0.06 : 1.72 - seen;
    this.left = w / 2 - (this.length / 2 + (this.level >= 0 ? 0.1 : 0)) * scale;
  }

  // Screen place of a displacement (d,) from the start, of the robot's end (0) or the person's (1).
  at(displacement, end = 0) {
    const across = this.level >= 0 ? displacement[this.level] : 0;
    const axis = this.up >= 0 ? this.task.axes[this.up] : null;
    const along = this.up >= 0 ? displacement[this.up] * (this.above ? 1 : axis.up) : 0;
    const height = this.above ? along : (axis && Math.abs(axis.start) < 2 && axis.up > 0 ? clamp(axis.start, 0.6, 1.1) : axis && axis.up < 0 ? 1.1 : 0.95) + along;
    const deep = this.depth >= 0 ? displacement[this.depth] : 0;
    return [this.left + (across + end * this.length + DEPTH[0] * deep) * this.scale, this.h - (height - this.bottom + DEPTH[1] * deep) * this.scale];
  }

  // The way back: a difference of screen places, `deep` of it [m] into the picture, as a displacement (d,) [m].
  moved(dx, dy, deep) {
    const out = this.task.axes.map(() => 0), inside = this.depth >= 0 ? deep : 0;
    if (this.level >= 0) out[this.level] = dx / this.scale - DEPTH[0] * inside;
    if (this.up >= 0) out[this.up] = (-dy / this.scale - DEPTH[1] * inside) * (this.above ? 1 : this.task.axes[this.up].up);
    if (this.depth >= 0) out[this.depth] = inside;
    return out;
  }

  draw(s) {
    const fit = fitted(this.canvas);
    if (!fit) return;
    const [g, w, h] = fit;
    this.layout(w, h);
    g.clearRect(0, 0, w, h);
    // As it is: whoever follows the handle with the eye would answer a tilt drawn larger with a larger pull. The level shows it.
    const robot = this.at(s.robot, 0), person = this.at(s.person, 1);
    this.handle = person;
    this.floor(g, w, h);
    if (this.above) this.fromAbove(g, robot, person, s);
    else {
      this.figure(g, robot, -1, s);
      this.figure(g, person, 1, s);
    }
    if (s.guide) this.guide(g, s.guide);
    if (s.goal) this.goal(g, s);
    this.beam(g, robot, person, s);
    if (!this.above) {
      this.arm(g, robot, -1, s, true);
      this.arm(g, person, 1, s, true);
    }
    this.force(g, robot, s);
    this.pull(g, person, s);
    if (s.invites) this.invitation(g, person, s);
    if (s.weighs > 0 && s.weighs < 1) this.ring(g, person, s.weighs);
    if (s.burst > 0) this.celebrate(g, person, s.burst);
  }

  floor(g, w, h) {
    const y = this.h + this.bottom * this.scale;
    if (this.above || y > h + 1) return;
    g.fillStyle = COLOURS.ground;
    g.fillRect(0, y, w, h - y);
  }

  // The way to the goal, where it is not straight, at the person's end
  guide(g, rows) {
    g.save();
    g.strokeStyle = g.fillStyle = COLOURS.goal;
    g.globalAlpha = 0.55;
    g.lineWidth = 2;
    g.setLineDash([3, 6]);
    g.beginPath();
    rows.forEach((row, n) => { const [x, y] = this.at(row, 1); n ? g.lineTo(x, y) : g.moveTo(x, y); });
    g.stroke();
    g.restore();
  }

  goal(g, s) {
    const a = this.at(s.goal, 0), b = this.at(s.goal, 1), r = 0.035 * this.scale;
    g.save();
    g.setLineDash([7, 6]);
    g.lineWidth = 1.6;
    g.strokeStyle = COLOURS.goal;
    g.globalAlpha = s.goalReached ? 1 : 0.8;
    g.beginPath();
    g.roundRect(a[0] - r, a[1] - r * 0.8, b[0] - a[0] + 2 * r, r * 1.6, r * 0.8);
    g.stroke();
    g.setLineDash([]);
    g.globalAlpha = s.goalReached ? 0.3 : 0.12;
    g.fillStyle = COLOURS.goal;
    g.fill();
    g.restore();
  }

  beam(g, a, b, s) {
    const t = 0.052 * this.scale, angle = Math.atan2(b[1] - a[1], b[0] - a[0]), length = Math.hypot(b[0] - a[0], b[1] - a[1]), over = 0.04 * this.scale;
    g.save();
    g.translate(a[0], a[1]);
    g.rotate(angle);
    g.fillStyle = COLOURS.beam;
    g.beginPath();
    g.roundRect(-over, -t / 2, length + 2 * over, t, t * 0.22);
    g.fill();
    g.globalAlpha = 0.18;
    g.fillStyle = "#fff";
    g.fillRect(-over + 3, -t / 2 + 2, length + 2 * over - 6, t * 0.2);
    g.fillStyle = "#000";
    g.fillRect(-over + 3, t / 2 - t * 0.22, length + 2 * over - 6, t * 0.14);
    g.globalAlpha = 1;
    const vial = t * 1.9, off = clamp((s.tilt || 0) * 400, -1, 1) * vial * 0.36; // a spirit level
    g.fillStyle = "#d8ecae";
    g.beginPath(); g.roundRect(length / 2 - vial / 2, -t * 0.27, vial, t * 0.54, t * 0.27); g.fill();
    g.strokeStyle = "rgb(40 60 20 / .6)"; g.lineWidth = 1;
    for (const x of [-0.2, 0.2]) { g.beginPath(); g.moveTo(length / 2 + x * vial, -t * 0.27); g.lineTo(length / 2 + x * vial, t * 0.27); g.stroke(); }
    g.fillStyle = "#fbfff0"; g.strokeStyle = "rgb(40 60 20 / .5)";
    g.beginPath(); g.ellipse(length / 2 + off, 0, vial * 0.15, t * 0.19, 0, 0, 7); g.fill(); g.stroke();
    g.restore();
  }

  // side -1: the robot, who stands on the left and looks right; 1: the person, the other way round
  body(hand, side) {
    const S = this.scale, reach = side < 0 ? 0.44 : 0.46, x = hand[0] + side * reach * S;
    const floor = this.h + this.bottom * S, z = (floor - hand[1]) / S, lean = -side * clamp((1.02 - z) * 0.22, -0.1, 0.16);
    const hip = [x + side * 0.02 * S, floor - (side < 0 ? 0.74 : 0.86) * S], spine = (side < 0 ? 0.46 : 0.5) * S;
    const shoulder = [hip[0] + Math.sin(lean) * spine, hip[1] - Math.cos(lean) * spine];
    return { x, floor, lean, hip, shoulder };
  }

  figure(g, hand, side, s) {
    const S = this.scale, { floor, lean, hip } = this.body(hand, side), robot = side < 0;
    const main = robot ? COLOURS.robot : COLOURS.person, other = robot ? COLOURS.robot2 : COLOURS.person2;
    const legs = robot ? [other, main] : [COLOURS.trousers2, COLOURS.trousers];
    const foot = [hip[0] - side * 0.02 * S, floor - 0.02 * S];
    for (const [dx, shade] of [[0.07 * side, legs[0]], [-0.05 * side, legs[1]]]) {
      const knee = [hip[0] - side * 0.035 * S + dx * S * 0.7, (hip[1] + foot[1]) / 2];
      limb(g, [[hip[0] + dx * 0.35 * S, hip[1]], knee, [foot[0] + dx * S, foot[1]]], 0.1 * S, shade);
      limb(g, [[foot[0] + dx * S, foot[1]], [foot[0] + dx * S - side * 0.09 * S, foot[1]]], 0.05 * S, shade);
    }
    this.arm(g, hand, side, s, false);
    g.save();
    g.translate(hip[0], hip[1]);
    g.rotate(lean);
    const top = -(robot ? 0.52 : 0.55) * S, wide = (robot ? 0.235 : 0.21) * S;
    g.fillStyle = main;
    g.beginPath();
    if (robot) g.roundRect(-wide / 2, top, wide, -top + 0.04 * S, [0.07 * S, 0.07 * S, 0.05 * S, 0.05 * S]);
    else g.roundRect(-wide / 2, top, wide, -top + 0.05 * S, [0.1 * S, 0.1 * S, 0.06 * S, 0.06 * S]);
    g.fill();
    if (robot) {
      g.fillStyle = other;
      g.beginPath(); g.roundRect(-wide * 0.18, top + 0.1 * S, wide * 0.56, 0.17 * S, 0.03 * S); g.fill();
      const state = s.mode === 2 ? COLOURS.hold : s.mode === 1 ? COLOURS.comply : "#bdf0e4"; // and the badge says it in words
      g.fillStyle = state;
      g.beginPath(); g.arc(wide * 0.1, top + 0.185 * S, 0.03 * S, 0, 7); g.fill();
      g.fillStyle = other;
      g.fillRect(-0.025 * S, top - 0.05 * S, 0.05 * S, 0.07 * S);
      g.fillStyle = main;
      g.beginPath(); g.roundRect(-0.1 * S, top - 0.24 * S, 0.21 * S, 0.2 * S, 0.07 * S); g.fill();
      g.fillStyle = "#dff4ff";
      g.beginPath(); g.roundRect(0.0 * S, top - 0.185 * S, 0.115 * S, 0.06 * S, 0.03 * S); g.fill();
      g.fillStyle = "#17324f";
      const look = clamp((s.looks || 0) * 0.012, -0.014, 0.014) * S, shut = s.blinks ? 0.2 : 1;
      for (const x of [0.045, 0.085]) { g.beginPath(); g.ellipse(x * S, top - 0.155 * S - look, 0.011 * S, 0.014 * S * shut, 0, 0, 7); g.fill(); }
    } else {
      g.fillStyle = "#f3c9a5";
      g.fillRect(-0.03 * S, top - 0.06 * S, 0.065 * S, 0.09 * S);
      g.beginPath(); g.ellipse(-0.005 * S, top - 0.135 * S, 0.088 * S, 0.102 * S, 0, 0, 7); g.fill();
      g.beginPath(); g.arc(-0.092 * S, top - 0.125 * S, 0.018 * S, 0, 7); g.fill();
      g.save();
      g.beginPath(); g.ellipse(0.004 * S, top - 0.142 * S, 0.1 * S, 0.113 * S, 0, 0, 7); g.clip();
      g.fillStyle = "#4a342a";
      g.beginPath(); g.roundRect(-0.11 * S, top - 0.3 * S, 0.23 * S, 0.115 * S, 0.03 * S); g.fill();
      g.beginPath(); g.roundRect(0.025 * S, top - 0.26 * S, 0.12 * S, 0.165 * S, 0.03 * S); g.fill();
      g.restore();
      const looks = clamp((s.looks || 0) * 0.008, -0.008, 0.008) * S;
      g.fillStyle = "#3a2a22";
      g.beginPath(); g.ellipse(-0.052 * S, top - 0.15 * S - looks, 0.009 * S, 0.013 * S, 0, 0, 7); g.fill();
      g.strokeStyle = "#b5734d"; g.lineWidth = 0.008 * S; g.lineCap = "round";
      g.beginPath(); g.arc(-0.056 * S, top - 0.098 * S, 0.022 * S, 0.5, 1.9); g.stroke();
    }
    g.restore();
  }

  arm(g, hand, side, s, near) {
    const S = this.scale, { shoulder } = this.body(hand, side), robot = side < 0;
    const from = [shoulder[0] - side * (near ? -0.01 : 0.05) * S, shoulder[1] + 0.03 * S];
    const grip = near ? hand : [hand[0] - side * 0.07 * S, hand[1]];
    const elbow = joint(from, grip, 0.29 * S, side);
    const colour = near ? (robot ? COLOURS.robot2 : COLOURS.person2) : robot ? COLOURS.robot : COLOURS.person;
    g.save();
    if (!near) g.globalAlpha = 0.55;
    limb(g, [from, elbow], 0.085 * S, colour);
    limb(g, [elbow, grip], 0.07 * S, robot ? colour : "#f3c9a5");
    if (robot) {
      g.fillStyle = COLOURS.card;
      for (const p of [from, elbow]) { g.beginPath(); g.arc(p[0], p[1], 0.018 * S, 0, 7); g.fill(); }
    }
    if (near) {
      g.fillStyle = robot ? COLOURS.robot : "#f3c9a5";
      g.beginPath();
      if (robot) g.roundRect(grip[0] - 0.045 * S, grip[1] - 0.045 * S, 0.09 * S, 0.09 * S, 0.022 * S);
      else g.arc(grip[0], grip[1], 0.046 * S, 0, 7);
      g.fill();
      if (!robot && s.lets) { g.strokeStyle = COLOURS.person; g.lineWidth = 2; g.stroke(); }
    }
    g.restore();
  }

  fromAbove(g, robot, person, s) {
    const S = this.scale;
    for (const [hand, side, main, other] of [[robot, -1, COLOURS.robot, COLOURS.robot2], [person, 1, COLOURS.person, COLOURS.person2]]) {
      const x = hand[0] + side * 0.46 * S;
      for (const dy of [-0.16, 0.16]) limb(g, [[x, hand[1] + dy * S], [x - side * 0.2 * S, hand[1] + dy * 1.1 * S], [hand[0] + side * 0.02 * S, hand[1] + dy * 0.2 * S]], 0.08 * S, other);
      g.fillStyle = main;
      g.beginPath(); g.roundRect(x - 0.1 * S, hand[1] - 0.23 * S, 0.2 * S, 0.46 * S, 0.1 * S); g.fill();
      g.fillStyle = side < 0 ? other : "#4a342a";
      g.beginPath(); g.arc(x, hand[1], 0.095 * S, 0, 7); g.fill();
      if (side < 0) { g.fillStyle = s.mode === 2 ? COLOURS.hold : s.mode === 1 ? COLOURS.comply : "#bdf0e4"; g.beginPath(); g.arc(x + 0.05 * S, hand[1], 0.022 * S, 0, 7); g.fill(); }
    }
  }

  // What the partner does to the robot's hand, as it feels it.
  force(g, hand, s) {
    const size = Math.hypot(...s.force);
    if (!(size > 0.4)) return;
    const tip = this.at(s.robot.map((x, n) => x + s.force[n] * Math.min(FORCE_M_PER_N, LONGEST_M / size)), 0);
    arrow(g, hand, tip, 0.028 * this.scale, COLOURS.force);
    g.fillStyle = COLOURS.ink;
    g.font = "600 13px system-ui, sans-serif";
    g.textAlign = "center";
    g.fillText(`${size.toFixed(1)} N`, hand[0] - 0.02 * this.scale, hand[1] + (tip[1] <= hand[1] ? 0.105 : -0.085) * this.scale);
  }

  // The elastic between hand and pointer: how far it is stretched is the force.
  pull(g, hand, s) {
    if (!s.pointer) return;
    const to = [hand[0] + (s.pointer[0] - s.place[0]), hand[1] + (s.pointer[1] - s.place[1])];
    const far = Math.hypot(to[0] - hand[0], to[1] - hand[1]), share = Math.min(s.pullN / 15, 1);
    g.save();
    g.lineCap = "round";
    if (far > 4) {
      g.strokeStyle = mixed(COLOURS.person2, COLOURS.force, share);
      g.lineWidth = Math.max(2.2, 7 - far / 22);
      g.beginPath(); g.moveTo(hand[0], hand[1]); g.lineTo(to[0], to[1]); g.stroke();
    }
    g.lineWidth = 2.5;
    g.strokeStyle = COLOURS.ink;
    g.fillStyle = mixed(COLOURS.card, COLOURS.force, share * 0.8);
    g.beginPath(); g.arc(to[0], to[1], 10, 0, 7); g.fill(); g.stroke();
    g.restore();
  }

  invitation(g, hand, s) {
    const t = calm() ? 0.62 : (s.now / 2600) % 1, S = this.scale;
    const goes = s.goal ? this.at(s.goal, 1) : this.at(s.robot.map((x, n) => x + (this.task.invites?.[n] ?? (n === Math.max(this.up, 0) ? 0.25 : 0))), 1);
    const u = clamp((t - 0.22) / 0.55, 0, 1), e = u * u * u * (10 + u * (-15 + 6 * u));
    const x = hand[0] + (goes[0] - hand[0]) * e, y = hand[1] + (goes[1] - hand[1]) * e, alpha = t < 0.1 ? t * 10 : t > 0.86 ? (1 - t) / 0.14 : 1;
    g.save();
    g.globalAlpha = 0.45;
    g.setLineDash([2, 7]); g.lineCap = "round"; g.lineWidth = 3; g.strokeStyle = COLOURS.ink;
    g.beginPath(); g.moveTo(hand[0], hand[1]); g.lineTo(goes[0], goes[1]); g.stroke();
    g.setLineDash([]);
    g.globalAlpha = alpha;
    if (t < 0.3 && !calm()) {
      g.strokeStyle = COLOURS.person; g.lineWidth = 2;
      g.beginPath(); g.arc(x, y, (0.05 + 0.12 * (t / 0.3)) * S, 0, 7); g.globalAlpha = alpha * (1 - t / 0.3); g.stroke();
      g.globalAlpha = alpha;
    }
    pointer(g, x, y, 0.1 * S);
    g.restore();
  }

  ring(g, hand, share) {
    g.lineWidth = 4;
    g.strokeStyle = COLOURS.goal;
    g.beginPath(); g.arc(hand[0], hand[1], 0.09 * this.scale, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * share); g.stroke();
  }

  celebrate(g, hand, left) {
    if (calm()) return;
    g.save();
    g.globalAlpha = left;
    for (let n = 0; n < 14; n++) {
      const angle = (n / 14) * 2 * Math.PI, r = (0.1 + 0.22 * (1 - left)) * this.scale;
      g.fillStyle = [COLOURS.goal, COLOURS.person, COLOURS.robot][n % 3];
      g.beginPath(); g.arc(hand[0] + Math.cos(angle) * r, hand[1] + Math.sin(angle) * r, 4, 0, 7); g.fill();
    }
    g.restore();
  }
}

export function clamp(x, low, high) { return Math.min(Math.max(x, low), high); }

function limb(g, points, width, colour) {
  g.strokeStyle = colour; g.lineWidth = width; g.lineCap = g.lineJoin = "round";
  g.beginPath();
  points.forEach((p, n) => (n ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
  g.stroke();
}

function joint(a, b, reach, side) {
  const dx = b[0] - a[0], dy = b[1] - a[1], d = Math.max(Math.hypot(dx, dy), 1e-6), h = Math.sqrt(Math.max(reach * reach - (d * d) / 4, 0));
  return [a[0] + dx / 2 + ((dy * h) / d) * side, a[1] + dy / 2 - ((dx * h) / d) * side];
}

function arrow(g, from, to, width, colour) {
  const angle = Math.atan2(to[1] - from[1], to[0] - from[0]), far = Math.hypot(to[0] - from[0], to[1] - from[1]), head = Math.min(width * 1.7, far);
  g.save();
  g.translate(from[0], from[1]);
  g.rotate(angle);
  g.fillStyle = colour;
  g.beginPath();
  g.moveTo(0, -width / 3); g.lineTo(far - head, -width / 3); g.lineTo(far - head, -width); g.lineTo(far, 0); g.lineTo(far - head, width); g.lineTo(far - head, width / 3); g.lineTo(0, width / 3);
  g.closePath(); g.fill();
  g.restore();
}

// A mouse's arrow, for somebody who sees the page for the first time
function pointer(g, x, y, size) {
  g.save();
  g.translate(x, y);
  g.scale(size / 24, size / 24);
  g.fillStyle = "#fff"; g.strokeStyle = "#1d2b3e"; g.lineWidth = 1.8; g.lineJoin = "round";
  g.beginPath();
  g.moveTo(0, 0); g.lineTo(0, 19); g.lineTo(4.6, 14.9); g.lineTo(7.9, 22.3); g.lineTo(11.2, 20.8); g.lineTo(8, 13.6); g.lineTo(14, 13.4); g.closePath();
  g.fill(); g.stroke();
  g.restore();
}

function channels(colour) {
  const hex = colour.replace("#", "");
  return hex.length === 6 ? [0, 2, 4].map(n => parseInt(hex.slice(n, n + 2), 16)) : [128, 128, 128];
}

export function mixed(a, b, share) {
  const one = channels(a), other = channels(b);
  return `rgb(${one.map((c, n) => Math.round(c + (other[n] - c) * share)).join(" ")})`;
}
