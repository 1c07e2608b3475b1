"""One axis of force is missing: the others still count, and what is regressed is the marginal over the one that is not there."""

import numpy as np
import pytest

from comanip.fitting.hmm import fit_hmm
from comanip.interfaces import Command, Observation
from comanip.models.gmm import Gmm
from comanip.models.gmr import regress
from comanip.models.hmm import Hmm
from comanip.skills.paper import PaperLaw, PaperSkill
from toys import random_hmm

CHANNELS = tuple(f"{group}.{axis}" for group in ("position", "force", "velocity") for axis in "xz")
INPUTS = ("position", "force")


def model_of(seed=0):
    p = random_hmm(np.random.default_rng(seed), 4, 6)
    return Hmm(p.initial, p.transition, p.means, p.covariances, CHANNELS)


def without(model, names):
    """The marginal model: without these channels."""
    kept = [i for i, c in enumerate(model.channels) if c not in names]
    return Hmm(
        model.initial, model.transition, model.means[:, kept], model.covariances[:, kept][:, :, kept],
        tuple(model.channels[i] for i in kept),
    )  # fmt: skip


@pytest.mark.parametrize("weights", ["mixture", "forward", "mixture-with-priors"])
@pytest.mark.parametrize("missing", [(0,), (2,), (3,), (1, 2), (0, 1, 2), (0, 1, 2, 3)])
def test_a_row_is_regressed_from_the_inputs_that_it_has(weights, missing):
    model, x = model_of(), np.random.default_rng(1).normal(size=(30, 4))
    x[:, missing] = np.nan
    gone = [CHANNELS[i] for i in missing]
    small, kept = without(model, gone), [i for i in range(4) if i not in missing]
    if weights == "mixture-with-priors":
        model, small = (Gmm(m.initial, m.means, m.covariances, m.channels) for m in (model, small))
    found = regress(model, INPUTS, "velocity", x, weights=weights, input_noise={"force.z": 0.3})
    if not kept:
        h = np.full((30, 4), 0.25) if weights == "mixture" else np.tile(model.weights, (30, 1)) if weights != "forward" else None
        if h is not None:
            np.testing.assert_allclose(found.mean, h @ model.means[:, 4:], rtol=1e-10)
        assert np.isfinite(found.mean).all()
        return
    noise = {"force.z": 0.3} if 3 in kept else {}
    expected = regress(small, [CHANNELS[i] for i in kept], "velocity", x[:, kept], weights=weights, input_noise=noise)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9, atol=1e-12)


def test_rows_that_lack_different_inputs_do_not_touch_one_another():
    model, x = model_of(), np.random.default_rng(2).normal(size=(40, 4))
    whole = regress(model, INPUTS, "velocity", x)
    x[3, 1] = x[7, 2] = x[7, 3] = np.nan
    found = regress(model, INPUTS, "velocity", x)
    rest = [i for i in range(40) if i not in (3, 7)]
    np.testing.assert_allclose(found.mean[rest], whole.mean[rest], rtol=1e-12)
    assert np.isfinite(found.mean).all()
    assert not np.allclose(found.mean[[3, 7]], whole.mean[[3, 7]])


def lessons(n=4, seed=0):
    """Lifts along x and z together, the force of each axis along its own motion, (T, 6)."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(n):
        s = np.clip(np.linspace(-0.1, 1.1, int(200 * rng.uniform(0.9, 1.1))), 0.0, 1.0)
        up = 10 * s**3 - 15 * s**4 + 6 * s**5
        x = np.column_stack([0.2 * up, 0.3 * up]) * (1.0 + 0.05 * rng.normal(size=2)) + 1e-3 * rng.normal(size=(len(s), 2))
        v = np.gradient(np.column_stack([0.2 * up, 0.3 * up]), 0.01, axis=0)
        out.append(np.hstack([x, 10.0 * v + 0.2 * rng.normal(size=v.shape), v]))
    return out


@pytest.mark.parametrize("target", ["measured", "predicted", "force"])
@pytest.mark.parametrize("integrator", ["euler", "exact"])
@pytest.mark.parametrize("lost", ["x", "z"])
def test_the_papers_skill_uses_the_force_that_is_left(target, integrator, lost):
    model = fit_hmm(lessons(), 5, channels=CHANNELS).model
    law = PaperLaw(target_position=target, integrator=integrator, bounded=True)
    skill = PaperSkill(model, axes=("x", "z"), dt=0.01, model_dt=0.01, workspace=np.array([[-0.1, 0.4], [-0.1, 0.5]]), law=law)
    obs, command = Observation(2), Command(2)
    obs.position[:], obs.velocity[:] = [0.1, 0.15], [0.2, 0.3]

    def asked(force):
        skill.reset(obs)
        for k in range(3):
            obs.time, obs.force[:] = 0.01 * k, force
            skill.step(obs, command)
        return command.velocity.copy(), skill.diagnostics["target_velocity"].copy()

    column = "xz".index(lost)
    answers = []
    for there in (0.5, 6.0):
        force = np.array([there, there])
        force[column] = np.nan
        velocity, target_velocity = asked(force)
        assert np.isfinite(velocity).all()
        answers.append(target_velocity)
    assert np.abs(answers[1] - answers[0]).max() > 1e-3  # the other axis' force still counts
    force = np.array([0.5, 0.5])
    force[column] = np.nan
    h = skill.diagnostics["weights"]
    asked(force)
    x = np.concatenate([obs.position, force])[None]
    if integrator == "euler":
        expected = regress(model, INPUTS, "velocity", x, weights=h[None].copy()).mean[0]
        np.testing.assert_allclose(skill.diagnostics["target_velocity"], expected, rtol=1e-9)
    np.testing.assert_allclose(asked([np.nan, np.nan])[0], asked([np.inf, -np.inf])[0])
    np.testing.assert_array_equal(np.isfinite(asked([np.nan, np.nan])[0]), True)
