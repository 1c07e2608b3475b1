// What runs along: position, velocity and force with what the model expects and its band; states; who leads.

import { COLOURS, fitted } from "./scene.js";

const SHOWN_S = 9, WRITTEN = 0.2; // a smaller share has no room for a word

export class Strips {
  constructor(canvas) {
    this.canvas = canvas;
    this.clear();
  }

  clear() { this.rows = []; }

  // row: {t, x, v, f, ex, sx, ev, sv, ef, sf}: measured, expected and one deviation; NaN where the model says nothing
  add(row) {
    this.rows.push(row);
    if (this.rows.length > 4000) this.rows.splice(0, 1000);
  }

  draw(labels) {
    const fit = fitted(this.canvas);
    if (!fit) return;
    const [g, w, h] = fit, now = this.rows.length ? this.rows[this.rows.length - 1].t : 0, from = Math.max(now - SHOWN_S, 0);
    const seen = this.rows.filter(row => row.t >= from), tall = h / 3, left = 84;
    g.clearRect(0, 0, w, h);
    [["x", "ex", "sx", 0.05], ["v", "ev", "sv", 0.12], ["f", "ef", "sf", 4]].forEach(([name, expected, spread, least], n) => {
      const values = seen.flatMap(row => [row[name], row[expected] + row[spread], row[expected] - row[spread]].filter(Number.isFinite));
      let low = Math.min(...values, name === "x" ? Infinity : -least), high = Math.max(...values, name === "x" ? -Infinity : least);
      if (!(high > low)) { low = -least; high = least; }
      const middle = (low + high) / 2, half = Math.max((high - low) / 2, least) * 1.12;
      const X = t => left + ((t - from) / SHOWN_S) * (w - left - 8), Y = y => tall * (n + 0.5) - ((y - middle) / half) * tall * 0.4;
      g.strokeStyle = COLOURS.line;
      g.lineWidth = 1;
      g.beginPath(); g.moveTo(left, tall * (n + 0.95)); g.lineTo(w - 8, tall * (n + 0.95)); g.stroke();
      g.fillStyle = COLOURS.band;
      g.globalAlpha = 0.16;
      band(g, seen, X, Y, expected, spread, 2);
      g.globalAlpha = 0.26;
      band(g, seen, X, Y, expected, spread, 1);
      g.globalAlpha = 1;
      line(g, seen, X, Y, expected, COLOURS.band, 1.4, [5, 4]);
      line(g, seen, X, Y, name, name === "f" ? COLOURS.force : COLOURS.ink, 2.2, []);
      g.fillStyle = COLOURS.soft;
      g.font = "12px system-ui, sans-serif";
      g.textAlign = "left";
      g.fillText(labels[n][0], 2, tall * (n + 0.42));
      g.fillStyle = COLOURS.ink;
      g.font = "600 14px system-ui, sans-serif";
      const last = seen.length ? seen[seen.length - 1][name] : NaN;
      g.fillText(Number.isFinite(last) ? `${last.toFixed(labels[n][2]).replace(/^-(?=0\.?0*$)/, "")} ${labels[n][1]}` : "–", 2, tall * (n + 0.42) + 18);
    });
  }
}

function band(g, rows, X, Y, expected, spread, times) {
  let part = [];
  const fill = () => {
    if (part.length > 1) {
      g.beginPath();
      part.forEach((row, n) => (n ? g.lineTo(X(row.t), Y(row[expected] + times * row[spread])) : g.moveTo(X(row.t), Y(row[expected] + times * row[spread]))));
      for (const row of part.slice().reverse()) g.lineTo(X(row.t), Y(row[expected] - times * row[spread]));
      g.fill();
    }
    part = [];
  };
  for (const row of rows) Number.isFinite(row[expected]) ? part.push(row) : fill();
  fill();
}

function line(g, rows, X, Y, name, colour, width, dash) {
  g.strokeStyle = colour;
  g.lineWidth = width;
  g.lineJoin = "round";
  g.setLineDash(dash);
  g.beginPath();
  let down = false;
  for (const row of rows) {
    if (!Number.isFinite(row[name])) { down = false; continue; }
    down ? g.lineTo(X(row.t), Y(row[name])) : g.moveTo(X(row.t), Y(row[name]));
    down = true;
  }
  g.stroke();
  g.setLineDash([]);
}

// Mean and deviation of each channel under the weights (K,) of a model {means, covariances}: what a mixture expects now.
export function expectation(model, weights) {
  const D = model.means[0].length, mean = new Array(D).fill(0), second = new Array(D).fill(0);
  for (let k = 0; k < weights.length; k++)
    for (let c = 0; c < D; c++) {
      mean[c] += weights[k] * model.means[k][c];
      second[c] += weights[k] * (model.covariances[k][c][c] + model.means[k][c] ** 2);
    }
  return mean.map((m, c) => [m, Math.sqrt(Math.max(second[c] - m * m, 0))]);
}

// A strip of bars that are moved, not made anew, at each frame.
export class Bars {
  constructor(element) { this.element = element; }

  show(values) {
    const box = this.element;
    while (box.children.length < values.length) box.append(document.createElement("i"));
    while (box.children.length > values.length) box.lastChild.remove();
    values.forEach((value, n) => { box.children[n].style.height = `${Math.max(value * 100, 6)}%`; box.children[n].style.opacity = 0.25 + 0.75 * value; });
  }
}

export class Shares {
  constructor(element, kinds) {
    this.element = element;
    element.replaceChildren(...kinds.map(([kind, label]) => Object.assign(document.createElement("span"), { className: kind, textContent: label })));
  }

  show(values) {
    values.forEach((value, n) => { const part = this.element.children[n]; if (part) { part.style.flex = `${Math.max(value, 0.001)} 1 0`; part.style.fontSize = value > WRITTEN ? "" : "0"; } });
  }
}
