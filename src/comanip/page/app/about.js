// What the page is, what runs in it, and what it is not.

import { element } from "./teach.js";

export function about(box, config) {
  const panel = element("div", "panel");
  panel.append(element("h2", "", "What this is"));
  for (const text of config.about) panel.append(element("p", "", text));
  const list = document.createElement("dl");
  for (const [word, meaning] of [
    ["Take hold", "press the handle with mouse or finger and drag; or Space, then arrow keys; or any button of a gamepad, then its left stick"],
    ["Let go", "release; Space; any button. The robot notices, and holds the beam"],
    ["Go on after a HOLD", "the red button, or R"],
    ["Teach it", "five lessons a role under Teach, then Learn from these"],
    ["Skill files", "drop leader.json or follower.json anywhere on the page, or open it with the folder above"],
  ]) list.append(Object.assign(element("dt", "", word), { style: "font-weight:600" }), element("dd", "soft", meaning));
  panel.append(list);
  for (const [role, skill] of Object.entries(config.skills)) {
    const lessons = (skill.provenance?.lessons ?? []).length, text = `${role}: ${skill.model.means.length} states over ${skill.model.channels.join(", ")}; ${lessons ? `${lessons} lessons; ` : ""}law ${skill.law}; sha256 ${String(skill.sha256).slice(0, 12)}…`;
    panel.append(element("p", "soft", text));
  }
  box.replaceChildren(panel);
}
