"""The words of results, each explained once, in one line, where it is shown: in the terminal, in the report, in the docs."""

from __future__ import annotations

from collections.abc import Iterable

WORDS = {
    "success": "share of partners with whom every criterion held (docs/results.md); 95 %: Wilson interval of that share",
    "effort": "∫F² dt of the interaction force: what carrying together cost the partner beyond the weight; lower is easier",
    "work": "net work that the partner did on the robot's hand; negative: the robot moved the partner",
    "peak": "highest interaction force |F| in the run",
    "residual force": "highest |F| from 1.5 s after the motion has ended: what is still pressed when nothing should be",
    "end": "distance between where the hand ended and where it should have",
    "level": "largest angle of the beam against the horizontal",
    "ripple": "swinging of the hand in the last half second, half of peak to peak",
    "LDLJ": "log dimensionless jerk, smoothness: nearer 0 is smoother, one minimum-jerk motion has -5.3",
    "internal force": "mean force that the two exert against each other and that moves nothing",
    "effort share": "the robot's part in the squared forces of both: 0.5 when both work alike",
    "role right": "runs in which the robot knew its role 0.3 s after 1 cm of motion; only where it was told nothing",
    "told nothing": "the robot is told neither to lead nor to follow (--role auto), and finds out by what it feels",
    "tank": "energy that the safety envelope lets the hand give before it brakes (docs/safety.md)",
    "one-step R²": "share of the velocity's variance that is foreseen from position and force: 1 all, 0 no better than the mean",
    "free run": "the skill goes from the first frame on with the recorded force alone; its distance from the recorded path",
    "log p per frame": "log-likelihood: how well the recording fits the skill's Gaussians; only differences mean something",
    "v(t−1)": "the same R² of the last frame's velocity: what is no merit",
    "persistence": "log p of steps as large as those of the other lessons: what the next frame owes to this one alone",
    "forecast": "1 − squared error / that of constant velocity: 1 perfect, 0 no better; ridge: linear in 0.4 s of v and F",
    "probability": "of each skill, in doubt as the skills' own lessons are when they are left out (docs/results.md)",
    "neither": "the recording fits the likeliest skill as none of that skill's unseen lessons does",
    "∂v/∂F": "how velocity answers force: > 0 goes where it is pulled, a follower; < 0 leads",
    "∂v/∂x": "how velocity answers position: < 0 returns to the path",
    "loop gain": "of eq. (5) with a partner of 600 N/m: below 1 dies away, above 1 shakes (the default law has its own)",
}


def explained(names: Iterable[str]) -> list[str]:
    """One line a word."""
    return [f"{name}: {WORDS[name]}" for name in names]
