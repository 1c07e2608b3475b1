"""The trained baselines: asked as they were trained, and not under a name that states another network."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.trials.policies import policy_skill

FOLDER = str(Path(__file__).parents[2] / "benchmarks" / "policies")


@pytest.fixture(scope="module", autouse=True)
def loaded():
    """torch takes two seconds: where these tests run, and not wherever they are collected."""
    global torch, nets
    torch = pytest.importorskip("torch", reason="the baselines need torch")
    sys.path.insert(0, FOLDER)
    import nets


def kept(tmp_path, kind, name, said=0.3):
    """A network of which every answer is `said`, whatever it sees, and its entry."""
    n_in = 3 * len(nets.SEEN) if kind == "ppo" else 3
    net = nets.KINDS[kind](n_in, 1)
    with torch.no_grad():
        for values in net.parameters():
            values.zero_()
        (net.net[-1] if kind in ("mlp", "ppo") else net.out).bias.fill_(said)
    about = {"kind": kind, "n_in": n_in, "n_out": 1, "by": 1.0, "mean": [0.0] * 3, "scale": [1.0] * 3}
    nets.save(tmp_path, name, "lift", "follower", net, **about)
    return nets.entry(tmp_path, name, "constant")


def asked(file):
    from comanip.tasks import named

    return policy_skill(str(file), "follower", {}, axes=("z",), dt=0.01, task=named("lift"))._skill


@pytest.mark.parametrize("kind", ["mlp", "gru", "act", "ppo"])
def test_each_kind_is_asked_through_its_entry(kind, tmp_path):
    skill = asked(kept(tmp_path, kind, f"{kind}_5"))
    answer = np.asarray(skill.brain(np.zeros(skill.brain.seen.size)))
    assert answer.shape == ((nets.CHUNK, 1) if kind == "act" else (1,))
    assert answer == pytest.approx(0.3 * (nets.SAID_M_PER_S2 if kind == "ppo" else 1.0), rel=1e-6)


def test_a_network_that_was_trained_again_is_not_the_one_that_its_entry_states(tmp_path):
    file = kept(tmp_path, "mlp", "mlp_9")
    before = file.read_bytes()
    kept(tmp_path, "mlp", "mlp_9", said=0.4)
    assert file.read_bytes() != before, "the entry, whose hash a result states, changes with its network"
    file.write_bytes(before)
    with pytest.raises(ParameterError, match=r"mlp_9_lift_follower\.pt is not the network that mlp_9\.py states: train again"):
        asked(file)


def test_ppo_holds_a_decision_while_the_damper_below_it_goes_on(tmp_path):
    brain = asked(kept(tmp_path, "ppo", "ppo", said=0.5)).brain
    seen, said = np.zeros(brain.seen.size), []
    for n in range(2 * nets.HELD):
        seen[-2] = 0.1 * n  # the velocity of now
        said.append(float(brain(seen)[0]))
    assert said == pytest.approx([nets.SAID_M_PER_S2 * 0.5 - nets.LEAK_PER_S * 0.1 * n for n in range(2 * nets.HELD)])


def test_what_ppo_sees_is_from_the_start_of_the_run_scaled_and_the_oldest_first():
    seen = np.arange(2.0 * 3 * 2 * 9).reshape(2, -1)  # two runs, two axes, nine ticks
    start = np.array([[1.0, 2.0], [3.0, 4.0]])
    ticks = nets.picked(seen, start).reshape(2, len(nets.SEEN), 3, 2)
    for n, ago in enumerate(nets.SEEN):
        now = seen.reshape(2, 9, 3, 2)[:, 8 - ago]
        place, speed, force = nets.SCALES
        wanted = np.stack([(now[:, 0] - start) / place, now[:, 1] / speed, now[:, 2] / force], axis=1)
        assert ticks[:, n] == pytest.approx(np.clip(wanted, -100.0, 100.0), rel=1e-6)
