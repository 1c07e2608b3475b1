// What happened in a lift, in numbers, and whether it was good: the criteria of trials/judging.py, for one person at the page.

export const CRITERIA = { end_m: 0.03, taught_end_m: 0.02, peak_n: 15, residual_n: 3, ripple_m_per_s: 0.01, tilt_deg: 3, starts_by_s: 2 };
const CUTOFF_HZ = 15, MOVED_M = 0.01;

export function lowpass(cutoffHz, dt) {
  const k = Math.tan(Math.PI * cutoffHz * dt), norm = 1 / (1 + Math.SQRT2 * k + k * k), b0 = k * k * norm;
  return [b0, 2 * b0, b0, 2 * (k * k - 1) * norm, (1 - Math.SQRT2 * k + k * k) * norm];
}

function section([b0, b1, b2, a1, a2], values) {
  // as if it had always been at its first value
  let s1 = values[0] * (1 - b0), s2 = values[0] * (b2 - a2);
  return values.map(x => {
    const y = b0 * x + s1;
    s1 = b1 * x - a1 * y + s2;
    s2 = b2 * x - a2 * y;
    return y;
  });
}

// signals.filters.smooth: forward and backward, with odd padding.
export function smooth(values, dt, cutoffHz) {
  const n = Math.min(values.length - 1, Math.max(9, Math.ceil(1 / (cutoffHz * dt))));
  if (n < 1) return values.slice();
  const first = values[0], last = values[values.length - 1], padded = [];
  for (let i = n; i > 0; i--) padded.push(2 * first - values[i]);
  padded.push(...values);
  for (let i = 1; i <= n; i++) padded.push(2 * last - values[values.length - 1 - i]);
  const filter = lowpass(cutoffHz, dt);
  const back = section(filter, section(filter, padded).reverse()).reverse();
  return back.slice(n, n + values.length);
}

export function lengthOf(row) { return row.length === 1 ? Math.abs(row[0]) : Math.hypot(...row); }
function columns(rows, d) { return Array.from({ length: d }, (_, n) => rows.map(row => row[n])); }
function rowsOf(columns) { return columns[0].map((_, t) => columns.map(column => column[t])); }

/* take: {dt, start, position, velocity, force (true), tilt} with rows (d,) a tick.
 * asked: {goal (d,) from the start or null, ends [(d,)] where lessons ended or null, starts: whether the robot must begin by itself, onset_s of the person or null} */
export function judged(take, asked) {
  const d = take.position[0].length, dt = take.dt, t = take.position.map((_, n) => n * dt);
  const force = rowsOf(columns(take.force, d).map(column => smooth(column, dt, CUTOFF_HZ)));
  const x = take.position.map(row => row.map((p, n) => p - take.start[n])), last = x[x.length - 1];
  const gone = x.findIndex(row => lengthOf(row) > MOVED_M);
  let rest = 0;
  x.forEach((row, n) => { if (lengthOf(row.map((p, i) => p - last[i])) > MOVED_M) rest = n; });
  const stop = t[rest], late = Math.min(stop + 1.5, t[t.length - 1] - 0.3), tail = t[t.length - 1] - 0.5;
  const size = force.map(lengthOf);
  const velocities = take.velocity.filter((_, n) => t[n] > tail);
  const found = {
    effort_n2s: size.reduce((sum, f) => sum + f * f, 0) * dt,
    peak_n: Math.max(...size),
    residual_n: Math.max(0, ...size.filter((_, n) => t[n] >= late)),
    end_error_m: endError(asked, last),
    tilt_deg: Math.max(...take.tilt.map(lengthOf)) * (180 / Math.PI),
    ripple_m_per_s: columns(velocities, d).reduce((most, v) => Math.max(most, Math.max(...v) - Math.min(...v)), 0) / 2,
    starts_s: gone < 0 ? null : t[gone],
    duration_s: gone < 0 ? 0 : Math.max(stop - t[gone], 0),
  };
  return { ...found, failures: failures(found, asked) };
}

function endError(asked, last) {
  if (asked.goal) return lengthOf(last.map((p, n) => p - asked.goal[n]));
  if (!asked.ends || !asked.ends.length) return null;
  if (last.length === 1) {
    const ends = asked.ends.map(end => end[0]), low = Math.min(...ends), high = Math.max(...ends);
    return Math.max(low - last[0], last[0] - high, 0);
  }
  return Math.min(...asked.ends.map(end => lengthOf(last.map((p, n) => p - end[n]))));
}

function failures(found, asked) {
  const out = [], most = asked.goal ? CRITERIA.end_m : CRITERIA.taught_end_m;
  if (found.starts_s === null) out.push("nobody moved it");
  else if (asked.starts && found.starts_s > CRITERIA.starts_by_s) out.push("did not start in time");
  if (asked.onset_s != null && found.starts_s !== null && found.starts_s < asked.onset_s) out.push("moved before you did");
  if (found.end_error_m !== null && found.end_error_m > most) out.push(asked.goal ? "missed the goal" : "missed the taught end");
  if (found.residual_n > CRITERIA.residual_n) out.push("still pulling at the end");
  if (found.peak_n > CRITERIA.peak_n) out.push("a high peak of force");
  if (found.ripple_m_per_s > CRITERIA.ripple_m_per_s) out.push("not at rest at the end");
  if (found.tilt_deg > CRITERIA.tilt_deg) out.push("beam not level");
  return out;
}
