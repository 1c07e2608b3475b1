"""Equations (4) to (10), each against an independent reading of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.loop import run
from comanip.models.gaussian import log_density
from comanip.models.gmr import Regression
from comanip.plants.replay import ReplayPlant
from comanip.skills.paper import PaperLaw, PaperSkill, PositionGain, hidden_loop_gain, law_from

DT = 0.01


def paper(learned, law=PaperLaw(), dt=DT):
    return PaperSkill(learned.model, axes=("z",), dt=dt, model_dt=DT, workspace=learned.workspace, law=law)


def rollout(learned, lesson, law, substeps=1):
    """Path (T, 1) at 100 Hz under the lesson's recorded force, computed at 100 * substeps Hz."""
    time = np.arange(len(lesson)) * DT
    fine = np.arange(len(lesson) * substeps) * DT / substeps
    force = np.interp(fine, time, lesson.force[:, 0])[:, None]
    plant = ReplayPlant(force, dt=DT / substeps, start_position=lesson.position[0])
    recording = run(plant, paper(learned, law, DT / substeps), duration_s=len(lesson) * DT)
    return recording["hand.position"].values[::substeps]


def test_one_step_is_equations_4_5_6_8_9_10(skills, lessons):
    """A plain transcription of the printed equations, with no code of ours but the parameters."""
    model, lesson = skills["follower"].model, lessons["follower"][5]
    i_x, i_f, i_v = (model.channels.index(c) for c in ("position.z", "force.z", "velocity.z"))
    skill, obs, command = paper(skills["follower"]), Observation(1), Command(1)
    obs.position[:] = lesson.position[0]
    skill.reset(obs)
    alpha = None
    for t in range(0, 150):
        x, f, v = lesson.position[t, 0], lesson.force[t, 0], lesson.velocity[t, 0]
        obs.position[:], obs.force[:], obs.velocity[:] = x, f, v
        skill.step(obs, command)
        xi = np.zeros(3)
        xi[[i_x, i_f, i_v]] = x, f, v
        density = np.array(
            [
                np.exp(-0.5 * (xi - m) @ np.linalg.inv(s) @ (xi - m)) / np.sqrt(np.linalg.det(2 * np.pi * s))
                for m, s in zip(model.means, model.covariances, strict=True)
            ]
        )
        alpha = (model.initial if alpha is None else alpha @ model.transition) * density
        alpha = alpha / alpha.sum()
        v_hat = x_hat = 0.0
        for h, m, s in zip(alpha, model.means, model.covariances, strict=True):
            given, back = [i_x, i_f], [i_f, i_v]
            v_hat += h * (m[i_v] + s[i_v, given] @ np.linalg.inv(s[np.ix_(given, given)]) @ (xi[given] - m[given]))
            x_hat += h * (m[i_x] + s[i_x, back] @ np.linalg.inv(s[np.ix_(back, back)]) @ (xi[back] - m[back]))
        mx, sx = model.means[:, i_x], model.covariances[:, i_x, i_x]

        def likelihood(p, mx=mx, sx=sx):
            return (-0.5 * np.log(2 * np.pi * sx) - 0.5 * (p - mx) ** 2 / sx).max()

        top = (-0.5 * np.log(2 * np.pi * sx)).max()
        bottom = min((-0.5 * np.log(2 * np.pi * sx) - 0.5 * (w - mx) ** 2 / sx).min() for w in skills["follower"].workspace[0])
        kappa_p = 0.08 / DT**2 * np.clip((top - likelihood(x)) / (top - bottom), 0.0, 1.0)
        dd_x = (v_hat - v) / DT + (x_hat - x) * kappa_p
        dx = v + DT * dd_x
        assert skill.diagnostics["weights"] == pytest.approx(alpha, abs=1e-6)
        assert skill.diagnostics["target_velocity"][0] == pytest.approx(v_hat, abs=1e-7)
        assert skill.diagnostics["target_position"][0] == pytest.approx(x_hat, abs=1e-7)
        assert command.velocity[0] == pytest.approx(dx, abs=1e-6)
        assert command.position[0] == pytest.approx(x + DT * dx, abs=1e-8)


def test_the_exact_integrator_gives_one_motion_at_any_control_rate(skills, lessons):
    law = PaperLaw(weight_channels=("position", "force"), attraction_per_s=1.0, gain="constant", target_position="force",
                   integrator="exact")  # fmt: skip
    for role in ("leader", "follower"):
        slow, fast = (rollout(skills[role], lessons[role][5], law, n) for n in (1, 10))
        assert np.abs(slow - fast).max() < 0.001


def test_halving_the_step_halves_eulers_error(skills, lessons):
    law = PaperLaw(weight_channels=("position",), attraction_per_s=1.0, gain="constant", target_position="force",
                   velocity_gain_per_s=40.0)  # fmt: skip
    truth = rollout(skills["follower"], lessons["follower"][5], replace(law, integrator="exact"), 16)
    errors = [np.abs(rollout(skills["follower"], lessons["follower"][5], law, n) - truth).mean() for n in (2, 4)]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.35)


def test_the_position_gain_is_zero_on_a_peak_one_far_away_and_lowest_at_a_vertex(skills):
    learned = skills["leader"]
    gain, model = PositionGain(learned.model, learned.workspace), learned.model
    i = model.channels.index("position.z")
    peak = model.means[np.argmin(model.covariances[:, i, i]), i]
    assert gain(np.array([peak])) == pytest.approx(0.0, abs=1e-12)
    assert gain(learned.workspace[:, 1] + 10.0) == 1.0
    inside = np.linspace(*learned.workspace[0], 500)[:, None]
    values = log_density(inside, model.means[:, [i]], model.covariances[:, [i]][:, :, [i]])
    corners = log_density(learned.workspace.T, model.means[:, [i]], model.covariances[:, [i]][:, :, [i]])
    assert corners.min() <= values.min() + 1e-9


def test_T17_the_gain_stays_within_bounds_for_any_position_and_an_empty_workspace_is_refused(skills):
    learned = skills["leader"]
    gain = PositionGain(learned.model, learned.workspace)
    for x in np.concatenate([np.geomspace(1e-6, 1e9, 40), -np.geomspace(1e-6, 1e9, 40)]):
        assert 0.0 <= gain(np.array([x])) <= 1.0
    with pytest.raises(ParameterError, match="workspace is empty"):
        PositionGain(learned.model, learned.workspace[:, ::-1])


def test_missing_channels_and_wild_inputs_never_give_a_command_that_is_not_finite(skills):
    skill, obs, command = paper(skills["follower"]), Observation(1), Command(1)
    obs.position[:], obs.velocity[:], obs.force[:] = 0.85, 0.0, 0.0
    skill.reset(obs)
    for broken in ("position", "velocity", "force"):
        for value in (np.nan, np.inf, -np.inf):
            getattr(obs, broken)[:] = value
            skill.step(obs, command)
            assert np.isfinite(command.velocity).all(), (broken, value)
        getattr(obs, broken)[:] = 0.85 if broken == "position" else 0.0
        for _ in range(3):
            skill.step(obs, command)
        assert np.isfinite(skill.diagnostics["weights"]).all()


def test_bounded_targets_stay_within_what_was_taught(skills):
    law = PaperLaw(bounded=True)
    skill, obs, command = paper(skills["follower"], law), Observation(1), Command(1)
    obs.position[:], obs.velocity[:], obs.force[:] = 0.85, 0.0, 0.0
    skill.reset(obs)
    fastest = np.abs(skills["follower"].model.means[:, skills["follower"].model.channels.index("velocity.z")]).max()
    obs.position[:], obs.force[:] = 3.0, 400.0
    skill.step(obs, command)
    assert abs(skill.diagnostics["target_velocity"][0]) < 3.0 * fastest


def test_the_hidden_loop_gain_is_the_slope_of_its_regression(skills):
    model = skills["follower"].model
    slopes = Regression(model, ("force", "velocity"), "position").gains[:, 0, 1]
    assert hidden_loop_gain(model, 8.0) == pytest.approx(8.0 * np.abs(slopes))


def test_unknown_choices_list_the_known_ones():
    with pytest.raises(ParameterError, match="allowed: hmm, mixture"):
        PaperLaw(weights="hsmm")
    with pytest.raises(ParameterError, match="it has: weights, "):
        law_from({"kappa": 3})
