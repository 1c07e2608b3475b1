// Five lessons a role, on the page: the robot is scripted, the person is the person. Trim, delete, replay, and keep them as files.

import { asking, chances } from "./session.js";
import { COLOURS, fitted } from "./scene.js";
import { download, each, plain, tell } from "./files.js";
import { mcapOf, readMcap, zipOf } from "./mcap.js";
import { learned, preparedLesson } from "./learn.js";
import { csvOf, lessonOf, readCsv, recordingOf, within } from "./recordings.js";

const LESSONS = 5, LEAST_LESSONS = 2, SHORTEST_S = 1.0, MOST_KEPT = 60;

// Lesson `number` of a role: the way that is asked for, as the task's lessons vary, and the robot that goes or gives way.
export function lessonAsked(task, role, number, seed) {
  const chance = chances(seed * 1000 + number + (role === "leader" ? 0 : 500)), { lessons } = task;
  const normal = () => { let sum = -6; for (let n = 0; n < 12; n++) sum += chance(); return sum; };
  const size = 1 + lessons.size_sd * normal(), pace = Math.max(lessons.shortest, 1 + lessons.duration_sd * normal()), onset_s = lessons.onset_s[0] + chance() * (lessons.onset_s[1] - lessons.onset_s[0]);
  const rows = task.ways[Math.floor(chance() * task.ways.length)].map(row => row.map(x => x * size)), leads = role === "leader";
  const robot = leads ? { kind: "planned", way: { rows, step_s: lessons.step_s * pace }, onset_s, kg: 6, ns_per_m: 30 } : { kind: "mass-damper", kg: 4, ns_per_m: 15 };
  return { robot, seed: seed * 1000 + number, asked: role, ends: [rows[rows.length - 1]], ...asking(rows, !leads) };
}

export class Teach {
  constructor(page, box) {
    this.page = page;
    this.box = box;
    this.role = "leader";
    this.lessons = [];
    this.count = 0;
    this.build();
  }

  build() {
    const panel = element("div", "panel"), title = element("h2", "", "Teach it");
    const text = element("p", "soft", "Five lessons a role. As it leads, go along with it; as it follows, lift to the dashed beam. Then let it learn, and lift with it. Or keep the lessons, unzip them, comanip learn leader-*.csv -o leader.json, and drop leader.json here. Lessons (CSV, MCAP) can be dropped here, too.");
    this.roles = element("div", "row");
    this.roles.setAttribute("role", "radiogroup");
    this.roles.setAttribute("aria-label", "Lessons of which role");
    for (const [role, label] of [["leader", "It leads"], ["follower", "It follows"]]) {
      const button = element("button", "button", label);
      button.dataset.role = role;
      button.setAttribute("role", "radio");
      button.addEventListener("click", () => { this.role = role; this.enter(); });
      this.roles.append(button);
    }
    this.says = element("span", "soft");
    this.says.setAttribute("role", "status");
    this.asCsv = this.button("Keep all as CSV (ZIP)", () => this.keepAll("csv"));
    this.asMcap = this.button("Keep all as MCAP (ZIP)", () => this.keepAll("mcap"));
    this.learns = this.button("Learn from these", () => this.learn());
    this.keeps = this.button("Keep the skill", () => download(`${this.skill.role}.json`, this.skill.text, "application/json"));
    this.roles.append(this.learns, this.keeps, this.asCsv, this.asMcap, this.says);
    this.list = element("div", "lessons");
    this.list.style.marginTop = ".8rem";
    panel.append(title, text, this.roles, this.list);
    this.box.append(panel);
    this.refresh();
  }

  button(label, does) {
    const one = element("button", "button", label);
    one.addEventListener("click", does);
    return one;
  }

  enter() { this.refresh(); this.next(); }

  // The next lesson: what is asked of it varies as people's lessons do.
  next() {
    this.page.session.prepare(lessonAsked(this.page.config.task, this.role, this.count, this.page.config.seed));
    document.getElementById("verdict").hidden = true;
  }

  ended(session) {
    const take = session.take;
    if (take.position.length * take.dt < SHORTEST_S || session.goneAt === null || session.letGo && !session.atGoal()) {
      tell("that was no whole lesson: hold on until it rests");
    } else if (this.lessons.length >= MOST_KEPT) tell("there are enough lessons: keep them, or delete some");
    else {
      this.count++;
      this.unsaved = true;
      this.lessons.push({ role: this.role, n: this.count, take, from: 0, to: take.position.length, name: `${this.role}-${this.lessons.filter(one => one.role === this.role).length + 1}` });
      if (this.lessons.filter(one => one.role === this.role).length === LESSONS) { this.page.sound.arrived(); tell(`five lessons as ${this.role}: now it can learn from them`); }
    }
    this.refresh();
    this.page.goesBack(this.page.hands.kind === "pointer" ? 700 : 500);
  }

  // A lesson that somebody opens again: what a file says is text.
  open(name, bytes) {
    const recording = /\.mcap$/i.test(name) ? readMcap(bytes) : readCsv(new TextDecoder().decode(bytes)), { role, ...lesson } = lessonOf(recording, this.page.config.task);
    if (lesson.take.position.length * lesson.take.dt < SHORTEST_S) throw new Error(`it lasts less than ${SHORTEST_S} s: no whole lesson`);
    if (this.lessons.length >= MOST_KEPT) throw new Error("there are enough lessons: keep them, or delete some");
    this.lessons.push({ ...lesson, role: role || this.role, n: ++this.count, from: 0, to: lesson.take.position.length, name: name.replace(/\.(csv|mcap)$/i, "").slice(0, 60) });
    this.role = role || this.role;
    this.refresh();
  }

  // The part that counts, as a recording: of what was taught here, or of what the opened file held
  kept(lesson) {
    const { take, from, to } = lesson, n = take.position.length;
    if (lesson.recording) return from === 0 && to === n ? lesson.recording : within(lesson.recording, lesson.time[from], lesson.time[to - 1]);
    const cut = Object.fromEntries(Object.entries(take).map(([key, value]) => [key, Array.isArray(value) && value.length === n ? value.slice(from, to) : value]));
    return recordingOf(this.page.config.task, cut, { name: lesson.name, role: lesson.role, lesson: lesson.n, robot: lesson.role === "leader" ? "scripted: minimum jerk, gives way" : "scripted: mass-damper" });
  }

  // The robot learns from the lessons of the role that is chosen, and is lifted with.
  learn() {
    const { page, role } = this, { task } = page.config, of = this.lessons.filter(one => one.role === role);
    try {
      const text = learned(of.map(lesson => ({ ...preparedLesson(this.kept(lesson), task, lesson.name), role })), task);
      page.takeFile(`${role} taught here`, text);
      this.skill = { role, text };
      this.refresh();
      tell(`learned from ${of.length} lessons: it ${role === "leader" ? "leads" : "follows"} as you taught it`);
    } catch (error) { tell(error.message); }
  }

  // In one file: browsers lose some of many downloads in silence, Chromium from the eleventh on.
  keepAll(kind) {
    this.unsaved = false;
    const names = each(this.lessons.map(lesson => plain(lesson.name)));
    download(`comanip-lessons-${kind}.zip`, zipOf(this.lessons.map((lesson, n) => [`${names[n]}.${kind}`, this.bytes(lesson, kind)])), "application/zip");
  }

  bytes(lesson, kind) {
    const recording = this.kept(lesson);
    return kind === "csv" ? new TextEncoder().encode(csvOf(recording)) : mcapOf(recording, this.page.config.task.schemas);
  }

  refresh() {
    const counts = role => this.lessons.filter(one => one.role === role).length;
    for (const button of this.roles.querySelectorAll("[data-role]")) {
      const on = button.dataset.role === this.role;
      button.setAttribute("aria-checked", String(on));
      button.classList.toggle("main", on);
    }
    this.says.textContent = `leads ${counts("leader")} of ${LESSONS}, follows ${counts("follower")} of ${LESSONS}`;
    this.learns.disabled = counts(this.role) < LEAST_LESSONS;
    this.learns.classList.toggle("main", counts(this.role) >= LESSONS);
    this.keeps.hidden = !this.skill;
    this.asCsv.disabled = this.asMcap.disabled = !this.lessons.length;
    this.list.replaceChildren(...this.lessons.map(lesson => this.card(lesson)));
    this.draw();
  }

  card(lesson) {
    const box = element("div", "lesson"), row = element("div", "row"), trim = element("div", "trim");
    lesson.canvas = document.createElement("canvas");
    lesson.canvas.setAttribute("role", "img");
    lesson.canvas.setAttribute("aria-label", `lesson ${lesson.name}: height and force`);
    const name = element("b", "", lesson.name);
    const bound = (label, key, low) => {
      const one = document.createElement("input");
      one.type = "range";
      one.min = 0; one.max = lesson.take.position.length; one.value = lesson[key];
      one.setAttribute("aria-label", `${label} of ${lesson.name}`);
      one.addEventListener("input", () => {
        const value = Number(one.value), least = SHORTEST_S / lesson.take.dt;
        lesson[key] = low ? Math.min(value, lesson.to - least) : Math.max(value, lesson.from + least);
        one.value = lesson[key];
        this.draw();
      });
      return one;
    };
    trim.append(bound("Beginning", "from", true), bound("End", "to", false));
    row.append(name, this.button("↓", () => download(`${lesson.name}.csv`, this.bytes(lesson, "csv"), "text/csv")), this.button("▶", () => { this.replays = { lesson, from: performance.now() }; }), this.button("✕", () => { this.lessons = this.lessons.filter(one => one !== lesson); this.refresh(); }));
    ["Keep", "Replay", "Delete"].forEach((does, n) => row.children[n + 1].setAttribute("aria-label", `${does} ${lesson.name}`));
    box.append(row, lesson.canvas, trim);
    return box;
  }

  draw() {
    for (const lesson of this.lessons) {
      const fit = lesson.canvas && fitted(lesson.canvas);
      if (!fit) continue;
      const [g, w, h] = fit, take = lesson.take, n = take.position.length, axis = this.page.mainAxis();
      g.clearRect(0, 0, w, h);
      g.fillStyle = COLOURS.line;
      g.globalAlpha = 0.5;
      g.fillRect(0, 0, (lesson.from / n) * w, h);
      g.fillRect((lesson.to / n) * w, 0, w, h);
      g.globalAlpha = 1;
      curve(g, take.position.map(row => row[axis]), w, h, COLOURS.ink);
      curve(g, take.force.map(row => row[axis]), w, h, COLOURS.force, 8);
    }
  }

  // A replay draws over the scene; touching the handle ends it.
  frame(now) {
    if (!this.replays) return;
    const { lesson, from } = this.replays, n = lesson.from + Math.max(Math.floor((now - from) / 1000 / lesson.take.dt), 0), page = this.page;
    if (n >= lesson.to || page.session.phase === "runs") { this.replays = null; return; }
    const take = lesson.take, start = take.start, off = row => row.map((x, i) => x - start[i]);
    page.scene.draw({ robot: off(take.position[n]), person: off(take.end_position[n]), force: take.force[n], tilt: take.tilt[n][0], pullN: 0, mode: 0, now });
  }
}

function curve(g, values, w, h, colour, least = 0.05) {
  const low = Math.min(...values), high = Math.max(...values), half = Math.max((high - low) / 2, least / 2), middle = (low + high) / 2;
  g.strokeStyle = colour;
  g.lineWidth = 1.8;
  g.beginPath();
  values.forEach((y, n) => g.lineTo((n / (values.length - 1)) * w, h / 2 - ((y - middle) / half) * h * 0.42));
  g.stroke();
}

export function element(kind, className = "", text = "") {
  const one = document.createElement(kind);
  if (className) one.className = className;
  if (text) one.textContent = text;
  return one;
}
