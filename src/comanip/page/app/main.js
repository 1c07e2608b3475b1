// What the page is made of, wired together.

import { Engine } from "./engine.js";
import { Scene, clamp, takeColours } from "./scene.js";
import { Hands } from "./hands.js";
import { Session, asking, chances } from "./session.js";
import { Sound } from "./sound.js";
import { Bars, Shares, Strips, expectation } from "./strips.js";
import { bytesOf, download, numbersOf, tell } from "./files.js";
import { recordingCsv } from "./recordings.js";
import { Teach } from "./teach.js";
import { Study } from "./study.js";
import { Understand } from "./understand.js";
import { about } from "./about.js";
import { readSkill } from "./skillfile.js";

const $ = id => document.getElementById(id);
const MOST_FILES = 60;
const WHO = { leader: ["leads", "it leads"], follower: ["follows", "it follows"], natural: ["shares", "both"], neither: ["none", "?"] };

class Page {
  constructor(engine, config) {
    this.engine = engine;
    this.config = config;
    this.scene = new Scene($("scene"), config.task);
    this.sound = new Sound();
    this.strips = new Strips($("strips"));
    this.states = new Bars($("states"));
    this.session = new Session(engine, config, { ticked: s => this.ticked(s), ended: s => this.ended(s), began: () => this.began(), ready: () => this.fresh() });
    this.hands = new Hands(this.scene, { takes: () => this.session.takes(), lets: () => this.session.lets(performance.now()), moves: () => this.passes(performance.now()), here: () => this.session.here() });
    this.tally = { done: 0, good: 0 };
    this.mode = "lift";
    this.takes = [];
    this.frames = [];
    this.latencies = []; // [ms] from a pointer's event until the world has moved with it, and until that is drawn
    this.drawn = [];
    this.seed = config.seed;
    this.wire();
    this.sayAxes();
    this.takeSkills(config.skills, config.numbers);
    this.teach = new Teach(this, $("teach"));
    this.study = new Study(this, $("study"));
    this.understand = new Understand(this, $("understand"));
    requestAnimationFrame(now => { this.then = now; this.frame(now); });
  }

  // skills: {role: content of a skill file}, numbers: {role: Float64Array | text of base64}
  takeSkills(skills, numbers) {
    this.skills = skills;
    this.numbers = Object.fromEntries(Object.entries(numbers).map(([role, text]) => [role, typeof text === "string" ? numbersOf(text) : text]));
    for (const button of document.querySelectorAll("#roles button")) button.disabled = button.hidden = !this.numbers[button.dataset.role];
    const order = ["follower", "leader", "auto"].filter(role => this.numbers[role]);
    $("skill-name").textContent = this.config.title ? `· ${this.config.title}` : "";
    this.setRole(order[0]);
  }

  wire() {
    const tabs = [...document.querySelectorAll("nav [role=tab]")];
    tabs.forEach((tab, n) => {
      tab.addEventListener("click", () => this.show(tab.id.slice(4)));
      tab.addEventListener("keydown", event => {
        const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (by) { const next = tabs[(n + by + tabs.length) % tabs.length]; next.focus(); this.show(next.id.slice(4)); }
      });
    });
    const roles = [...document.querySelectorAll("#roles button")];
    roles.forEach(button => {
      button.addEventListener("click", () => this.setRole(button.dataset.role));
      button.addEventListener("keydown", event => {
        const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key], shown = roles.filter(one => !one.hidden);
        if (by) { event.preventDefault(); const next = shown[(shown.indexOf(button) + by + shown.length) % shown.length]; this.setRole(next.dataset.role); next.focus(); }
      });
    });
    $("sound").addEventListener("click", () => $("sound").setAttribute("aria-pressed", String(this.sound.toggle())));
    $("theme").addEventListener("click", () => this.theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
    $("rearm").addEventListener("click", () => this.rearm());
    $("open").addEventListener("click", () => $("file").click());
    $("file").addEventListener("change", () => { this.receive($("file").files); $("file").value = ""; });
    $("save-take").addEventListener("click", () => this.keep());
    document.addEventListener("keydown", event => {
      if (event.target.matches?.("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key.toLowerCase() === "r" && !$("rearm").hidden) this.rearm();
    });
    addEventListener("beforeunload", event => { if (this.teach.unsaved || this.study.unsaved) event.preventDefault(); });
    let inside = 0;
    addEventListener("dragenter", event => { event.preventDefault(); inside++; $("drop").hidden = false; });
    addEventListener("dragleave", () => { if (--inside <= 0) $("drop").hidden = true; });
    addEventListener("dragover", event => event.preventDefault());
    addEventListener("drop", event => { event.preventDefault(); inside = 0; $("drop").hidden = true; this.receive(event.dataTransfer.files); });
    const dark = matchMedia("(prefers-color-scheme: dark)");
    this.theme(dark.matches ? "dark" : "light");
    dark.addEventListener("change", () => this.theme(dark.matches ? "dark" : "light"));
  }

  // Which axis has no room in the picture, and how it is moved
  sayAxes() {
    const { depth } = this.scene, name = this.config.task.axes[depth]?.name;
    $("depth").hidden = depth < 0;
    if (depth >= 0) $("scene").setAttribute("aria-label", `${$("scene").getAttribute("aria-label")} Q and E, page down and page up, the wheel, or a second finger move it along ${name}, into the picture; as long as nobody steers it there, the hand goes along.`);
  }

  theme(name) {
    document.documentElement.dataset.theme = name;
    takeColours();
    this.understand?.draw();
    this.teach?.draw();
  }

  show(name) {
    for (const tab of document.querySelectorAll("nav [role=tab]")) {
      const on = tab.id === `tab-${name}`;
      tab.setAttribute("aria-selected", String(on));
      tab.tabIndex = on ? 0 : -1;
      $(tab.id.slice(4)).hidden = !on;
    }
    const before = this.mode;
    this.mode = name;
    $("stage").hidden = name === "understand" || name === "about";
    $("stage").style.display = $("stage").hidden ? "none" : "";
    $("roles").style.display = name === "lift" ? "" : "none";
    if (before !== name) {
      this.hands.release();
      if (name === "lift") this.fresh();
      if (name === "teach") this.teach.enter();
      if (name === "study") this.study.enter();
      if (name === "understand") this.understand.enter();
      if (name === "about") about($("about"), { ...this.config, skills: this.skills });
    }
  }

  setRole(role) {
    if (!this.numbers[role]) return;
    this.role = role;
    for (const button of document.querySelectorAll("#roles button")) {
      const on = button.dataset.role === role;
      button.setAttribute("aria-checked", String(on));
      button.tabIndex = on ? 0 : -1;
    }
    const names = role === "auto" ? [...Object.keys(this.skills).filter(one => WHO[one]), "neither"] : [];
    $("role-box").hidden = !names.length;
    this.shares = names.length ? new Shares($("role"), names.map(name => WHO[name])) : null;
    this.shares?.show(names.map(() => 1));
    this.fresh();
  }

  // The next lift of the present role.
  fresh() {
    if (this.mode === "teach") return this.teach.next();
    if (this.mode === "study") return this.study.next();
    this.session.prepare(this.lift(this.role, { kind: "skill", numbers: this.numbers[this.role] }, this.seed++));
    $("verdict").hidden = true;
    this.strips.clear();
    return undefined;
  }

  lift(role, robot, seed) {
    const chance = chances(seed), of = this.skills[role === "auto" ? "leader" : role] ?? Object.values(this.skills)[0];
    const start = this.session.start, ends = of.ends_m.map(end => end.map((x, n) => x - start[n])), taught = this.taught();
    const size = taught.length === 1 && start.length === 1 ? 0.7 + 0.5 * chance() : 1, way = taught[Math.floor(chance() * taught.length)].map(row => row.map(x => x * size));
    return { robot, seed, asked: role, ends, ...asking(way, role !== "leader") };
  }

  // The ways that lessons of these skills went: rows (d,) from the start
  taught() {
    const of = this.skills.leader ?? Object.values(this.skills)[0], start = this.session.start;
    return of.paths.map(path => path.position_m.map(row => row.map((x, n) => x - start[n])));
  }

  // How long lessons took [s]
  guideS() { const [path] = (this.skills.leader ?? Object.values(this.skills)[0]).paths; return path.step_s * (path.position_m.length - 1); }

  mainAxis() { return Math.max(this.config.task.axes.findIndex(axis => axis.up !== 0), 0); }

  began() {
    $("verdict").hidden = true;
    this.strips.clear();
    this.canvasHolds(true);
  }

  canvasHolds(on) { $("scene").classList.toggle("holding", on); }

  ticked(session) {
    const world = session.world, take = session.take, n = take.position.length - 1, mode = take.mode[n];
    if (mode === 2 && this.modeWas !== 2) this.sound.held();
    this.modeWas = mode;
    if (this.mode !== "lift") return; // robots of a study may be others than the page's
    const weights = take.weights[n], skill = this.skills[this.role === "auto" ? "leader" : this.role];
    const along = this.mainAxis();
    const row = { t: world.get("time_s"), x: take.position[n][along], v: take.velocity[n][along], f: take.force[n][along], ex: NaN, sx: NaN, ev: NaN, sv: NaN, ef: NaN, sf: NaN };
    if (weights.length && session.setup.robot.kind === "skill" && skill) {
      const expects = expectation(skill.model, weights), at = group => skill.model.channels.indexOf(`${group}.${skill.axes[along]}`);
      for (const [group, name] of [["position", "x"], ["velocity", "v"], ["force", "f"]]) if (at(group) >= 0) [row[`e${name}`], row[`s${name}`]] = expects[at(group)];
    }
    this.strips.add(row);
  }

  ended(session) {
    const found = session.verdict;
    this.sound.force(0, 0);
    this.canvasHolds(false);
    if (this.mode === "teach") return this.teach.ended(session);
    if (this.mode === "study") return this.study.ended(session);
    if (!found) return undefined;
    this.tally.done++;
    if (found.success) { this.tally.good++; this.celebrates = performance.now(); this.sound.arrived(); } else this.sound.missed();
    $("tally").textContent = `${this.tally.good} of ${this.tally.done} good`;
    this.takes.push({ role: this.role, seed: session.setup.seed, take: session.take, verdict: found, goal: session.setup.goal });
    if (this.takes.length > 200) this.takes.shift();
    $("save-take").disabled = false;
    this.sayVerdict(found);
    if (!this.hands.target || this.hands.kind !== "pointer") this.goesBack(1400);
    return undefined;
  }

  // In a while the hand is open and the beam goes back, unless another lift has been prepared meanwhile: that one is held by somebody.
  goesBack(milliseconds) {
    const { session } = this, { take } = session;
    setTimeout(() => {
      if (session.take !== take) return;
      this.hands.release();
      session.goBack(performance.now());
    }, milliseconds);
  }

  sayVerdict(found) {
    const box = $("verdict"), parts = [];
    const part = (big, small) => { const div = document.createElement("div"); const b = document.createElement("b"); b.textContent = big; const s = document.createElement("small"); s.textContent = small; div.append(b, s); parts.push(div); };
    const mark = document.createElement("span");
    mark.className = found.success ? "stars" : "stars no";
    mark.textContent = found.success ? "✓" : "✗";
    mark.setAttribute("aria-label", found.success ? "good" : "not good");
    parts.push(mark);
    if (found.failures.length) part(found.failures[0], found.failures.slice(1).join(", ") || "this time");
    part(found.effort_n2s.toFixed(1), "your effort, N² s");
    part(`${found.peak_n.toFixed(1)} N`, "highest force");
    if (found.end_error_m !== null) part(`${(found.end_error_m * 1000).toFixed(0)} mm`, "from the goal");
    box.replaceChildren(...parts);
    box.hidden = false;
  }

  keep() {
    const last = this.takes[this.takes.length - 1];
    if (last) download(`comanip-lift-${last.role}-${last.seed}.csv`, recordingCsv(this.config.task, last.take, { role: "", robot: last.role, seed: last.seed }), "text/csv");
  }

  rearm() {
    const world = this.session.world, refused = world.rearm();
    if (refused) tell(`not yet: ${this.engine.text(this.engine.wasm.page_reason(refused))}`);
    $("scene").focus({ preventScroll: true });
  }

  status() {
    const world = this.session.world, mode = world.get("mode"), box = $("mode"), phase = this.session.phase;
    let text = { idle: "take the handle", ended: "done", back: "again" }[phase] ?? "";
    if (phase === "runs") {
      const said = world.reason, value = world.get("reason_value");
      if (mode > 0) text = `${mode === 2 ? "holds" : "gives way"}: ${said.replace("%", Number.isFinite(value) ? value.toPrecision(2) : "")}`;
      else text = this.session.letGo ? "you let go" : { 0: "follows", 1: "offers to lead", 2: "leads", 3: "only gives way" }[world.get("acts")] ?? "runs";
      if (mode === 0 && this.session.setup.robot.kind !== "skill") text = "runs";
    }
    const holds = phase === "runs" ? mode : 0;
    if (box.dataset.mode !== String(holds)) box.dataset.mode = String(holds);
    if ($("status").textContent !== text) $("status").textContent = text;
    $("rearm").hidden = !(phase === "runs" && mode === 2);
    if (this.scene.depth >= 0) {
      const n = this.scene.depth, goal = this.session.setup.goal, says = `along ${this.config.task.axes[n].name}: ${this.session.here()[n].toFixed(2)} m${goal ? ` of ${goal[n].toFixed(2)}` : ""}`;
      if ($("depth-says").textContent !== says) $("depth-says").textContent = says;
    }
    const full = Math.max(this.config.energy_j ?? 3, 1e-9), left = phase === "runs" ? Math.max(world.get("tank_j"), 0) : full;
    $("tank").firstElementChild.style.width = `${Math.min((left / full) * 100, 100)}%`;
    $("tank").setAttribute("aria-valuenow", (left / full).toFixed(2));
    $("joules").textContent = `${left.toFixed(1)} J`;
  }

  // The world goes on until now: at each movement of the pointer, and at each frame. A finger's comes just behind a frame, and would
  // wait for the whole of the next one.
  passes(now) {
    const passed = Math.max(now - this.then, 0), before = this.session.here(), { when } = this.hands;
    this.then = Math.max(now, this.then);
    this.session.advance(passed, this.hands.target, now);
    const moved = Math.hypot(...this.session.here().map((x, n) => x - before[n]));
    if (when === undefined || !(moved > 1e-5)) return passed;
    this.kept(this.latencies, performance.now() - when);
    this.hands.when = undefined;
    this.drawsFor ??= when;
    return passed;
  }

  kept(list, value) {
    list.push(value);
    if (list.length > 4000) list.shift();
  }

  frame(now) {
    this.hands.step(clamp(now - this.then, 0, 100) / 1000);
    this.passes(now);
    const s = this.session.shown(now, this.hands.target);
    s.burst = this.celebrates ? Math.max(1 - (now - this.celebrates) / 900, 0) : 0;
    if (this.hands.target && this.session.phase === "runs" && !this.session.letGo) {
      const start = this.session.start;
      s.pointer = this.scene.at?.call(this.scene, this.hands.target, 1);
      s.place = this.scene.at(Array.from(this.session.world.vector("end_position"), (x, n) => x - start[n]), 1);
    }
    if (this.mode !== "understand" && this.mode !== "about") {
      if (this.scene.scale === undefined) this.scene.layout($("scene").clientWidth || 1, $("scene").clientHeight || 1);
      this.scene.draw(s);
      if (this.drawsFor !== undefined) this.kept(this.drawn, performance.now() - this.drawsFor);
      this.drawsFor = undefined;
      this.status();
      const felt = this.session.phase === "runs" ? Math.hypot(...s.force) : 0;
      this.sound.force(felt, Math.hypot(...this.session.world.vector("velocity")));
      if (this.hands.target) this.hands.feel(Math.min(felt / 15, 1), now);
      if (this.mode === "lift") {
        this.strips.draw(this.labels ??= this.stripLabels());
        const weights = this.session.world.shown(0);
        this.states.show(weights.length ? weights : new Array(8).fill(0));
        if (this.shares && this.session.phase === "runs") this.shares.show(this.session.world.shown(1));
      }
      if (this.mode === "teach") this.teach.frame(now);
    }
    this.frames.push(now);
    if (this.frames.length > 600) this.frames.shift();
    requestAnimationFrame(next => this.frame(next));
  }

  stripLabels() {
    const axes = this.config.task.axes, up = axes.findIndex(axis => axis.up !== 0), name = up >= 0 ? "height" : `place ${axes[0].name}`;
    return [[name, "m", 2], ["speed", "m/s", 2], ["force", "N", 1]];
  }

  async receive(files) {
    const wrong = [];
    let lessons = 0;
    for (const file of [...files].slice(0, MOST_FILES)) {
      try {
        if (/\.(csv|mcap)$/i.test(file.name)) { this.teach.open(file.name, new Uint8Array(await file.arrayBuffer())); lessons++; }
        else this.takeFile(file.name, await file.text());
      } catch (error) {
        wrong.push(`${file.name.slice(0, 80)}: ${error.message}`);
      }
    }
    if (lessons) this.show("teach");
    if (wrong.length) tell(wrong.length > 1 ? `${wrong[0]} (and ${wrong.length - 1} more)` : wrong[0]);
    else if (lessons) tell(`${lessons} ${lessons === 1 ? "lesson" : "lessons"} opened`);
  }

  takeFile(name, text) {
    const skill = readSkill(text, this.config), skills = { ...this.skills, [skill.content.role]: skill.content };
    this.config.title = name.slice(0, 60);
    this.takeSkills(skills, { ...this.numbers, ...skill.numbers(skills) });
    this.setRole(skill.content.role);
    tell(`lifts with ${name.slice(0, 80)}, a ${skill.content.role}`);
    this.show("lift");
  }
}

const config = JSON.parse($("config").textContent);
takeColours();
Engine.from(bytesOf(config.wasm)).then(engine => { globalThis.comanip = new Page(engine, config); document.documentElement.dataset.ready = "yes"; }, error => tell(`this browser cannot run the page: ${error.message}`));
