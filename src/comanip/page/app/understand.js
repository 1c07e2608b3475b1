// The paper's figures, alive: what was learned as ellipses, a motion from wherever it is begun (Fig. 3), and the same force at
// another time (Fig. 7).

import { COLOURS, clamp, fitted, mixed } from "./scene.js";
import { Filter, learnHmm, regression } from "./em.js";
import { chances } from "./session.js";
import { element } from "./teach.js";

const DT = 0.02, LETTER = [[0.16, 0.26], [0.06, 0.3], [0.0, 0.22], [0.08, 0.15], [0.15, 0.08], [0.08, 0.0], [-0.02, 0.03]];

export class Understand {
  constructor(page, box) {
    this.page = page;
    this.box = box;
    this.start = [0.2, 0.2];
    this.values = { K: 6, gain: 8, spread: 1, warp: 0, late: 0, which: "both", K3: 8 };
    this.build();
  }

  build() {
    const grid = element("div", "figs");
    grid.append(this.ellipsesPanel(), this.letterPanel(), this.forcePanel());
    this.box.append(grid);
  }

  panel(title, says, label) {
    const panel = element("div", "panel"), canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", label);
    panel.append(element("h2", "", title), element("p", "soft", says), canvas);
    return [panel, canvas];
  }

  ellipsesPanel() {
    const [panel, canvas] = this.panel("What it learned", "One ellipse a state, two deviations wide, in the order of the task from light to dark; your last lift as a line.", "Ellipses of the learned states");
    this.ellipses = canvas;
    const row = element("div", "row");
    this.pick = {};
    for (const [name, label] of [["role", "role"], ["x", "across"], ["y", "up"]]) {
      const field = element("label", "field", label), select = document.createElement("select");
      select.addEventListener("change", () => { if (name === "role") this.channels(); this.drawEllipses(); });
      field.append(select);
      row.append(field);
      this.pick[name] = select;
    }
    panel.append(row);
    return panel;
  }

  slider(panel, name, label, low, high, step, shown, changed) {
    const field = document.createElement("label"), input = document.createElement("input"), value = element("output");
    input.type = "range";
    Object.assign(input, { min: low, max: high, step, value: this.values[name] });
    input.addEventListener("input", () => { this.values[name] = Number(input.value); value.textContent = shown(this.values[name]); changed(); });
    value.textContent = shown(this.values[name]);
    field.append(element("span", "", label), input, value);
    panel.append(field);
  }

  letterPanel() {
    const [panel, canvas] = this.panel("A motion from anywhere (Fig. 3)", "Drag the dot: the learned velocity goes along the path and strays, the learned position comes back and stops; both together do what neither does.", "A letter written from a start that can be dragged; arrow keys move it");
    this.letter = canvas;
    canvas.className = "drags"; // on the other figures a finger scrolls the page
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    const place = event => { const box = canvas.getBoundingClientRect(); this.start = this.letterWorld(event.clientX - box.left, event.clientY - box.top); this.drawLetter(); };
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); this.drags = true; place(event); });
    canvas.addEventListener("pointermove", event => { if (this.drags) place(event); });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { this.drags = false; });
    canvas.addEventListener("keydown", event => {
      const by = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
      if (by) { event.preventDefault(); this.start = this.start.map((x, n) => x + 0.01 * by[n]); this.drawLetter(); }
    });
    const field = element("label", "field", "terms of the law"), select = document.createElement("select");
    for (const [value, text] of [["both", "velocity and position"], ["velocity", "velocity alone"], ["position", "position alone"]]) select.append(new Option(text, value));
    select.addEventListener("change", () => { this.values.which = select.value; this.drawLetter(); });
    field.append(select);
    panel.append(field);
    this.slider(panel, "K3", "states K", 2, 12, 1, String, () => { this.letterModel = null; this.drawLetter(); });
    return panel;
  }

  forcePanel() {
    const [panel, canvas] = this.panel("The same force at another time (Fig. 7)", "Lessons drawn from what this skill remembers; their force, distorted in time, moves the hand by the paper's law. A force that is played back answers nobody: it says nothing about carrying together.", "Height over time under a force that is played back");
    this.forces = canvas;
    const again = () => { this.forceModel = null; this.drawForces(); };
    this.slider(panel, "K", "states K", 2, 10, 1, String, again);
    this.slider(panel, "spread", "variability of lessons", 0, 3, 0.1, x => x.toFixed(1), again);
    this.slider(panel, "gain", "attraction λ [1/s]", 0, 16, 0.5, x => x.toFixed(1), () => this.drawForces());
    this.slider(panel, "warp", "time distortion", -0.8, 0.8, 0.05, x => x.toFixed(2), () => this.drawForces());
    this.slider(panel, "late", "partner late by [s]", 0, 3, 0.1, x => x.toFixed(1), () => this.drawForces());
    return panel;
  }

  enter() {
    const roles = Object.keys(this.page.skills), select = this.pick.role;
    select.replaceChildren(...roles.map(role => new Option(role, role)));
    this.channels();
    this.forceModel = null;
    requestAnimationFrame(() => this.draw());
  }

  channels() {
    const skill = this.page.skills[this.pick.role.value];
    if (!skill) return;
    for (const [name, n] of [["x", 0], ["y", skill.model.channels.length - 1]]) {
      this.pick[name].replaceChildren(...skill.model.channels.map(channel => new Option(channel, channel)));
      this.pick[name].selectedIndex = n;
    }
  }

  draw() {
    if (this.box.hidden || !this.pick.role.value) return;
    this.drawEllipses();
    this.drawLetter();
    this.drawForces();
  }

  drawEllipses() {
    const fit = fitted(this.ellipses), skill = this.page.skills[this.pick.role.value];
    if (!fit || !skill) return;
    const [g, w, h] = fit, model = skill.model, i = model.channels.indexOf(this.pick.x.value), j = model.channels.indexOf(this.pick.y.value), line = this.lastLift(model.channels[i], model.channels[j]);
    const spread = c => model.means.flatMap((mean, k) => [mean[c] - 2.3 * Math.sqrt(model.covariances[k][c][c]), mean[c] + 2.3 * Math.sqrt(model.covariances[k][c][c])]);
    const [X, Y] = axes(g, w, h, [...spread(i), ...line.map(p => p[0])], [...spread(j), ...line.map(p => p[1])], unitOf(model.channels[i]), unitOf(model.channels[j]));
    model.means.forEach((mean, k) => {
      const share = model.means.length > 1 ? k / (model.means.length - 1) : 1, S = model.covariances[k];
      g.strokeStyle = mixed(COLOURS.robot2, COLOURS.ink, share);
      g.fillStyle = g.strokeStyle;
      g.lineWidth = 1.6;
      g.beginPath();
      const a = S[i][i], b = S[i][j], c = S[j][j], l11 = Math.sqrt(a), l21 = b / l11, l22 = Math.sqrt(Math.max(c - l21 * l21, 0));
      for (let n = 0; n <= 48; n++) { const t = (n / 48) * 2 * Math.PI, u = 2 * Math.cos(t), v = 2 * Math.sin(t); g.lineTo(X(mean[i] + l11 * u), Y(mean[j] + (i === j ? l11 * u : l21 * u + l22 * v))); }
      g.stroke();
      g.globalAlpha = 0.1; g.fill(); g.globalAlpha = 1;
      g.font = "11px system-ui, sans-serif"; g.textAlign = "center";
      g.fillText(String(k + 1), X(mean[i]), Y(mean[j]) + 4);
    });
    stroke(g, line.map(([x, y]) => [X(x), Y(y)]), COLOURS.person, 2);
  }

  lastLift(one, other) {
    const last = this.page.takes[this.page.takes.length - 1]?.take;
    if (!last) return [];
    const axes = this.page.config.task.axes.map(axis => axis.name);
    const column = channel => { const [group, axis] = channel.split("."); return last[group]?.map(row => row[axes.indexOf(axis)]); };
    const a = column(one), b = column(other);
    return a && b ? a.map((x, n) => [x, b[n]]).filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y)) : [];
  }

  letterWorld(x, y) { const s = this.letterScale; return [(x - s.x0) / s.k, (s.y0 - y) / s.k]; }

  drawLetter() {
    const fit = fitted(this.letter);
    if (!fit) return;
    const [g, w, h] = fit, k = Math.min(w / 0.56, h / 0.52);
    this.letterScale = { k, x0: w / 2 - 0.07 * k, y0: h / 2 + 0.155 * k };
    const at = ([x, y]) => [this.letterScale.x0 + x * k, this.letterScale.y0 - y * k];
    this.letterModel ??= this.letterLearned();
    const { lessons, model } = this.letterModel;
    g.clearRect(0, 0, w, h);
    for (const lesson of lessons) stroke(g, lesson.map(at), COLOURS.line, 2);
    const run = this.letterRun(model);
    stroke(g, run.map(at), COLOURS.robot, 3);
    const [sx, sy] = at(this.start), [ex, ey] = at(run[run.length - 1]);
    g.fillStyle = COLOURS.robot;
    g.beginPath(); g.arc(ex, ey, 5, 0, 7); g.fill();
    g.fillStyle = COLOURS.person; g.strokeStyle = COLOURS.card; g.lineWidth = 3;
    g.beginPath(); g.arc(sx, sy, 10, 0, 7); g.fill(); g.stroke();
  }

  letterLearned() {
    const chance = chances(3), lessons = [];
    for (let n = 0; n < 6; n++) {
      const off = [normal(chance) * 0.006, normal(chance) * 0.006], bend = normal(chance) * 0.01;
      lessons.push(Array.from({ length: 110 }, (_, t) => { const u = t / 109, s = u * u * (3 - 2 * u); return spline(s).map((x, i) => x + off[i] + bend * Math.sin(Math.PI * s) * (i ? 1 : -1)); }));
    }
    const rows = lessons.map(lesson => lesson.map((x, t) => { const before = lesson[Math.max(t - 1, 0)], after = lesson[Math.min(t + 1, lesson.length - 1)], dt = DT * (t === 0 || t === lesson.length - 1 ? 1 : 2); return [...x, (after[0] - before[0]) / dt, (after[1] - before[1]) / dt]; }));
    return { lessons, model: learnHmm(rows, this.values.K3) };
  }

  letterRun(model) {
    const filter = new Filter(model, [0, 1], [0.0016, 0.0016]), close = new Filter(model, [0, 1]), speed = regression(model, [0, 1], [2, 3], [0.0016, 0.0016]), place = regression(model, [2, 3], [0, 1], [0.01, 0.01]);
    let x = this.start.slice(), v = [0, 0];
    const run = [x.slice()], { which } = this.values, attraction = 8;
    for (let t = 0; t < 170; t++) {
      const weights = filter.step(x), wanted = speed(weights, x).map(one => clamp(one, -0.6, 0.6)), there = place(weights, wanted), pull = attraction * close.stray(x);
      v = x.map((p, n) => (which === "position" ? 0 : wanted[n]) + (which === "velocity" ? 0 : (which === "position" ? attraction : pull) * (there[n] - p)));
      x = x.map((p, n) => clamp(p + DT * clamp(v[n], -1, 1), -0.5, 0.8));
      run.push(x.slice());
    }
    return run;
  }

  drawForces() {
    const fit = fitted(this.forces);
    if (!fit) return;
    const [g, w, h] = fit;
    this.forceModel ??= this.forceLearned();
    const { lessons, model } = this.forceModel, { force, expected } = this.distorted(lessons[0]), run = this.forceRun(model, lessons[0][0][0], force), tall = h * 0.68;
    const heights = [...lessons.flat().map(row => row[0]), ...run], longest = Math.max(force.length, ...lessons.map(one => one.length)) * DT;
    const [X, Y] = axes(g, w, tall, [0, longest], heights, "s", "m", h);
    for (const lesson of lessons) stroke(g, lesson.map((row, t) => [X(t * DT), Y(row[0])]), COLOURS.line, 1.6);
    stroke(g, expected.map((x, t) => [X(t * DT), Y(x)]), COLOURS.soft, 1.6, [6, 5]);
    stroke(g, run.map((x, t) => [X(t * DT), Y(x)]), COLOURS.robot, 3);
    const most = Math.max(4, ...force.map(Math.abs));
    stroke(g, force.map((f, t) => [X(t * DT), h * 0.85 - (f / most) * h * 0.12]), COLOURS.force, 1.8);
    g.fillStyle = COLOURS.soft; g.font = "11px system-ui, sans-serif"; g.textAlign = "left";
    g.fillText("force played back", 46, h - 6);
  }

  // Lessons as this skill remembers them: its path in other sizes and paces, with its force.
  forceLearned() {
    const skill = this.page.skills.follower ?? Object.values(this.page.skills)[0], path = skill.paths[0], axis = this.page.mainAxis(), chance = chances(7), spread = this.values.spread, lessons = [];
    const rest = 0.5, long = (path.position_m.length - 1) * path.step_s;
    for (let n = 0; n < 5; n++) {
      const size = 1 + 0.08 * spread * normal(chance), pace = Math.exp(0.12 * spread * normal(chance)), frames = Math.round((2 * rest + long * pace) / DT);
      const at = (table, t) => { const p = clamp((t * DT - rest) / pace / path.step_s, 0, table.length - 1), i = Math.min(Math.floor(p), table.length - 2); return table[i][axis] + (p - i) * (table[i + 1][axis] - table[i][axis]); };
      const x0 = path.position_m[0][axis], x = Array.from({ length: frames }, (_, t) => x0 + size * (at(path.position_m, t) - x0));
      lessons.push(x.map((p, t) => [p, at(path.force_n, t) * size + 0.15 * spread * normal(chance), (x[Math.min(t + 1, frames - 1)] - x[Math.max(t - 1, 0)]) / (2 * DT)]));
    }
    return { lessons, model: learnHmm(lessons, this.values.K, { floor: 3e-4 }) };
  }

  distorted(lesson) {
    const { warp, late } = this.values, wait = Math.round(late / DT), n = lesson.length, force = [], expected = [];
    for (let t = 0; t < wait; t++) { force.push(Math.min((t * DT) / 0.2, 1) * 4); expected.push(lesson[0][0]); }
    for (let t = 0; t < n; t++) {
      const u = t / (n - 1), at = clamp(u + warp * u * (1 - u), 0, 1) * (n - 1), i = Math.min(Math.floor(at), n - 2), share = at - i;
      force.push((1 - share) * lesson[i][1] + share * lesson[i + 1][1]);
      expected.push((1 - share) * lesson[i][0] + share * lesson[i + 1][0]);
    }
    return { force, expected };
  }

  forceRun(model, x0, force) {
    const filter = new Filter(model, [0, 1], [1e-4, 0.3]), close = new Filter(model, [0]), speed = regression(model, [0, 1], [2]), place = regression(model, [1, 2], [0]), top = Math.max(...model.means.map(mean => Math.abs(mean[2]))) * 1.8;
    let x = x0;
    return force.map(f => {
      const weights = filter.step([x, f]), [wanted] = speed(weights, [x, f]), v = clamp(wanted, -top, top), [there] = place(weights, [f, v]);
      x += DT * (v + this.values.gain * close.stray([x]) * (there - x));
      return x;
    });
  }
}

function normal(chance) { let sum = -6; for (let n = 0; n < 12; n++) sum += chance(); return sum; }

// A smooth curve through the letter's points, at share s of its way
function spline(s) {
  const at = s * (LETTER.length - 1), i = Math.min(Math.floor(at), LETTER.length - 2), u = at - i, p = n => LETTER[clamp(n, 0, LETTER.length - 1)];
  return [0, 1].map(d => { const [a, b, c, e] = [p(i - 1)[d], p(i)[d], p(i + 1)[d], p(i + 2)[d]]; return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - e + u * (3 * (b - c) + e - a))); });
}

function unitOf(channel) { const units = { position: "m", velocity: "m/s", force: "N" }; const group = channel.split(".")[0]; return `${channel} [${units[group] ?? ""}]`; }

function stroke(g, points, colour, width, dash = []) {
  g.strokeStyle = colour; g.lineWidth = width; g.lineJoin = g.lineCap = "round"; g.setLineDash(dash);
  g.beginPath();
  points.forEach(([x, y], n) => (n ? g.lineTo(x, y) : g.moveTo(x, y)));
  g.stroke();
  g.setLineDash([]);
}

// Clears, draws two axes with round numbers, and gives the two scales.
function axes(g, w, h, xs, ys, xName, yName, whole = h) {
  const range = values => { let low = Infinity, high = -Infinity; for (const v of values) { if (v < low) low = v; if (v > high) high = v; } if (!(high > low)) { low -= 0.5; high += 0.5; } const pad = (high - low) * 0.06; return [low - pad, high + pad]; };
  const [x0, x1] = range(xs), [y0, y1] = range(ys), left = 44, below = 30;
  const X = x => left + ((x - x0) / (x1 - x0)) * (w - left - 8), Y = y => h - below - ((y - y0) / (y1 - y0)) * (h - below - 8);
  g.clearRect(0, 0, w, whole);
  g.font = "11px system-ui, sans-serif";
  g.fillStyle = COLOURS.soft; g.strokeStyle = COLOURS.line; g.lineWidth = 1;
  for (const x of ticks(x0, x1)) { g.textAlign = "center"; g.fillText(String(x), X(x), h - below + 14); g.beginPath(); g.moveTo(X(x), 8); g.lineTo(X(x), h - below); g.stroke(); }
  for (const y of ticks(y0, y1)) { g.textAlign = "right"; g.fillText(String(y), left - 5, Y(y) + 4); g.beginPath(); g.moveTo(left, Y(y)); g.lineTo(w - 8, Y(y)); g.stroke(); }
  g.textAlign = "right"; g.fillText(xName, w - 8, h - 3);
  g.textAlign = "left"; g.fillText(yName, left + 4, 10);
  return [X, Y];
}

function ticks(low, high) {
  const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map(n => n * power).find(n => n >= raw), out = [];
  for (let x = Math.ceil(low / step) * step; x <= high; x += step) out.push(Number(x.toPrecision(6)));
  return out;
}
