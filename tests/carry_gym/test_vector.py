"""Many runs at once are, number for number, as many alone; and bad input moves none of them."""

from __future__ import annotations

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra gym is not installed")

from comanip import kernels  # noqa: E402
from comanip.errors import ParameterError  # noqa: E402
from comanip.gym import CarryEnv, CarryVectorEnv, Setting  # noqa: E402

SAME, NEXT = gymnasium.vector.AutoresetMode.SAME_STEP, gymnasium.vector.AutoresetMode.NEXT_STEP
ABOUT = (  # and how many ticks, and whether some of them are compiled
    ({}, 900, True),
    ({"role": "leader", "action": "acceleration"}, 500, True),
    ({"role": "auto", "history": 3}, 500, True),
    ({"task": "round-the-corner", "ends_early": False}, 700, True),
    ({"people": ["sways"]}, 300, False),
    ({"task": "turn", "role": "leader"}, 120, False),
)


@pytest.fixture(autouse=True)
def without_lessons(monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})  # they take seconds, and change no tick


def damped(seen, env, rng):
    """Actions (N, d): along the force, and a little noise."""
    d = env.single_action_space.shape[0]
    by = 1.0 if env.setting.action == "acceleration" else 0.04
    force = seen[:, : 3 * d * env.setting.history][:, -d:]
    return by * force + 0.02 * rng.standard_normal(force.shape)


@pytest.mark.parametrize(("about", "ticks", "compiled"), ABOUT, ids=[str(about) for about, *_ in ABOUT])
def test_runs_are_to_the_bit_those_of_one_environment(about, ticks, compiled):
    n, rng = 2, np.random.default_rng(0)
    many, alone = CarryVectorEnv(n, **about), [CarryEnv(**about) for _ in range(n)]
    seen, infos = many.reset(seed=5)
    assert (seen == [one.reset(seed=5 + k)[0] for k, one in enumerate(alone)]).all()
    over, episodes = np.zeros(n, dtype=bool), 0
    for _ in range(ticks):
        said = damped(seen, many, rng)
        seen, rewards, ended, cut, infos = many.step(said)
        for k, one in enumerate(alone):
            if over[k]:
                assert (one.reset()[0], 0.0, False) == (pytest.approx(seen[k], abs=0.0), rewards[k], ended[k])
                continue
            obs, reward, done, _, info = one.step(said[k])
            assert (obs == seen[k]).all()
            assert reward == pytest.approx(rewards[k], abs=1e-15)
            assert done == ended[k]
            if done:
                episodes += 1
                assert repr(info["verdict"]) == repr(infos["verdict"][k])
                assert info["failures"] == infos["failures"][k]
                assert info["reason"] == infos["reason"][k]
        over = ended
        assert not cut.any()
    assert episodes >= 1 or about
    assert (many.compiled_share > 0.0) == (compiled and kernels.native is not None)


@pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")
def test_it_says_which_runs_are_compiled():
    for about, compiled in (({"misbehaving": 0.0}, True), ({"people": "sways"}, False), ({"task": "turn"}, False)):
        infos = CarryVectorEnv(2, **about).reset(seed=0)[1]
        assert infos["compiled"].tolist() == [compiled] * 2


def test_without_compiled_kernels_the_numbers_are_the_same(monkeypatch):
    def run():
        many, rng, kept = CarryVectorEnv(2), np.random.default_rng(1), []
        seen, _ = many.reset(seed=3)
        for _ in range(300):
            seen, rewards, *_ = many.step(damped(seen, many, rng))
            kept.append(np.column_stack([seen, rewards]))
        return np.array(kept), many.compiled_share

    one, share = run()
    monkeypatch.setattr(kernels, "native", None)
    other, none = run()
    assert none == 0.0
    assert one == pytest.approx(other, abs=1e-12)
    assert kernels.native is None or share > 0.5


def test_the_same_step_resets_and_keeps_what_was_last():
    def ends(mode):
        many, seen, rng = CarryVectorEnv(2, role="leader", autoreset_mode=mode), None, np.random.default_rng(2)
        many.reset(seed=1)
        kept = []
        for k in range(260):
            seen, _, ended, _, infos = many.step(np.zeros((2, 1)) * rng.uniform())
            kept.append((k, seen, ended, infos))
        return kept

    for (k, seen, ended, infos), (_, other, also, more) in zip(ends(NEXT)[:201], ends(SAME)[:201], strict=True):
        assert ended.tolist() == also.tolist()
        if ended.any():
            assert k == 200, "a leader that does not start within 2 s has lost"
            assert (more["final_obs"][0] == seen[0]).all()
            assert more["final_info"]["reason"].tolist() == infos["reason"].tolist() == ["did not start in time"] * 2
            assert not (other == seen).all(), "the next one has begun"


def test_gymnasium_makes_it_by_name():
    many = gymnasium.make_vec("comanip/Carry-v0", num_envs=2, vectorization_mode="vector_entry_point", role="leader")
    assert isinstance(many.unwrapped, CarryVectorEnv)
    seen, _ = many.reset(seed=0)
    assert many.observation_space.contains(seen)
    assert many.step(many.action_space.sample())[1].shape == (2,)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (np.zeros(2), r"actions have shape \(2,\); allowed: \(2, 1\)"),
        (np.zeros((3, 1)), r"actions have shape \(3, 1\)"),
        ([[0.0], [np.nan]], r"action of run 1 is \[nan\]"),
        ("up", "actions are 'up'"),
        (0.0, r"actions have shape \(\)"),
        ([["0.1"], ["0.1"]], "actions are"),
        (np.zeros((2, 1), complex), "actions are"),
        ([[0.0], [0.0, 1.0]], "actions are"),
        (None, "actions are None"),
    ],
)
def test_bad_actions_are_one_error_and_nothing_has_moved(bad, says):
    many, other = CarryVectorEnv(2), CarryVectorEnv(2)
    with pytest.raises(ParameterError, match=r"call reset\(\)"):
        many.step(np.zeros((2, 1)))
    many.reset(seed=4)
    other.reset(seed=4)
    for _ in range(60):
        with pytest.raises(ParameterError, match=says):
            many.step(bad)
        assert many.step(np.zeros((2, 1)))[0].tobytes() == other.step(np.zeros((2, 1)))[0].tobytes()


@pytest.mark.parametrize("seed", [[1], [1, 2, 3], [[1], [2]], "ab", 1.5, True, -1, [0, -1], [0, "x"]])
def test_seeds_are_one_number_or_one_a_run(seed):
    many = CarryVectorEnv(2)
    with pytest.raises(ParameterError, match="seed is"):
        many.reset(seed=seed)
    one, same = many.reset(seed=np.int64(3))[0], many.reset(seed=[3, 4])[0]
    assert (one == same).all()


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"num_envs": True}, "num_envs is True"),
        ({"num_envs": "2"}, "num_envs is '2'"),
        ({"autoreset_mode": "nonsense"}, "autoreset_mode is 'nonsense' .*; allowed: NEXT_STEP, SAME_STEP"),
        ({"autoreset_mode": None}, "autoreset_mode is None"),
        ({"render_mode": "rgb_array"}, "draws nothing"),
        ({"task": "fly"}, "task 'fly' is unknown"),
        ({"autoreset_mode": gymnasium.vector.AutoresetMode.DISABLED}, "allowed: NEXT_STEP, SAME_STEP"),
    ],
)
def test_what_does_not_exist_is_said(about, says):
    with pytest.raises(ParameterError, match=says):
        CarryVectorEnv(**about)
