// A hidden Markov model learned on the page, for its figures: Baum-Welch over several lessons, left to right, full covariances; and
// the two regressions of eqs. (5) and (6). Small and plain; what robots run is learned by comanip's kernels.

export function inverse(matrix) {
  const n = matrix.length, a = matrix.map((row, i) => [...row, ...row.map((_, j) => (i === j ? 1 : 0))]);
  let logDet = 0;
  for (let i = 0; i < n; i++) {
    let best = i;
    for (let r = i + 1; r < n; r++) if (Math.abs(a[r][i]) > Math.abs(a[best][i])) best = r;
    [a[i], a[best]] = [a[best], a[i]];
    const pivot = a[i][i];
    logDet += Math.log(Math.abs(pivot));
    for (let j = 0; j < 2 * n; j++) a[i][j] /= pivot;
    for (let r = 0; r < n; r++) if (r !== i) { const by = a[r][i]; for (let j = 0; j < 2 * n; j++) a[r][j] -= by * a[i][j]; }
  }
  return [a.map(row => row.slice(n)), logDet];
}

function part(model, dims, noise = []) {
  return model.means.map((mean, k) => {
    const covariance = dims.map((i, a) => dims.map((j, b) => model.covariances[k][i][j] + (a === b ? noise[a] ?? 0 : 0)));
    const [precision, logDet] = inverse(covariance);
    return { mean: dims.map(i => mean[i]), precision, peak: -0.5 * (logDet + dims.length * Math.log(2 * Math.PI)) };
  });
}

function logDensity({ mean, precision, peak }, x) {
  let q = 0;
  for (let i = 0; i < mean.length; i++) for (let j = 0; j < mean.length; j++) q += (x[i] - mean[i]) * precision[i][j] * (x[j] - mean[j]);
  return peak - 0.5 * q;
}

// lessons: [[(D,)]]; gives {initial, transition, means, covariances} of K states
export function learnHmm(lessons, K, { iterations = 12, floor = 1e-4 } = {}) {
  const D = lessons[0][0].length, all = lessons.flat(), mean = all[0].map((_, d) => all.reduce((s, x) => s + x[d], 0) / all.length);
  const variance = mean.map((m, d) => all.reduce((s, x) => s + (x[d] - m) ** 2, 0) / all.length), least = variance.map(v => Math.max(v * floor, 1e-10));
  let gamma = lessons.map(lesson => lesson.map((_, t) => Array.from({ length: K }, (_, k) => (Math.min(Math.floor((t / lesson.length) * K), K - 1) === k ? 1 : 0))));
  let model = null;
  for (let round = 0; round <= iterations; round++) {
    const weight = new Array(K).fill(1e-9), means = Array.from({ length: K }, () => new Array(D).fill(0)), covariances = [], moves = new Array(K).fill(0), stays = new Array(K).fill(0);
    lessons.forEach((lesson, n) => lesson.forEach((x, t) => { for (let k = 0; k < K; k++) { const g = gamma[n][t][k]; weight[k] += g; for (let d = 0; d < D; d++) means[k][d] += g * x[d]; } }));
    for (let k = 0; k < K; k++) for (let d = 0; d < D; d++) means[k][d] /= weight[k];
    for (let k = 0; k < K; k++) covariances.push(Array.from({ length: D }, (_, i) => Array.from({ length: D }, (_, j) => (i === j ? least[i] : 0))));
    lessons.forEach((lesson, n) => lesson.forEach((x, t) => { for (let k = 0; k < K; k++) { const g = gamma[n][t][k] / weight[k]; if (g > 1e-9) for (let i = 0; i < D; i++) for (let j = 0; j < D; j++) covariances[k][i][j] += g * (x[i] - means[k][i]) * (x[j] - means[k][j]); } }));
    for (let k = 0; k < K; k++) { moves[k] = lessons.length; stays[k] = Math.max(weight[k] - lessons.length, 1); }
    const transition = Array.from({ length: K }, (_, i) => Array.from({ length: K }, (_, j) => (i === K - 1 ? (j === i ? 1 : 0) : j === i ? stays[i] / (stays[i] + moves[i]) : j === i + 1 ? moves[i] / (stays[i] + moves[i]) : 0)));
    model = { initial: Array.from({ length: K }, (_, k) => (k === 0 ? 1 : 0)), transition, means, covariances };
    if (round === iterations) break;
    const densities = part(model, mean.map((_, d) => d));
    gamma = lessons.map(lesson => posterior(model, lesson.map(x => densities.map(one => logDensity(one, x)))));
  }
  return model;
}

function posterior(model, logs) {
  const K = model.means.length, T = logs.length, b = logs.map(row => { const top = Math.max(...row); return row.map(l => Math.exp(Math.max(l - top, -200)) + 1e-290); });
  const alpha = [], scale = [];
  for (let t = 0; t < T; t++) {
    const row = new Array(K).fill(0);
    for (let j = 0; j < K; j++) {
      let sum = t === 0 ? model.initial[j] + 1e-12 : 1e-300;
      if (t > 0) for (let i = Math.max(j - 1, 0); i <= j; i++) sum += alpha[t - 1][i] * model.transition[i][j];
      row[j] = sum * b[t][j];
    }
    const total = row.reduce((s, x) => s + x, 0);
    scale.push(total);
    alpha.push(row.map(x => x / total));
  }
  let beta = new Array(K).fill(1);
  const out = new Array(T);
  for (let t = T - 1; t >= 0; t--) {
    const row = alpha[t].map((a, k) => a * beta[k]), total = row.reduce((s, x) => s + x, 0);
    out[t] = row.map(x => x / total);
    const next = beta.map((x, j) => x * b[t][j]);
    if (t > 0) beta = Array.from({ length: K }, (_, i) => { let sum = 0; for (let j = i; j < Math.min(i + 2, K); j++) sum += model.transition[i][j] * next[j]; return sum / scale[t]; });
  }
  return out;
}

// Eq. (4) from the channels `dims`, with a floor under every transition and a gate, as models/filtering.py has them.
export class Filter {
  constructor(model, dims, noise = []) {
    this.model = model;
    this.parts = part(model, dims, noise);
    this.weights = model.initial.slice();
    this.fresh = true;
  }

  step(x) {
    const K = this.weights.length, { transition } = this.model;
    let predicted = this.weights;
    if (!this.fresh) {
      predicted = new Array(K).fill(0);
      for (let i = 0; i < K; i++) for (let j = 0; j < K; j++) predicted[j] += this.weights[i] * transition[i][j];
    }
    this.fresh = false;
    predicted = predicted.map(p => p * (1 - 1e-6) + 1e-6 / K);
    const logs = this.parts.map(one => logDensity(one, x)), top = Math.max(...logs), h = logs.map((l, k) => predicted[k] * Math.exp(Math.max(l - top, -20))), total = h.reduce((s, p) => s + p, 0);
    this.weights = h.map(p => p / total);
    return this.weights;
  }

  // Squared distance to the closest state, in deviations: 0 within, 1 from three deviations on
  stray(x) {
    let closest = Infinity;
    for (const one of this.parts) closest = Math.min(closest, -2 * (logDensity(one, x) - one.peak));
    return Math.min(closest / 9, 1);
  }
}

// sum_i h_i [mu_o + S_oi (S_ii + noise)^-1 (x - mu_i)]: a hand that runs free is not where the lessons were, and a line goes on
export function regression(model, inputs, outputs, noise = []) {
  const lines = model.means.map((mean, k) => {
    const [precision] = inverse(inputs.map((i, a) => inputs.map((j, b) => model.covariances[k][i][j] + (a === b ? noise[a] ?? 0 : 0))));
    const gains = outputs.map(o => inputs.map((_, j) => inputs.reduce((s, i, n) => s + model.covariances[k][o][i] * precision[n][j], 0)));
    return { gains, offset: outputs.map((o, n) => mean[o] - gains[n].reduce((s, g, j) => s + g * mean[inputs[j]], 0)) };
  });
  return (weights, x) => outputs.map((_, o) => lines.reduce((sum, line, k) => sum + weights[k] * (line.offset[o] + line.gains[o].reduce((s, g, j) => s + g * x[j], 0)), 0));
}
