"""One self-contained HTML page about a demo: pictures, numbers, an animation of both collaborations. No network, no library."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from ..evaluation.shown import for_html
from ..recording import Recording
from ..trials import Case

FRAME_S = 0.02


def page(
    results: Mapping[str, Any],
    pictures: Mapping[str, str],
    shown: Mapping[str, tuple[Case, Recording]],
    *,
    words: Mapping[str, str] | None = None,
    lift: str = "",
) -> str:
    """The page as text. `pictures`: name -> SVG; `shown`: role -> the run that the animation plays; `words`: what a reader may
    not know -> what it means; `lift`: the page on which the reader lifts with the robot, as text.
    """
    template = files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    filled = {
        "TABLE": _trial_table(results),
        "PREDICTION": _prediction_table(results),
        "LIFT": _lift(lift),
        "SECONDS": f"{results['seconds']:.0f}",
        "SEED": str(results["seed"]),
        "PARTNERS": str(results["roles"]["leader"]["trial"]["default"]["partners"]),
        "RUNS": _script({role: _frames(case, run) for role, (case, run) in shown.items()}),
        "WORDS": "\n".join(f"<dt>{for_html(word)}</dt><dd>{for_html(text)}</dd>" for word, text in (words or {}).items()),
        **{f"PICTURE_{name.upper()}": _inline(svg) for name, svg in pictures.items()},
        **{f"SHOWN_{role.upper()}": _sentence(role, case, results) for role, (case, _) in shown.items()},
    }
    for key, value in filled.items():
        template = template.replace("{{" + key + "}}", value)
    return template


def _script(value: Any) -> str:
    """JSON that cannot end the script it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("<", "\\u003c")


def _lift(page: str) -> str:
    """The page in a frame of its own, in which nothing of it reaches this one."""
    if not page:
        return ""
    return (
        "<h2>Lift with it</h2><p>Press the handle on the right and move it. The robot is the one that was just taught.</p>"
        '<iframe class="lift" title="Lift with the robot" sandbox="allow-scripts allow-downloads" '
        f'srcdoc="{html.escape(page)}"></iframe>'
    )


def _inline(svg: str) -> str:
    return svg[svg.index("<svg") :]


def _frames(case: Case, run: Recording) -> dict[str, Any]:
    """What the animation draws, thinned to 50 frames a second: both ends' heights, forces, state weights."""
    time = run["hand.position"].time
    keep = np.searchsorted(time, np.arange(time[0], time[-1], FRAME_S))
    weights = run["skill.weights"].values[keep]
    return {
        "dt": FRAME_S,
        "robot": np.round(run["hand.position"].values[keep, 0], 4).tolist(),
        "partner": np.round(run["partner.position"].values[keep, 0], 4).tolist(),
        "force": np.round(run["hand.true_force"].values[keep, 0], 2).tolist(),
        "state": weights.argmax(axis=1).tolist(),
        "states": int(weights.shape[1]),
        "goal": round(float(case.start_m[0] + case.course.end[0]), 3) if case.role == "follower" else None,
        "onset": case.onset_s if case.role == "follower" else None,
    }


def _sentence(role: str, case: Case, results: Mapping[str, Any]) -> str:
    v = results["roles"][role]["shown"]
    outcome = "succeeded" if v["success"] else "failed: " + ", ".join(v["failures"])
    partner = f"stiffness {case.stiffness_n_per_m:.0f} N/m, beam {case.beam_mass_kg:.2f} kg"
    if role == "follower":
        partner += f", lifts {100 * case.lift_m:.0f} cm in {case.duration_s:.1f} s from {case.onset_s:.1f} s on"
    else:
        partner += f", yields at {case.yielding_ns_per_m:.0f} N s/m after {1000 * case.delay_s:.0f} ms"
    return for_html(
        f"The first partner drawn ({partner}): {outcome}; end error {1000 * abs(v['end_error_m']):.0f} mm, "
        f"peak force {v['peak_force_n']:.1f} N, beam within {v['tilt_deg']:.2f}°."
    )


_LAWS = {"default": "comanip's default law", "paper": "the paper's law, literal", "mass-damper": "the best mass-damper of a grid"}


def _trial_table(results: Mapping[str, Any]) -> str:
    rows = [_trial_row(role, _LAWS[law], t) for role, r in results["roles"].items() for law, t in r["trial"].items()]
    rows += [
        _trial_row(role, f"{_LAWS['default']}, on the humanoid ({r['in_physics']['partners']} of the partners)", r["in_physics"])
        for role, r in results["roles"].items()
        if "in_physics" in r
    ]
    return "\n".join([*rows, _trial_row("told nothing", _LAWS["default"], results["auto"])])


def _trial_row(role: str, law: str, t: Mapping[str, Any]) -> str:
    low, high = t["interval"]
    success, interval = f"{100 * t['success']:.0f} %", f"{100 * low:.0f}–{100 * high:.0f} %"
    why = "; ".join(f"{reason} ({n})" for reason, n in t["failures"].items()) or "–"
    return (
        f"<tr>{_cell('robot as', role)}{_cell('law', law)}{_cell('success', success, 'n')}"
        f"{_cell('95 %', interval, 'n')}{_cell('effort, N² s', _number(t['effort']), 'n')}"
        f"{_cell('highest |F|, N', _number(t['peak_force_n']), 'n')}{_cell('why it failed', why)}</tr>"
    )


def _prediction_table(results: Mapping[str, Any]) -> str:
    return "\n".join(_prediction_row(role, r["learn_s"], r["prediction"]) for role, r in results["roles"].items())


def _prediction_row(role: str, learn_s: float, found: Mapping[str, float]) -> str:
    r2, rmse = f"{found['one_step_velocity_r2']:.3f}", f"{100 * found['free_run_position_rmse_m']:.1f} cm"
    return (
        f"<tr>{_cell('role', role)}{_cell('learned in', f'{learn_s:.2f} s', 'n')}{_cell('one-step R²', r2, 'n')}"
        f"{_cell('free run RMSE', rmse, 'n')}</tr>"
    )


def _cell(name: str, value: str, kind: str = "") -> str:
    """A cell that carries its column's name, which stands beside it where the page is too narrow for columns."""
    return f'<td{f" class={kind}" if kind else ""} data-name="{for_html(name)}">{for_html(value)}</td>'


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}" if abs(value) < 1e4 else "diverged"
