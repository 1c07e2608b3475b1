// A study on the page: laws in a blind, counterbalanced order from a seed; practice, trials, two questions after each, one file at
// the end. Nothing is sent anywhere; whoever takes part may stop at any time and keep what there is, or nothing.

import { download, numbersOf, plain, tell } from "./files.js";
import { mcapOf, zipOf } from "./mcap.js";
import { recordingOf } from "./recordings.js";
import { KEPT } from "./session.js";
import { element } from "./teach.js";

const STUDY_VERSION = 1;
const QUESTIONS = [["ease", "How easy was it?", "hard", "easy"], ["predictability", "How well could you tell what the robot would do next?", "not at all", "very well"]];
const ASKS = {
  follower: "Lift the beam to the dashed place, and rest there.",
  leader: "Take the handle and go along with the robot, until it rests.",
  auto: "Lift the beam to the dashed place; or go along, if the robot sets out. Rest there.",
};

// The order of `count` things for a number: `count` numbers in a row (from a multiple on) put everything once in every place, and
// count! numbers in a row run through all orders there are.
export function orderOf(seed, count) {
  let all = 1;
  for (let n = 2; n < count; n++) all *= n;
  const turns = ((seed % count) + count) % count, left = Array.from({ length: count - 1 }, (_, n) => n + 1), order = [0];
  let index = ((Math.floor(seed / count) % all) + all) % all;
  for (let n = count - 1; n > 0; n--) {
    all /= n;
    order.push(...left.splice(Math.floor(index / all), 1));
    index %= all;
  }
  return order.map((_, n) => order[(n + turns) % count]);
}

export class Study {
  constructor(page, box) {
    this.page = page;
    this.box = box;
    this.plan = page.config.study;
    this.stage = "form";
    this.records = [];
  }

  enter() { this.show(); this.next(); }

  show() {
    const panel = element("div", "panel");
    ({ form: () => this.form(panel), practice: () => this.practice(panel), trials: () => this.trials(panel), questions: () => this.questions(panel), preference: () => this.preference(panel), end: () => this.end(panel) })[this.stage]();
    if (!["form", "end"].includes(this.stage)) {
      const stop = element("button", "button", "Stop here");
      stop.style.marginTop = ".6rem";
      stop.addEventListener("click", () => this.close("broken off"));
      panel.append(stop);
    }
    this.box.replaceChildren(panel);
  }

  form(panel) {
    panel.append(element("h2", "", "A study of how robots carry"), element("p", "", this.plan.consent));
    const row = element("div", "row");
    const who = field("Your code (not your name)", "text", this.proposed?.[0] ?? "p1"), seed = field("Number of the order", "number", String(this.proposed?.[1] ?? new URLSearchParams(location.hash.slice(1)).get("seed") ?? Math.floor(Math.random() * 1e6)));
    row.append(who, seed);
    const agree = element("label", "row"), box = document.createElement("input");
    box.type = "checkbox";
    agree.append(box, element("span", "", "I am of age, have read this, and take part of my own will."));
    const begin = element("button", "button main", "Begin");
    begin.disabled = true;
    box.addEventListener("change", () => { begin.disabled = !box.checked; });
    begin.addEventListener("click", () => this.begin(who.querySelector("input").value.slice(0, 60), Math.abs(Math.floor(Number(seed.querySelector("input").value))) || 0));
    panel.append(row, agree, begin);
  }

  begin(participant, seed) {
    const plan = this.plan, order = orderOf(seed, plan.conditions.length);
    this.seed = seed;
    this.order = order.map(n => plan.conditions[n]);
    this.block = 0;
    this.trial = 0;
    this.practised = 0;
    this.takes = [];
    this.records = [{
      type: "study", version: STUDY_VERSION, participant, seed, order: this.order.map(one => one.name), conditions: plan.conditions.map(one => one.name), trials: plan.trials, practice: plan.practice,
      role: plan.role, roles: plan.conditions.map(one => this.roleOf(one)), skills: plan.conditions.map(one => this.skillsOf(one)), task: this.page.config.task.name, load_mass_kg: this.page.config.task.mass_kg, load_share: this.page.config.task.share, gravity_m_per_s2: this.page.config.task.gravity,
      axes: this.page.config.task.axes.map(axis => axis.name), consent: true, started: new Date().toISOString(), made_by: "comanip page: a person at a pointer, exact beam",
    }];
    this.unsaved = true;
    this.stage = plan.practice > 0 ? "practice" : "trials";
    this.show();
    this.next();
  }

  // What the next lift is: trial n asks the same of every condition, so that trials are pairs.
  next() {
    if (!["practice", "trials"].includes(this.stage)) { this.page.session.prepare({ ...this.page.lift(this.plan.role, { kind: "holds" }, 1), robot: { kind: "holds" } }); return; }
    const practice = this.stage === "practice", condition = practice ? { role: "follower", robot: this.plan.practises } : this.order[this.block], role = this.roleOf(condition);
    const setup = this.page.lift(role, this.robotOf(condition), practice ? 9000 + this.practised : 100 * (this.seed % 1000) + this.trial + 1);
    this.page.session.prepare(condition.ends ? { ...setup, ends: condition.ends } : setup);
    document.getElementById("verdict").hidden = true;
  }

  roleOf(condition) { return condition.role ?? this.plan.role; }

  // A condition's own skill, or the page's
  robotOf(condition) {
    if (condition.robot.kind !== "skill") return condition.robot;
    if (typeof condition.robot.numbers === "string") condition.robot.numbers = numbersOf(condition.robot.numbers);
    return { kind: "skill", numbers: condition.robot.numbers ?? this.page.numbers[this.plan.role] };
  }

  // Which skills these are: text, of the robots that have one
  skillsOf(condition) { return condition.sha256 ?? (condition.robot.kind === "skill" ? [this.page.skills[this.plan.role].sha256] : []); }

  ended(session) {
    if (this.stage === "practice") {
      if (++this.practised >= this.plan.practice) this.stage = "trials";
    } else if (this.stage === "trials") {
      this.records.push(this.record(session));
      if (++this.trial >= this.plan.trials) this.stage = "questions";
    }
    this.show();
    this.page.goesBack(this.page.hands.kind === "pointer" ? 500 : 300);
  }

  record(session) {
    this.takes.push(session.take);
    const take = session.take, digits = x => Number(x.toPrecision(7));
    return {
      type: "trial", block: this.block + 1, condition: this.order[this.block].name, trial: this.trial + 1, seed: session.setup.seed, goal_m: session.setup.goal, start_m: take.start, dt_s: take.dt,
      input: this.page.hands.kind || "pointer", verdict: session.verdict, channels: Object.fromEntries(KEPT.map(name => [name, take[name].map(row => row.map(digits))])), mode: take.mode,
    };
  }

  practice(panel) { panel.append(element("h2", "", `Practice ${this.practised + 1} of ${this.plan.practice}`), element("p", "soft", "Take the handle and lift the beam to the dashed place. This does not count.")); }
  trials(panel) {
    panel.append(element("h2", "", `Robot ${this.block + 1} of ${this.order.length}, lift ${this.trial + 1} of ${this.plan.trials}`), element("p", "soft", ASKS[this.roleOf(this.order[this.block])]));
  }

  questions(panel) {
    panel.append(element("h2", "", `About robot ${this.block + 1}`));
    const answers = {};
    const on = element("button", "button main", "Go on");
    on.disabled = true;
    for (const [name, text, low, high] of QUESTIONS) {
      panel.append(scale(name, text, low, high, value => { answers[name] = value; on.disabled = QUESTIONS.some(([one]) => !answers[one]); }));
    }
    on.addEventListener("click", () => {
      this.records.push({ type: "answers", block: this.block + 1, condition: this.order[this.block].name, ...answers });
      this.block++;
      this.trial = 0;
      this.stage = this.block >= this.order.length ? "preference" : "trials";
      this.show();
      this.next();
    });
    panel.append(on);
  }

  preference(panel) {
    panel.append(element("h2", "", "Which robot would you carry with again?"));
    const row = element("div", "row");
    this.order.forEach((condition, n) => {
      const one = element("button", "button", `Robot ${n + 1}`);
      one.addEventListener("click", () => { this.records.push({ type: "preference", block: n + 1, condition: condition.name, comment: said.querySelector("textarea").value.slice(0, 2000) }); this.close("complete"); });
      row.append(one);
    });
    const said = element("label", "field", "Anything to say? (not needed)");
    said.append(document.createElement("textarea"));
    panel.append(said, row);
  }

  close(reason) {
    this.records.push({ type: "end", reason, ended: new Date().toISOString() });
    this.stage = "end";
    this.page.hands.release();
    this.show();
    this.next();
  }

  // The next number in the row, so that orders stay balanced; what nobody has kept is asked for once more.
  another() {
    if (this.unsaved) { this.unsaved = false; tell("keep the file first; once more, and it is gone"); return; }
    this.proposed = [String(this.records[0].participant).replace(/\d*$/, digits => String(Number(digits || 1) + 1)), this.seed + 1];
    this.stage = "form";
    this.records = [];
    this.show();
  }

  file() { return this.records.map(record => JSON.stringify(record)).join("\n") + "\n"; }

  // The same lines, and every trial as MCAP beside them
  bundle() {
    const trials = this.records.filter(record => record.type === "trial"), { task } = this.page.config, [{ participant, seed }] = this.records;
    const files = trials.map(({ condition, trial, block, verdict, input }, n) => [`${plain(condition)}-${trial}.mcap`, mcapOf(recordingOf(task, this.takes[n], { participant, order: seed, condition, trial, block, verdict, input }), task.schemas)]);
    return zipOf([["study.jsonl", new TextEncoder().encode(this.file())], ...files]);
  }

  end(panel) {
    const complete = this.records[this.records.length - 1].reason === "complete";
    panel.append(element("h2", "", complete ? "Thank you." : "Stopped."), element("p", "", "Nothing has left this page. Keep the file and give it to whoever asked you, or close the page, and it is gone."));
    const row = element("div", "row"), keep = element("button", "button main", "Keep the file"), all = element("button", "button", "Keep it with every lift as MCAP (ZIP)"), again = element("button", "button", "Another person");
    const named = `comanip-study-${this.records[0].participant || "p"}-${this.seed}`;
    keep.addEventListener("click", () => { this.unsaved = false; download(`${named}.jsonl`, this.file(), "application/x-ndjson"); });
    all.addEventListener("click", () => { this.unsaved = false; download(`${named}.zip`, this.bundle(), "application/zip"); });
    again.addEventListener("click", () => this.another());
    row.append(keep, all, again);
    if (complete) panel.append(element("p", "soft", `The order was: ${this.order.map(one => one.name).join(", ")}.`));
    panel.append(row);
  }
}

function field(label, type, value) {
  const one = element("label", "field", label), input = document.createElement("input");
  input.type = type;
  input.value = value;
  one.append(input);
  return one;
}

function scale(name, text, low, high, chosen) {
  const set = document.createElement("fieldset"), legend = document.createElement("legend"), steps = element("div", "steps");
  legend.textContent = text;
  steps.append(element("span", "soft", low));
  for (let n = 1; n <= 7; n++) {
    const label = element("label", "", String(n)), input = document.createElement("input");
    input.type = "radio";
    input.name = name;
    input.value = String(n);
    input.setAttribute("aria-label", `${n} of 7, from ${low} to ${high}`);
    input.addEventListener("change", () => chosen(n));
    label.prepend(input);
    steps.append(label);
  }
  steps.append(element("span", "soft", high));
  set.append(legend, steps);
  return set;
}
