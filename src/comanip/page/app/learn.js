// A skill of the lessons that were taught here: what `comanip learn` makes of the same files, by the same steps in the same order.
// lessons/demonstration.py: eq. (3); fitting/hmm.py: Baum-Welch; models/taught_path.py: the way that lessons share. A test compares.

import { repr, sha256 } from "./files.js";
import { lengthOf, smooth } from "./judge.js";
import { gradient, interp, minus } from "./prepare.js";
import { quoted } from "./skillfile.js";

const WHOLE = new Set(["version", "frames", "n_frames"]); // numbers that are no floats in a skill file
const PERIOD_S = 0.01, FORCE_CUTOFF_HZ = 10, STATES = 10, FLOOR = 1e-4, ITERATIONS = 200, TOLERANCE = 1e-5, UNVISITED = 0.1, NOTHING = 1e-18, AROUND = 0.5, WARNED_N = 1.5;
const MOVING_SHARE = 0.03, LEFT_SHARE = 0.03, POINTS_PER_S = 100, MOST_ROWS = 200, ROW_S = 0.02, CUTOFFS_HZ = [1.5, 2, 3, 4, 6, 8, 10], KEPT_SHARE = 0.004, OFF_DIAGONAL = 0.002, ELSEWHERE = 0.25, APART = 3, STRAY = 4;

const range = n => Array.from({ length: n }, (_, i) => i), sum = values => values.reduce((a, b) => a + b, 0), average = values => sum(values) / values.length;
const largest = values => values.reduce((a, b) => (b > a ? b : a), -Infinity), last = list => list[list.length - 1];
const columnsOf = rows => rows[0].map((_, n) => rows.map(row => row[n])), linspace = (a, b, n) => range(n).map(i => a + (i * (b - a)) / (n - 1));
const smoothed = (rows, dt, cutoff) => columnsOf(columnsOf(rows).map(column => smooth(column, dt, cutoff)));
const meanRow = rows => rows[0].map((_, n) => average(rows.map(row => row[n])));
const meanTable = tables => tables[0].map((row, t) => row.map((_, n) => average(tables.map(table => table[t][n]))));
const median = values => { const s = values.slice().sort((a, b) => a - b), n = s.length; return (s[(n - 1) >> 1] + s[n >> 1]) / 2; };
// Python's round: halves to the even
const rounded = x => { const low = Math.floor(x); return x - low === 0.5 ? low + (low % 2 ? 1 : 0) : Math.round(x); };

// numpy.gradient with edge_order 2: second order at the ends, too
function gradientToTheEnds(rows, h) {
  const n = rows.length - 1, found = gradient(rows, h), of = f => rows[0].map((_, i) => f(t => rows[t][i]));
  found[0] = of(y => (-1.5 * y(0) + 2 * y(1) - 0.5 * y(2)) / h);
  found[n] = of(y => (1.5 * y(n) - 2 * y(n - 1) + 0.5 * y(n - 2)) / h);
  return found;
}

// A recording as the page keeps it -> {name, role, dt, position, force, velocity}: F from eq. (3), off line.
export function preparedLesson(recording, task, name) {
  const axes = task.axes.map(axis => axis.name).join(), named = key => recording.channels.find(one => one.name === `hand.${key}` && one.axes.join() === axes), about = recording.metadata;
  const fail = what => { throw new Error(`${name}: ${what}: comanip learn prepares such files`); };
  const [place, speed, sensed] = ["position", "velocity", "sensor_force"].map(key => named(key) ?? fail(`no hand.${key} along ${axes}`)), { time } = place, n = time.length, dt = rounded(((time[n - 1] - time[0]) / (n - 1)) * 1e6) / 1e6;
  if (named("force")) fail("its force is the interaction's already");
  if (n < 20 || [speed, sensed].some(one => one.rows.length !== n || one.time.some((t, i) => Math.abs(t - time[i]) > 1e-6)) || time.some((t, i) => Math.abs(t - time[0] - i * dt) > 1e-6)) fail("its channels are not of one even rate");
  if (Math.abs(dt - PERIOD_S) > 1e-6) fail(`it has ${Math.round(1 / dt)} frames a second, and the page takes ${1 / PERIOD_S}`);
  const { load_mass_kg: mass = task.mass_kg, load_share: share = task.share, gravity_m_per_s2: gravity = task.gravity } = about;
  const acceleration = smoothed(gradientToTheEnds(speed.rows, dt), dt, FORCE_CUTOFF_HZ), force = smoothed(sensed.rows, dt, FORCE_CUTOFF_HZ).map((row, t) => row.map((f, i) => f + share * mass * (acceleration[t][i] - gravity[i])));
  return { name, role: about.role, dt, position: place.rows, velocity: speed.rows, force };
}

// ------------------------------------------------------------------------------------------------ the model

function cholesky(S) {
  const n = S.length, L = S.map(row => row.map(() => 0));
  for (let i = 0; i < n; i++) for (let j = 0; j <= i; j++) {
    let rest = S[i][j];
    for (let k = 0; k < j; k++) rest -= L[i][k] * L[j][k];
    if (i === j) { if (!(rest > 0)) return null; L[i][i] = Math.sqrt(rest); } else L[i][j] = rest / L[j][j];
  }
  return L;
}

// Eigenvalues and vectors (columnsOf of V) of a symmetric matrix, by Jacobi's turns
function eigen(S) {
  const n = S.length, A = S.map(row => row.slice()), V = S.map((row, i) => row.map((_, j) => (i === j ? 1 : 0)));
  for (let sweep = 0; sweep < 60; sweep++) for (let p = 0; p < n; p++) for (let q = p + 1; q < n; q++) {
    if (Math.abs(A[p][q]) < 1e-300) continue;
    const theta = (A[q][q] - A[p][p]) / (2 * A[p][q]), t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1)), c = 1 / Math.sqrt(t * t + 1), s = t * c;
    for (let k = 0; k < n; k++) [A[k][p], A[k][q]] = [c * A[k][p] - s * A[k][q], s * A[k][p] + c * A[k][q]];
    for (let k = 0; k < n; k++) [A[p][k], A[q][k]] = [c * A[p][k] - s * A[q][k], s * A[p][k] + c * A[q][k]];
    for (let k = 0; k < n; k++) [V[k][p], V[k][q]] = [c * V[k][p] - s * V[k][q], s * V[k][p] + c * V[k][q]];
  }
  return [A.map((row, i) => row[i]), V];
}

// models.gaussian.floored: every eigenvalue at least FLOOR
function floored(S) {
  if (cholesky(S.map((row, i) => row.map((x, j) => (i === j ? x - FLOOR : x))))) return S;
  const [values, V] = eigen(S);
  return S.map((row, i) => row.map((_, j) => sum(values.map((value, k) => V[i][k] * Math.max(value, FLOOR) * V[j][k]))));
}

// Means and covariances of frames z under weights gamma[t][k]; a state without weight keeps what it had
function gaussians(z, gamma, K, before) {
  const D = z[0].length, weight = new Array(K).fill(0), sums = range(K).map(() => new Array(D).fill(0));
  const each = does => { for (let t = 0; t < z.length; t++) { const x = z[t], row = gamma[t]; for (let k = 0; k < K; k++) if (row[k] > NOTHING) does(row[k], x, k); } };
  each((g, x, k) => { weight[k] += g; for (let d = 0; d < D; d++) sums[k][d] += g * x[d]; });
  const seen = weight.map(w => w > 1e-10), means = sums.map((row, k) => (seen[k] ? row.map(x => x / weight[k]) : before.means[k])), products = range(K).map(() => range(D).map(() => new Array(D).fill(0)));
  const off = new Float64Array(D);
  each((g, x, k) => {
    const S = products[k], m = means[k];
    for (let i = 0; i < D; i++) { off[i] = x[i] - m[i]; const row = S[i], by = g * off[i]; for (let j = 0; j <= i; j++) row[j] += by * off[j]; }
  });
  const covariances = products.map((S, k) => (seen[k] ? floored(S.map((row, i) => row.map((_, j) => (j <= i ? row[j] : S[j][i]) / weight[k]))) : before.covariances[k]));
  return { means, covariances };
}

function logDensities(model, z) {
  const D = z[0].length, parts = model.covariances.map(S => { const L = cholesky(S); return [L, -0.5 * D * Math.log(2 * Math.PI) - sum(L.map((row, i) => Math.log(row[i])))]; });
  const y = new Float64Array(D);
  return z.map(x => parts.map(([L, peak], k) => {
    const m = model.means[k];
    let far = 0;
    for (let i = 0; i < D; i++) { const row = L[i]; let rest = x[i] - m[i]; for (let j = 0; j < i; j++) rest -= row[j] * y[j]; y[i] = rest / row[i]; far += y[i] * y[i]; }
    return peak - 0.5 * far;
  }));
}

const logSum = (a, b) => (a > b ? a + Math.log1p(Math.exp(b - a)) : b === -Infinity ? b : b + Math.log1p(Math.exp(a - b)));

// One lesson's log-likelihood, gamma (T, K), and how often states stay and go on: left to right, each stays or goes to the next
function expected(model, logs, counts) {
  const K = model.means.length, T = logs.length, stay = range(K).map(k => Math.log(model.transition[k][k])), on = range(K).map(k => (k < K - 1 ? Math.log(model.transition[k][k + 1]) : -Infinity));
  const alpha = [logs[0].map((b, k) => Math.log(model.initial[k]) + b)], gamma = new Array(T);
  for (let t = 1; t < T; t++) { const was = alpha[t - 1]; alpha.push(logs[t].map((b, k) => b + logSum(was[k] + stay[k], k ? was[k - 1] + on[k - 1] : -Infinity))); }
  const total = last(alpha).reduce(logSum, -Infinity), ahead = new Array(K);
  let beta = new Array(K).fill(0);
  gamma[T - 1] = last(alpha).map(a => Math.exp(a - total));
  for (let t = T - 2; t >= 0; t--) {
    const now = alpha[t], row = new Array(K);
    for (let k = 0; k < K; k++) ahead[k] = logs[t + 1][k] + beta[k];
    beta = new Array(K);
    for (let k = 0; k < K; k++) {
      const stays = stay[k] + ahead[k], goes = k < K - 1 ? on[k] + ahead[k + 1] : -Infinity;
      counts[k][k] += Math.exp(now[k] + stays - total);
      if (k < K - 1) counts[k][k + 1] += Math.exp(now[k] + goes - total);
      beta[k] = logSum(stays, goes);
      row[k] = Math.exp(now[k] + beta[k] - total);
    }
    gamma[t] = row;
  }
  return [total, gamma];
}

// fitting.hmm.fit_hmm as `comanip learn` asks for it. lessons: [(T, D)]; channels: names
export function fittedHmm(lessons, channels, K = STATES) {
  const x = lessons.flat(), N = x.length, D = channels.length, group = name => name.slice(0, name.lastIndexOf(".")), offset = meanRow(x);
  const variance = offset.map((m, d) => average(x.map(row => (row[d] - m) ** 2))), still = channels.find((_, d) => { const column = x.map(row => row[d]); return largest(column) - -largest(column.map(v => -v)) <= 8 * 2.2e-16 * largest(column.map(Math.abs)); });
  if (still) throw new Error(`${still} is the same in all lessons`);
  if (lessons.some(lesson => lesson.length < K + 1)) throw new Error(`${K} states need lessons of ${K + 1} frames`);
  const scale = channels.map(name => Math.sqrt(average(variance.filter((_, d) => group(channels[d]) === group(name))))), z = x.map(row => row.map((v, d) => (v - offset[d]) / scale[d]));
  const parts = [];
  for (let at = 0, n = 0; n < lessons.length; at += lessons[n++].length) parts.push(z.slice(at, at + lessons[n].length));
  const labels = parts.map(part => part.map((_, t) => range(K - 1).filter(i => (i + 1) / K <= (t + 0.5) / part.length).length)), counts = range(K).map(() => new Array(K).fill(0));
  labels.forEach(list => list.slice(1).forEach((label, t) => { counts[list[t]][label] += 1; }));
  const transition = counts.map((row, i) => { const to = row.map((c, j) => (j === i || j === i + 1 ? c + 0.5 + (0.05 * sum(row)) / K : 0)); return to.map(p => p / sum(to)); });
  const everything = gaussians(z, z.map(() => [1]), 1, null), all = { means: range(K).map(() => everything.means[0]), covariances: range(K).map(() => everything.covariances[0]) };
  let model = { initial: range(K).map(k => (k ? 0 : 1)), transition, ...gaussians(z, labels.flat().map(label => range(K).map(k => (k === label ? 1 : 0))), K, all) };
  const trace = [];
  let converged = false, gamma = null;
  for (let iteration = 0; ; iteration++) {
    const seen = range(K).map(() => new Array(K).fill(0)), found = parts.map(part => expected(model, logDensities(model, part), seen));
    trace.push(sum(found.map(([one]) => one)));
    gamma = found.flatMap(([, weights]) => weights);
    if (iteration && trace[iteration] - trace[iteration - 1] < TOLERANCE * N) { converged = true; break; }
    if (iteration === ITERATIONS) break;
    const before = model.transition;
    model = { initial: model.initial, transition: seen.map((row, i) => { const total = sum(row); return total > 1e-10 ? row.map(c => c / total) : before[i]; }), ...gaussians(z, gamma, K, model) };
  }
  return finished(model, gamma, { offset, scale, channels, trace, converged, N, D });
}

// Back to the channels' units; states that no frame visits are left out
function finished(model, gamma, { offset, scale, channels, trace, converged, N, D }) {
  const order = model.means.map((_, k) => k).filter(k => sum(gamma.map(row => row[k])) >= UNVISITED), K = order.length, pick = list => order.map(k => list[k]);
  const transition = order.map(i => { const row = order.map(j => model.transition[i][j]), total = sum(row); return total > 0 ? row.map(p => p / total) : order.map(j => (j === i ? 1 : 0)); });
  const initial = pick(model.initial), volume = N * sum(scale.map(Math.log)), free = K - 1 + K * D + (K * D * (D + 1)) / 2, likelihood = trace.map(one => one - volume);
  return {
    initial: initial.map(p => p / sum(initial)), transition, means: pick(model.means).map(row => row.map((m, d) => offset[d] + scale[d] * m)), covariances: pick(model.covariances).map(S => S.map((row, i) => row.map((c, j) => c * scale[i] * scale[j]))),
    channels, likelihood, converged, bic: -2 * last(likelihood) + free * Math.log(N), frames: N,
  };
}

// ------------------------------------------------------------------------------------------------ the way that lessons share

const extentOf = rows => largest(rows.map(row => lengthOf(minus(row, rows[0]))));
const wayOf = rows => rows.slice(1).reduce((way, row, n) => [...way, last(way) + lengthOf(minus(row, rows[n]))], [0]);

const interpRows = (xs, at, rows) => { const of = columnsOf(rows); return xs.map(x => of.map(column => interp(x, at, column))); };
const atPlaces = (table, places) => places.map(place => { const n = Math.min(Math.max(Math.trunc(place), 0), table.length - 2), share = place - n; return table[n].map((x, i) => (1 - share) * x + share * table[n + 1][i]); });

function cutoffOf(positions, dt, extent) {
  const highest = 0.4 / dt;
  for (const cutoff of CUTOFFS_HZ) {
    if (cutoff >= highest) break;
    if (largest(positions.map(rows => { const even = smoothed(rows, dt, cutoff); return largest(rows.map((row, t) => lengthOf(minus(even[t], row)))); })) < KEPT_SHARE * extent) return cutoff;
  }
  return Math.min(last(CUTOFFS_HZ), highest);
}

function leaves(position, fast) {
  const away = position.map(row => lengthOf(minus(row, position[0]))), far = largest(away);
  let gone = away.findIndex(x => x > LEFT_SHARE * far);
  while (--gone >= 0) if (!fast[gone]) return gone;
  return 0;
}

function movingPart(rawPosition, rawForce, dt, cutoff) {
  const position = smoothed(rawPosition, dt, cutoff), force = smoothed(rawForce, dt, cutoff), speed = gradient(position, dt).map(lengthOf), top = largest(speed), fast = speed.map(v => v > MOVING_SHARE * top);
  const first = leaves(position, fast), end = position.length - 1 - leaves(position.slice().reverse(), fast.slice().reverse());
  if (end - first < 5) throw new Error("the lessons show no motion to learn");
  return { position: position.slice(first, end + 1), force: force.slice(first, end + 1), onset_s: first * dt };
}

// Indices of the lessons that go the same way to the same place, most lessons first: single linkage over Prim's tree
function goalsOf(paths, extent) {
  const n = paths.length, shares = paths.map(rows => { const way = wayOf(rows); return interpRows(linspace(0, last(way), 50), way, rows); });
  const apart = shares.map(a => shares.map(b => largest(a.map((row, t) => lengthOf(minus(row, b[t])))))), nearest = new Array(n).fill(0), best = apart[0].slice(), edges = [];
  best[0] = Infinity;
  for (let k = 1; k < n; k++) {
    const j = best.indexOf(Math.min(...best));
    edges.push([nearest[j], j, best[j]]);
    for (let i = 0; i < n; i++) if (Number.isFinite(best[i]) && apart[j][i] < best[i]) { best[i] = apart[j][i]; nearest[i] = j; }
    best[j] = Infinity;
  }
  const usual = edges.length ? median(edges.map(edge => edge[2])) : 0;
  let group = range(n);
  for (const [i, j, length] of edges) if (length <= Math.max(ELSEWHERE * extent, APART * usual)) { const gone = group[j], into = group[i]; group = group.map(g => (g === gone ? into : g)); }
  return [...new Set(group)].map(g => range(n).filter(i => group[i] === g)).sort((a, b) => b.length - a.length || a[0] - b[0]);
}

function shapeOf(path) {
  const velocity = gradient(path, 1), speed = velocity.map(lengthOf), top = largest(speed), extent = Math.max(extentOf(path), 1e-300);
  let gone = 0;
  const way = speed.map(v => (gone += v > MOVING_SHARE * top ? v : 0));
  return path.map((row, t) => [...minus(row, path[0]).map(x => x / extent), ...velocity[t].map(v => (0.5 * v) / Math.max(top, 1e-300)), way[t] / Math.max(gone, 1e-300)]);
}

// For a path the place (rows of it) that belongs to each row of the template, and how badly it fits
function warped(a, path) {
  const b = shapeOf(path), n = a.length, m = b.length, cost = a.map(x => b.map(y => x.reduce((far, v, i) => far + (v - y[i]) ** 2, 0))), total = a.map(() => new Float64Array(m)), came = a.map(() => new Uint8Array(m));
  for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) {
    const options = [i && j ? total[i - 1][j - 1] : Infinity, i ? total[i - 1][j] + OFF_DIAGONAL : Infinity, j ? total[i][j - 1] + OFF_DIAGONAL : Infinity], least = Math.min(...options);
    came[i][j] = options.indexOf(least);
    total[i][j] = cost[i][j] + (i || j ? least : 0);
  }
  const at = new Array(n).fill(0), count = new Array(n).fill(0);
  let i = n - 1, j = m - 1, far = 0, pairs = 0;
  for (;;) {
    at[i] += j; count[i]++; far += cost[i][j]; pairs++;
    if (!i && !j) break;
    const step = i && j ? came[i][j] : i ? 1 : 2;
    if (step !== 2) i--;
    if (step !== 1) j--;
  }
  return [steady(at.map((x, k) => x / count[k]), m - 1), Math.sqrt(far / pairs)];
}

function steady(warp, end) {
  const n = warp.length, line = linspace(0, end, n), half = Math.max(Math.floor(n / 60), 2), size = 2 * half + 3, off = [...new Array(half).fill(0), ...minus(warp, line), ...new Array(half).fill(0)];
  const window = range(size).map(k => 0.5 - 0.5 * Math.cos((2 * Math.PI * k) / (size - 1))).slice(1, -1), total = sum(window), even = line.map((x, t) => x + sum(window.map((w, k) => (w / total) * off[t + k])));
  even[0] = 0;
  even[n - 1] = end;
  let most = -Infinity;
  return even.map(x => Math.min(Math.max((most = Math.max(most, x)), 0), end));
}

const apartOf = each => each[0].map((_, t) => { const middle = meanRow(each.map(rows => rows[t])); return Math.sqrt(average(each.map(rows => sum(minus(rows[t], middle).map(x => x * x))))); });

function pathOf(lessons, ends, dt, cutoff) {
  const step = Math.max((largest(lessons.map(one => one.position.length)) * dt) / MOST_ROWS, ROW_S);
  const rough = lessons.map(({ position }) => atPlaces(position, linspace(0, position.length - 1, Math.max(rounded(((position.length - 1) * dt) / step), 5) + 1)));
  let template = rough.slice().sort((a, b) => a.length - b.length)[rough.length >> 1], fits, time, used;
  for (let turn = 0; turn < 2; turn++) {
    const a = shapeOf(template), found = rough.map(path => warped(a, path)), usual = median(found.map(one => one[1]));
    fits = found.map(([, cost]) => cost <= STRAY * usual || lessons.length < 4);
    used = found.filter((_, n) => fits[n]).map(one => one[0]);
    time = meanRow(used);
    const middle = meanTable(rough.filter((_, n) => fits[n]).map((path, n) => atPlaces(path, used[n])));
    template = interpRows(linspace(0, last(time), Math.max(rounded(last(time)), 5) + 1), time, middle);
  }
  const phase = linspace(0, last(time), Math.max(rounded(last(time) * step * POINTS_PER_S), 50) + 1), places = used.map(warp => phase.map(p => (interp(p, time, warp) * step) / dt));
  const kept = lessons.filter((_, n) => fits[n]), each = kept.map((one, n) => atPlaces(one.position, places[n])), row_s = phase[1] * step, where = ends.filter((_, n) => fits[n]);
  const force = smoothed(meanTable(kept.map((one, n) => atPlaces(one.force, places[n]))), row_s, cutoff);
  const position = placedBetween(smoothed(meanTable(each), row_s, cutoff), meanRow(each.map(rows => rows[0])), meanRow(where)), n = force.length;
  return {
    step_s: row_s, position_m: position, force_n: force.map((row, t) => row.map((f, i) => f - (force[0][i] + (t * (force[n - 1][i] - force[0][i])) / (n - 1)))),
    spread_m: position.map((row, t) => Math.sqrt(average(each.map(rows => sum(minus(rows[t], row).map(x => x * x)))))), ends_m: where,
    framed_m: [apartOf(each.map(rows => rows.map(row => minus(row, rows[0])))), apartOf(each.map(rows => rows.map(row => minus(row, last(rows)))))],
  };
}

function placedBetween(path, start, end) {
  const way = wayOf(path), length = last(way), first = minus(start, path[0]), behind = minus(end, last(path));
  return path.map((row, t) => row.map((x, i) => x + (1 - way[t] / length) * first[i] + (way[t] / length) * behind[i]));
}

export function taughtPaths(positions, forces, dt) {
  const extent = largest(positions.map(extentOf));
  if (!(extent > 0)) throw new Error("the lessons show no motion to learn");
  const cutoff = cutoffOf(positions, dt, extent), moving = positions.map((rows, n) => movingPart(rows, forces[n], dt, cutoff)), ends = positions.map(last);
  return { paths: goalsOf(moving.map(one => one.position), extent).map(goal => pathOf(goal.map(i => moving[i]), goal.map(i => ends[i]), dt, cutoff)), onsets_s: moving.map(one => one.onset_s) };
}

// ------------------------------------------------------------------------------------------------ the skill file

// Prepared lessons of one role -> the text of a skill file, as `comanip` and this page read it
export function learned(lessons, task) {
  const axes = task.axes.map(axis => axis.name), channels = ["position", "force", "velocity"].flatMap(group => axes.map(axis => `${group}.${axis}`)), [{ dt, role }] = lessons;
  if (lessons.some(one => Math.abs(one.dt - dt) > 1e-9)) throw new Error("the lessons are of several rates: comanip learn brings them to one");
  const fit = fittedHmm(lessons.map(one => one.position.map((row, t) => [...row, ...one.force[t], ...one.velocity[t]])), channels), positions = lessons.map(one => one.position), all = positions.flat();
  const box = axes.map((_, i) => { const column = all.map(row => row[i]), high = largest(column), low = -largest(column.map(x => -x)), room = Math.max(AROUND * (high - low), 1e-3); return [low - room, high + room]; });
  const { initial, transition, means, covariances } = fit;
  return signed({
    format: "comanip.skill", version: 3, role, law: "default", settings: {}, axes, dt_s: dt, units: { position: "m", force: "N", velocity: "m/s" }, workspace_m: box, ends_m: positions.map(last), starts_m: positions.map(rows => rows[0]),
    ...taughtPaths(positions, lessons.map(one => one.force), dt), model: { kind: "hmm", channels, initial, transition, means, covariances }, clock: null,
    provenance: {
      comanip: "page", lessons: lessons.map(one => ({ name: one.name, source: "", sha256: "", frames: one.position.length })), log_likelihood: fit.likelihood, converged: fit.converged, bic: fit.bic, n_frames: fit.frames,
      topology: "left-right", held_out: [], notes: ["learned on the page, without a clock: law 'paper' by time needs comanip learn", ...(fit.converged ? [] : ["Baum-Welch did not converge"]), ...biased(lessons)],
    },
  });
}

function biased(lessons) { return lessons.filter(one => lengthOf(meanRow(one.force.slice(0, 30))) > WARNED_N).map(one => `${one.name}: force at rest is above ${WARNED_N} N`); }

// A number as Python's json writes a float, so that its checksum is the same there
function letters(x) {
  const [digits, power] = x.toExponential().split("e"), n = Number(power);
  return x !== 0 && (n < -4 || n > 15) ? `${digits}e${n < 0 ? "-" : "+"}${String(Math.abs(n)).padStart(2, "0")}` : repr(x);
}

function written(value, key = "") {
  if (typeof value === "number") return WHOLE.has(key) ? String(value) : letters(value);
  if (typeof value === "string") return quoted(value);
  if (Array.isArray(value)) return `[${value.map(one => written(one)).join(",")}]`;
  if (value === null || typeof value === "boolean") return String(value);
  return `{${Object.keys(value).sort().map(name => `${quoted(name)}:${written(value[name], name)}`).join(",")}}`;
}

function signed(content) { return written({ ...content, sha256: sha256(written(content)) }); }
