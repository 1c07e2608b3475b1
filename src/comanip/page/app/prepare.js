// From the content of skill files to the numbers of a robot: what page/numbers.py makes, of the same parts in the same order. All
// constants come from there, in config.prepare.

const zip = (a, b, f) => a.map((x, n) => f(x, b[n]));
const plus = (a, b) => zip(a, b, (x, y) => x + y);
export const minus = (a, b) => zip(a, b, (x, y) => x - y);
const inner = (a, b) => a.reduce((sum, x, n) => sum + x * b[n], 0), norm = a => Math.sqrt(inner(a, a));
const most = values => values.reduce((top, x) => (x > top ? x : top), -Infinity);
const mean = rows => rows.reduce(plus).map(x => x / rows.length);

export function gradient(rows, h) {
  const n = rows.length - 1;
  return rows.map((_, i) => (i === 0 ? minus(rows[1], rows[0]).map(x => x / h) : i === n ? minus(rows[n], rows[n - 1]).map(x => x / h) : minus(rows[i + 1], rows[i - 1]).map(x => x / (2 * h))));
}

// numpy.interp of one x
export function interp(x, xs, ys) {
  if (x <= xs[0]) return ys[0];
  if (x >= xs[xs.length - 1]) return ys[ys.length - 1];
  let low = 0, high = xs.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (xs[middle] <= x) low = middle; else high = middle; }
  return ys[low] + ((x - xs[low]) / (xs[high] - xs[low])) * (ys[high] - ys[low]);
}

// skills.reference.PhaseReference.taught, and what is made of it
class Reference {
  constructor(path, c) {
    this.position = path.position_m;
    this.force = path.force_n;
    this.step = path.step_s;
    this.spread = path.spread_m;
    this.velocity = gradient(this.position, this.step);
    this.velocity[0] = this.velocity[0].map(() => 0);
    this.velocity[this.velocity.length - 1] = this.velocity[0].slice();
    this.way = [0];
    for (let n = 1; n < this.position.length; n++) this.way.push(this.way[n - 1] + norm(minus(this.position[n], this.position[n - 1])));
    this.length = this.way[this.way.length - 1];
    this.extent = most(this.position.map(row => norm(minus(row, this.position[0]))));
    this.place = Math.max(c.PLACE_M, c.PLACE_SHARE * this.extent);
    this.topSpeed = most(this.velocity.map(norm));
    this.duration = this.step * (this.position.length - 1);
    this.gain = this.position.map(() => 1);
    const last = this.position[this.position.length - 1], ahead = this.heading(this.duration);
    this.slack = Math.max(0, most(path.ends_m.map(end => inner(minus(last, end), ahead))));
    this.begins = Math.max(c.AT_START * this.extent, 3 * this.spread[0]);
  }

  at(table, phase) {
    const place = Math.min(Math.max(phase / this.step, 0), table.length - 1), n = Math.min(Math.floor(place), table.length - 2), share = place - n;
    return zip(table[n], table[n + 1], (a, b) => (1 - share) * a + share * b);
  }

  along(way) {
    const last = this.way.length - 1;
    if (way >= this.way[last]) return this.position[last];
    if (way <= 0) return this.position[0];
    let n = 0;
    while (this.way[n + 1] <= way) n++;
    const share = (way - this.way[n]) / (this.way[n + 1] - this.way[n]);
    return zip(this.position[n], this.position[n + 1], (a, b) => (1 - share) * a + share * b);
  }

  heading(phase) {
    const ahead = 0.1 * this.extent, gone = this.at(this.way.map(x => [x]), phase)[0], now = Math.min(gone, this.length - ahead), way = minus(this.along(now + ahead), this.along(now)), size = Math.max(norm(way), 1e-300);
    return way.map(x => x / size);
  }

  tracked(attraction, c) {
    const spread = this.spread.map(x => Math.max(x, c.LEAST_SPREAD_M)), firm = spread.map(x => c.INTERVENES_M_PER_S / x), gain = firm.slice();
    for (let n = spread.length - 2; n >= 0; n--) {
      const known = gain[n + 1] + this.step * firm[n] ** 2;
      gain[n] = (2 * known) / (1 + Math.sqrt(1 + 4 * this.step * known));
    }
    this.gain = gain.map(x => Math.min(Math.max(x, c.GAINS_PER_S[0]), c.GAINS_PER_S[1]) / attraction);
    return this;
  }

  get longestRest() {
    const still = this.velocity.slice(1, -1).map(v => norm(v) < 0.05 * this.topSpeed);
    let longest = 0, from = -1;
    still.forEach((rests, n) => {
      if (rests && from < 0) from = n;
      if (!rests && from >= 0) { if (from > 0) longest = Math.max(longest, n - from); from = -1; }
    });
    return longest * this.step;
  }
}

// skills.whereabouts.Whereabouts: rows of its stations, and where each goal's begin
function stations(references, c) {
  const total = references.reduce((sum, r) => sum + r.length, 0), doubt = Math.max(c.POSITION * most(references.map(r => r.extent)), 1e-9), rows = [], firsts = [0];
  for (const r of references) {
    const spacing = Math.max(total / (c.STATIONS - references.length), c.FINEST * r.extent), count = Math.max(Math.round(r.length / spacing), 2), phases = r.way.map((_, n) => r.step * n);
    const way = Array.from({ length: count + 1 }, (_, n) => (n === count ? r.length : n * (r.length / count))), phase = way.map(x => interp(x, r.way, phases));
    phase[0] = 0;
    phase[count] = r.duration;
    const places = phase.map(s => r.at(r.position, s)), speeds = phase.map(s => r.at(r.velocity, s));
    const headings = places.slice(1).map((there, n) => { const step = minus(there, places[n]), size = norm(step); return step.map(x => (size > 1e-12 ? x / size : 0)); });
    headings.push(headings[headings.length - 1]);
    places.forEach((place, n) => { const width = c.SLOW_M_PER_S + c.PACE * norm(speeds[n]); rows.push([...place, ...speeds[n], ...headings[n], phase[n], way[1], doubt, width, Math.log(width)]); });
    firsts.push(rows.length);
  }
  return { rows, firsts };
}

function choleskyInverse(matrix) {
  const n = matrix.length, l = matrix.map(row => row.map(() => 0)), inverse = matrix.map(row => row.map(() => 0));
  for (let i = 0; i < n; i++) for (let j = 0; j <= i; j++) {
    let sum = matrix[i][j];
    for (let k = 0; k < j; k++) sum -= l[i][k] * l[j][k];
    if (i === j) { if (!(sum > 0)) throw new Error("a covariance of its model is not positive definite"); l[i][i] = Math.sqrt(sum); } else l[i][j] = sum / l[j][j];
  }
  for (let i = 0; i < n; i++) for (let j = 0; j <= i; j++) {
    let sum = i === j ? 1 : 0;
    for (let k = j; k < i; k++) sum -= l[i][k] * inverse[k][j];
    inverse[i][j] = sum / l[i][i];
  }
  return inverse;
}

// models.filtering.ForwardFilter over the channels of these groups: origin, factors, centres, peaks, initial, chain
function filter(model, groups, c) {
  const at = groups.flatMap(group => model.channels.map((name, n) => [name, n]).filter(([name]) => name.startsWith(`${group}.`)).map(([, n]) => n)), K = model.means.length, D = at.length;
  const means = model.means.map(row => at.map(n => row[n])), factors = model.covariances.map(S => choleskyInverse(at.map(i => at.map(j => S[i][j])))), origin = mean(means);
  const centres = means.flatMap((row, k) => factors[k].map(line => inner(line, minus(row, origin))));
  const peaks = factors.map(L => -0.5 * (D * Math.log(2 * Math.PI) - 2 * L.reduce((sum, row, n) => sum + Math.log(row[n]), 0)));
  const floored = p => (1 - c.FLOOR) * p + c.FLOOR / K;
  return { D, K, values: [...origin, ...factors.flat(2), ...centres, ...peaks, ...model.initial.map(floored), ...model.transition.flat().map(floored)] };
}

function taughtSpeed(skill) {
  const at = skill.model.channels.map((name, n) => [name, n]).filter(([name]) => name.startsWith("velocity.")).map(([, n]) => n);
  return most(skill.model.means.map((row, k) => norm(at.map(n => Math.abs(row[n]))) + 2 * norm(at.map(n => Math.sqrt(skill.model.covariances[k][n][n])))));
}

// safety.limits.taught_pull
function taughtPull(skill) {
  let top = 0;
  for (const path of skill.paths) {
    const velocity = gradient(path.position_m, path.step_s);
    velocity.forEach((v, n) => { const speed = norm(v); if (speed > 0.01) top = Math.max(top, inner(path.force_n[n], v) / Math.max(speed, 1e-9)); });
  }
  return top;
}

// safety.limits.as_taught under a law that yields: the block "limits", then the walls
function limits(skills, p) {
  const c = p.constants, d = skills[0].axes.length, values = { ...p.limits };
  values.v_max_m_per_s = Math.min(c.SPEED_MARGIN * most(skills.map(taughtSpeed)), p.limits.v_max_m_per_s);
  values.pushed_n = Math.max(c.LED_N, c.LED_SHARE * most(skills.map(taughtPull)));
  values.energy_j = Math.max(p.limits.energy_j, c.PULL_N * Math.max(0, most(skills.flatMap(s => s.paths.map(path => new Reference(path, c).length)))));
  const walls = Array.from({ length: d }, (_, n) => [Math.min(...skills.map(s => s.workspace_m[n][0])) - c.WALL_MARGIN_M, Math.max(...skills.map(s => s.workspace_m[n][1])) + c.WALL_MARGIN_M]);
  return [...p.limit_names.map(name => values[name]), ...walls.flat()];
}

function law(role, skill, p) {
  const stray = Object.keys(skill.settings).filter(name => !p.law_names.includes(name));
  if (stray.length) throw new Error(`law ${String(skill.law).slice(0, 20)} has no setting ${stray[0].slice(0, 40)}`);
  return { ...p.laws[role], ...skill.settings };
}

function references(skill, own, c) {
  const found = skill.paths.map(path => new Reference(path, c)), says = found.every(r => r.spread.some(x => x !== 0));
  if (skill.law === "lqt" && !says) throw new Error("law lqt needs lessons that differ, and the skill does not say how far");
  return skill.law === "even" || !says ? found : found.map(r => r.tracked(own.attraction_per_s, c));
}

function policy(paths, onsets, p) {
  const c = p.constants, values = { ...p.policy };
  values.start_patience_s = Math.max(values.start_patience_s, c.LATER * Math.max(0, ...onsets));
  values.midway_patience_s = Math.max(values.midway_patience_s, c.LATER * most(paths.map(r => r.longestRest)));
  return p.policy_names.map(name => values[name]);
}

// skills.evidence.RoleEvidence: numbers, prior, centre, spread, then each filter behind its number of states
function evidence(skills, modelDt, p) {
  const c = p.constants, models = ["leader", "follower", "natural"].filter(role => skills[role]).map(role => skills[role].model), channels = models[0].channels, groups = channels.map(name => name.split(".")[0]);
  const means = models.flatMap(m => m.means), variances = models.flatMap(m => m.covariances.map(S => S.map((row, n) => row[n]))), centre = mean(means);
  const spread = zip(mean(means.map(row => minus(row, centre).map(x => x * x))), mean(variances), (a, b) => a + b);
  const byGroup = groups.map(group => { const of = spread.filter((_, n) => groups[n] === group); return Math.sqrt(2.25 * (of.reduce((s, x) => s + x, 0) / of.length)); });
  const places = means.map(row => row.filter((_, n) => groups[n] === "position")), range = most(places.flatMap(a => places.map(b => norm(minus(a, b)))));
  const noise = groups.map(group => ({ force: c.DOUBT_FORCE_N, velocity: c.DOUBT_VELOCITY })[group] ?? c.DOUBT_POSITION * range);
  const filters = models.flatMap(model => c.STRENGTHS.map(gain => {
    const scale = groups.map(group => (group === "force" ? gain : 1));
    const heard = { ...model, means: model.means.map(row => zip(row, scale, (x, s) => x * s)), covariances: model.covariances.map(S => S.map((row, i) => row.map((x, j) => x * scale[i] * scale[j] + (i === j ? noise[i] ** 2 : 0)))) };
    return filter(heard, ["position", "force", "velocity"], c);
  }));
  const order = ["position", "force", "velocity"].flatMap(group => channels.map((_, n) => n).filter(n => groups[n] === group)), n = filters.length + 1, names = models.length + 1;
  const prior = new Array(n).fill(1 / (names * c.STRENGTHS.length));
  prior[n - 1] = 1 / names;
  const numbers = [modelDt, modelDt / c.DOUBT_SWITCH_S, modelDt / c.DOUBT_MEMORY_S, c.DOUBT_GATE];
  return { count: filters.length, values: [...numbers, ...prior, ...order.map(i => centre[i]), ...order.map(i => byGroup[i]), ...filters.flatMap(f => [f.K, ...f.values])] };
}

// role: leader, follower or auto; skills by role, contents of skill files. Gives Float64Array.
export function prepared(skills, role, p) {
  const c = p.constants, lead = role !== "follower", one = skills[role === "auto" ? "leader" : role];
  for (const name of role === "auto" ? ["leader", "follower"] : [role]) if (!p.known_laws.includes(skills[name].law)) throw new Error(`law ${String(skills[name].law).slice(0, 20)} does not run on the page; it runs ${p.known_laws.join(", ")}`);
  const leading = law(lead ? "leader" : "follower", one, p), following = role === "auto" ? law("follower", skills.follower, p) : p.laws.follower, paths = references(one, leading, c), watch = filter(one.model, ["position", "force"], c);
  const bank = role === "auto" ? evidence(skills, one.dt_s, p) : null, where = stations(paths, c), plans = role === "leader" ? null : paths;
  const header = { ...p.header, d: one.axes.length, changes: lead ? 1 : 0, leads: role === "leader" ? 1 : 0, goals: paths.length, states: watch.K, heard: watch.D, filters: bank ? bank.count : 0, stations: where.rows.length, model_dt: one.dt_s, told: -1 };
  if (!plans) Object.assign(header, { plans: 0, alike: 0, keep: 0 });
  const packed = values => p.law_names.map(name => values[name]);
  const tables = ["position", "velocity", "force"].flatMap(name => paths.flatMap(r => r[name].flat())), foresight = [];
  if (plans) {
    const made = plans.map(r => {
      const table = zip(r.position.map((row, n) => [...minus(row, r.position[0]), ...r.velocity[n]]), gradient(r.velocity, r.step), (a, b) => [...a, ...b]), heading = r.heading(0), d = heading.length, way = [];
      table[table.length - 1].fill(0, d);
      for (const row of table) way.push(Math.max(way.length ? way[way.length - 1] : -Infinity, inner(row.slice(0, d), heading)));
      return { table, way, heading };
    });
    foresight.push(...made.flatMap(one => one.table.flat()), ...made.flatMap(one => one.way), ...made.flatMap(one => one.heading), ...p.grid, ...p.prior);
  }
  const all = [
    ...p.header_names.map(name => Number(header[name])), ...packed(leading), ...packed(lead ? following : leading),
    ...(lead ? policy(paths, (role === "auto" ? skills.follower : one).onsets_s, p) : p.policy_names.map(() => 0)),
    ...limits(role === "auto" ? [skills.leader, ...Object.values(skills)] : [one], p), ...p.gravity,
    ...paths.flatMap(r => [r.position.length, r.step, r.topSpeed, r.slack, r.place, r.extent, r.begins]), ...tables, ...paths.flatMap(r => r.way), ...paths.flatMap(r => r.gain), ...foresight, ...where.rows.flat(), ...where.firsts,
    ...watch.values, ...(bank ? bank.values : []),
  ];
  if (!all.every(x => typeof x === "number" && !Number.isNaN(x))) throw new Error("it holds a value that is no number where one must be");
  return Float64Array.from(all);
}
