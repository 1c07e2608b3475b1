"""The Gymnasium environment: the checker's word, the trial's own numbers, bytes by seed, and errors that leave it usable."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import forked

gymnasium = pytest.importorskip("gymnasium", reason="the extra gym is not installed")

import comanip.gym  # noqa: E402
from comanip.commands.trying import summary  # noqa: E402
from comanip.errors import ParameterError  # noqa: E402
from comanip.gym import Setting, trial_cases  # noqa: E402
from comanip.gym.episode import Episode  # noqa: E402
from comanip.parts import TASKS  # noqa: E402
from comanip.skills.baselines import MassDamper  # noqa: E402
from comanip.tasks import named  # noqa: E402
from comanip.trials import contestant, judge, run_case, run_cases  # noqa: E402
from comanip.trials.board import about, entries, gathered  # noqa: E402
from comanip.trials.people import meet  # noqa: E402

RUNNABLE = [name for name in TASKS if not named(name).needs]


def make(task="lift", role="follower", **about):
    return gymnasium.make("comanip/Carry-v0", task=task, role=role, disable_env_checker=True, **about).unwrapped


def played(env, policy, seed=None, options=None, most=10_000):
    """Observations, rewards and the last info of one episode."""
    obs, info = env.reset(seed=seed, options=options)
    seen, got = [obs], []
    for _ in range(most):
        obs, reward, over, cut, info = env.step(policy(obs))
        seen.append(obs)
        got.append(reward)
        if over or cut:
            break
    return np.array(seen), np.array(got), info


def damper(obs):
    return obs[2 * len(obs) // 3 :] / 25.0


@pytest.mark.parametrize("about", [{"people": "all"}, {"action": "acceleration", "history": 3}])
def test_gymnasiums_own_checker_has_nothing_to_say(about):
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(make(render_mode="rgb_array", **about))
    told = [str(one.message) for one in said]
    assert [one for one in told if "normalized space" not in one] == []  # ours are m/s and m/s^2: docs/gym.md says how to scale


@pytest.mark.parametrize("task", RUNNABLE)
def test_the_checker_has_nothing_to_say_of_any_task_and_role_also_by_make_and_make_vec(task, monkeypatch):
    from gymnasium.utils.env_checker import check_env

    monkeypatch.setattr(Setting, "learned", lambda self: {})  # takes seconds a task, and changes no step
    for role in ("leader", "follower", "auto"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", message=".*normalized space.*")
            check_env(gymnasium.make("comanip/Carry-v0", task=task, role=role, render_mode="rgb_array").unwrapped)
            many = gymnasium.make_vec("comanip/Carry-v0", num_envs=2, task=task, role=role)
            seen, _ = many.reset(seed=0)
            assert many.observation_space.contains(seen)
            assert many.observation_space.contains(many.step(many.action_space.sample())[0])


def test_it_is_registered_by_importing_its_room_and_by_its_name():
    imports = ("import comanip.gym", "import comanip", "name = 'comanip.gym:comanip/Carry-v0'")
    for code in (f"name = 'comanip/Carry-v0'; {more}" for more in imports):
        done = subprocess.run([sys.executable, "-c", f"import gymnasium; {code}; gymnasium.make(name)"], capture_output=True)
        assert done.returncode == 0, done.stderr


def test_importing_comanip_loads_nothing_of_it():
    code = "import comanip, sys; print(*[m for m in sys.modules if m.startswith(('gymnasium', 'comanip.gym', 'numpy'))])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.split() == []


@pytest.mark.parametrize("role", ["leader", "follower", "auto"])
def test_a_run_is_that_of_trial_to_the_last_bit(role, skills):
    setting = Setting.of("lift", role, ends_early=False)
    for case in trial_cases(role, 3, seed=7):
        brain = MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0)
        episode = Episode(setting, case, skills, brain=brain)
        while not episode.over:
            episode.tick()
        wanted = run_case(case, contestant("mass-damper", role, skills, dt=0.01))
        got = episode.recording()
        assert {n: (c.values == wanted[n].values).all() for n, c in got.channels.items()} == dict.fromkeys(got.channels, True)
        assert set(got.channels) == set(wanted.channels)
        verdict = judge(case, wanted, taught_ends_m=skills["leader"].ends)
        assert repr(episode.verdict) == repr(verdict)


def test_people_of_a_kind_are_judged_as_trial_people_does(skills):
    setting = Setting.of("lift", "follower", ["sways", "usual"], ends_early=False)
    for case in trial_cases("follower", 1, people=["sways", "usual"]):
        episode = Episode(setting, case, skills, brain=MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0))
        while not episode.over:
            episode.tick()
        assert episode.verdict.failures == meet(case, skills, "mass-damper")[1].failures


@pytest.mark.parametrize(
    ("role", "says", "why", "least", "most"),
    [
        ("follower", 0.3, "moved before the partner", 2, 30),
        ("leader", 0.0, "did not start in time", 201, 201),
        ("follower", 0.0, "duration", 0, 0),
        ("leader", 0.8, "duration", 0, 0),
    ],
)
def test_a_lost_run_ends_when_it_is_lost_and_says_why(role, says, why, least, most, monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    env = make(role=role, misbehaving=0.0)
    _, got, info = played(env, lambda obs: [says], seed=4)
    assert info["reason"] == why
    if why == "duration":
        assert len(got) == round(env.episode.case.run_s / 0.01), "the time that the partner needs, to the tick"
    else:
        assert why in info["failures"]
        assert least <= len(got) <= most


def test_an_object_that_is_not_level_has_been_lost():
    env = make(misbehaving=0.0)
    env.reset(seed=4)
    env.episode.tilt_rad = 1e-3
    for _ in range(1500):
        over, _, info = env.step([0.0])[2:]
        if over:
            break
    assert info["reason"] == "beam not level"
    assert not info["success"]


@pytest.mark.parametrize("role", ["leader", "follower", "auto"])
def test_ending_early_changes_no_success(role):
    early, whole = (make(role=role, ends_early=ends) for ends in (True, False))
    stopped = 0
    for case in trial_cases(role, 6, seed=3):
        for policy in (lambda obs: [0.0], lambda obs: [0.25], damper):
            one, other = (played(env, policy, options={"case": case}) for env in (early, whole))
            assert one[2]["success"] == other[2]["success"]
            stopped += len(one[1]) < len(other[1])
            if one[2]["reason"] != "duration":
                assert one[2]["reason"] in one[2]["failures"]
                assert one[1].sum() < other[1].sum()
    assert stopped


def test_the_same_seed_gives_the_same_bytes_and_another_does_not():
    def run(seed):
        env = make(people="all", role="auto", history=2)
        return [played(env, lambda obs: [0.1 * np.sin(obs[0])], seed=seed if n == 0 else None, most=300)[0] for n in range(3)]

    one, same, other = run(5), run(5), run(6)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(one, same, strict=True))
    assert not all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


def test_the_reward_is_the_sum_of_its_parts_and_a_success_is_worth_ten():
    env, kept = make(misbehaving=0.0), []
    law = MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0)
    env.reset(seed=0)
    for seed in range(4):
        total, force = 0.0, np.zeros(1)
        obs, _ = env.reset(seed=seed)
        law.reset(None)
        while True:
            force[:] = obs[2]
            obs, reward, over, _, info = env.step(law.move(force, 20.0))
            assert reward == pytest.approx(sum(info["parts"].values()))
            assert all(info["parts"][name] <= 0.0 for name in ("place", "effort", "rough"))
            total += info["parts"]["end"]
            if over:
                break
        kept.append((info["success"], total))
    assert {worth for good, worth in kept if good} == {10.0}, "of docs/gym.md"
    assert any(good for good, _ in kept)
    obs, rewards, info = played(make(role="leader", misbehaving=0.0), lambda obs: [0.0], seed=0)
    assert info["reason"] == "did not start in time"
    assert rewards[-1] < -1.5, "3 a second that is left"


@pytest.mark.parametrize("task", RUNNABLE)
def test_every_task_runs_in_every_role(task, monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})  # the lessons' ends take seconds a task, and change no step
    for role in ("leader", "follower", "auto"):
        env = make(task, role, most_ticks=40)
        n = len(named(task).axes)
        assert env.action_space.shape == (n,)
        obs, _, info = played(env, lambda obs, n=n: np.zeros(n), seed=1)
        assert obs.shape[1] == (3 + (role == "leader" and task == "two-shelves")) * n
        assert np.isfinite(obs).all()
        assert all(env.observation_space.contains(one) for one in obs)
        assert "success" not in info


@pytest.mark.parametrize(
    ("action", "says"),
    [
        ([np.nan], r"action is \[nan\]; allowed: \(1,\) finite numbers of a velocity \[m/s\]"),
        ([np.inf], "inf"),
        (["0.1"], r"action is \['0.1'\]; allowed: \(1,\) finite numbers of a velocity"),
        ([1j], "action is"),
        ([True], r"action is \[True\]"),
        (np.ma.array([0.1], mask=[True]), "action is masked_array"),
        (np.array([None]), "action is array"),
        ([], r"action has shape \(0,\)"),
        ({"robot": 0.1}, "action is {'robot': 0.1}"),
        ([0.1, 0.1], r"action has shape \(2,\); allowed: \(1,\)"),
        (0.1, r"action has shape \(\)"),
        ("up", "action is 'up'"),
        (None, r"\[nan\]|shape \(\)|None"),
    ],
)
def test_a_bad_action_is_one_clear_error_and_the_run_goes_on_as_if_nothing_was(action, says):
    env, other = make(), make()
    env.reset(seed=2)
    other.reset(seed=2)
    for _ in range(30):
        with pytest.raises(ParameterError, match=says):
            env.step(action)
        assert env.step([0.0])[0].tobytes() == other.step([0.0])[0].tobytes()


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"task": "fly"}, "task 'fly' is unknown; there are: lift"),
        ({"task": "door"}, "cannot be run yet"),
        ({"role": "boss"}, "role 'boss' is unknown; there are: leader, follower, auto"),
        ({"people": "martians"}, "kind of person 'martians' is unknown"),
        ({"people": "sticks"}, "none of them can be the partner of a robot as follower"),
        ({"people": 7}, "people is 7"),
        ({"plant": "moon"}, "plant 'moon' is unknown; there are: beam"),
        ({"action": "torque"}, "action 'torque' is unknown; there are: velocity, acceleration"),
        ({"action": ["velocity"]}, "is unknown; there are: velocity, acceleration"),
        ({"task": None}, "task 'None' is unknown; there are: lift"),
        ({"task": ["lift"]}, "is unknown; there are: lift"),
        ({"role": 3}, "role '3' is unknown"),
        ({"people": []}, r"people is \[\]"),
        ({"people": ["usual", 3]}, "allowed: usual, tuning"),
        ({"plant": None}, "plant 'None' is unknown"),
        ({"history": 0}, "history is 0"),
        ({"history": True}, "history is True"),
        ({"history": 1.5}, "history is 1.5"),
        ({"misbehaving": 2.0}, r"misbehaving is 2.0 \(float\); allowed: a share of the partners, 0 to 1"),
        ({"misbehaving": None}, "misbehaving is None"),
        ({"misbehaving": np.float64("nan")}, r"misbehaving is nan \(float\)"),
        ({"dt": 0.0}, r"dt is 0.0 \(float\); allowed: a control period in \(0, 0.1\] s"),
        ({"dt": "fast"}, "dt is 'fast'"),
        ({"dt": np.inf}, "dt is inf"),
        ({"envelope": "yes"}, r"envelope is 'yes' \(str\); allowed: True, False"),
        ({"ends_early": 1}, "ends_early is 1"),
        ({"by_kind": True}, "argument 'by_kind' is unknown; there are: task, role, people, misbehaving"),
        ({"gravity": 9.81}, "argument 'gravity' is unknown"),
    ],
)
def test_what_does_not_exist_is_said_with_what_does(about, says):
    for kind in (comanip.gym.CarryEnv, lambda **more: comanip.gym.CarryVectorEnv(2, **more)):
        with pytest.raises(ParameterError, match=says):
            kind(**about)
    if not {"people", "misbehaving", "by_kind"} & set(about):
        with pytest.raises(ParameterError, match=says):
            comanip.gym.CarryPair(**about)


@pytest.mark.parametrize("most", [0, -1, 2.5, "ten", True])
def test_a_number_of_ticks_is_whole_and_positive(most):
    with pytest.raises(ParameterError, match=r"most_ticks is .*; allowed: a whole number, 1 or more"):
        make(most_ticks=most)


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"seed": -1}, r"seed is -1 \(int\); allowed: a whole number, 0 or more"),
        ({"seed": "x"}, "seed is 'x'"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"seed": True}, "seed is True"),
        ({"options": 3}, r"options is 3 \(int\); allowed: {'case': case}"),
        ({"options": ["case"]}, "options is"),
        ({"options": {"case": 3}}, "case is int; allowed: a trials.Case"),
        ({"options": {"case": trial_cases("leader", 1)[0]}}, "role is 'leader'; this environment's is 'follower'"),
        ({"options": {"case": trial_cases("follower", 1, task="slide")[0]}}, "task is 'slide'; this environment's is 'lift'"),
    ],
)
def test_a_bad_reset_is_one_clear_error_and_the_run_before_it_goes_on(how, says):
    kinds = (comanip.gym.CarryEnv, lambda: comanip.gym.CarryVectorEnv(2), comanip.gym.CarryPair)
    quiet = ([0.1], [[0.1], [0.1]], {"robot": [0.1], "partner": [0.0]})
    for kind, said in zip(kinds, quiet, strict=True):
        env, other = kind(), kind()
        env.reset(seed=2)
        other.reset(seed=2)
        for _ in range(3):
            with pytest.raises(ParameterError, match=says if kind is not kinds[1] else r"seed is|options is|case"):
                env.reset(**how)
            assert repr(env.step(said)[0]) == repr(other.step(said)[0])


def test_a_picture_that_nobody_asked_for_is_said_and_the_run_goes_on():
    import comanip.gym as room

    for kind, said in ((room.CarryEnv, [0.1]), (room.CarryPair, {"robot": [0.1], "partner": [0.0]})):
        with pytest.raises(ParameterError, match=r"no episode has begun: call reset\(\) before render"):
            kind(render_mode="rgb_array").render()
        env = kind()
        env.reset(seed=0)
        with pytest.raises(ParameterError, match=r"render_mode is None, so nothing is drawn; .* render_mode='rgb_array'"):
            env.render()
        env.step(said)
    with pytest.raises(ParameterError, match="render_mode is None"):
        room.CarryVectorEnv(1).render()


@pytest.mark.parametrize(("partners", "seed"), [(0, 7), (-1, 7), (1.5, 7), ("x", 7), (1, -1), (1, "x"), (1, None)])
def test_partners_are_asked_for_by_whole_numbers(partners, seed):
    with pytest.raises(ParameterError, match=r"(partners|seed) is .*; allowed: a whole number"):
        trial_cases("follower", partners, seed)


def test_stepping_after_the_end_and_before_the_start_is_said():
    env = make(role="leader")
    with pytest.raises(ParameterError, match=r"call reset\(\)"):
        env.step([0.0])
    played(env, lambda obs: [0.0], seed=0)
    with pytest.raises(ParameterError, match=r"call reset\(\)"):
        env.step([0.0])
    env.reset()
    env.step([0.0])
    with pytest.raises(ParameterError, match="allowed: case"):
        env.reset(options={"partner": 3})
    with pytest.raises(ParameterError, match="role is 'follower'; this environment's is 'leader'"):
        env.reset(options={"case": trial_cases("follower", 1)[0]})


def test_history_holds_the_last_ticks_oldest_first():
    one, three = make(), make(history=3)
    a, _, _ = played(one, damper, seed=4, most=200)
    obs, _ = three.reset(seed=4)
    assert (obs.reshape(3, 3) == a[0]).all()
    for n in range(200):
        obs, *_ = three.step(damper(a[n]))
        assert (obs.reshape(3, 3) == a[[max(n - 1, 0), n, n + 1]]).all()


def test_acceleration_is_summed_up_to_velocity():
    a, b = make(role="leader", action="acceleration"), make(role="leader")
    a.reset(seed=1)
    b.reset(seed=1)
    for n in range(60):
        one, other = a.step([0.5])[0], b.step([0.005 * (n + 1)])[0]
        assert one == pytest.approx(other, abs=1e-12)


def test_a_picture_shows_where_the_hand_is():
    env = make(render_mode="rgb_array", role="leader")
    env.reset(seed=0)
    first = env.render()
    assert (first.shape, first.dtype) == ((240, 400, 3), np.uint8)
    for _ in range(80):
        env.step([0.3])
    rows = [np.argwhere((image == (38, 84, 124)).all(axis=2))[:, 0].mean() for image in (first, env.render())]
    assert rows[1] < rows[0] - 20.0, "a hand that was lifted is drawn higher"
    with pytest.raises(ParameterError, match=r"render_mode is 'human' \(str\); allowed: rgb_array"):
        comanip.gym.CarryEnv(render_mode="human")


def who_ignores(policy, start, goal):
    """One that says no velocity, one that goes back to where it began, and one that lifts in 2 s whatever it feels."""
    t = [0.0]

    def act(obs):
        t[0] += 0.01
        if policy == "nothing":
            return np.zeros(len(goal))
        s = min(t[0] / 2.0, 1.0)
        share = s**3 * (10.0 + s * (-15.0 + 6.0 * s)) if policy == "lifts alone" else 0.0
        return 5.0 * (start + share * goal - obs[: len(goal)])

    return act


def won(task, role, policy, partners, seed):
    """With how many of so many partners who behave."""
    env = make(task, role, misbehaving=0.0)
    goal = np.resize(np.array(getattr(named(task).phases[0], "to", None) or 0.3), env.action_space.shape)
    cases = trial_cases(role, partners, seed=seed, task=task, misbehaving=0.0)
    return sum(played(env, who_ignores(policy, case.start_m, goal), options={"case": case})[2]["success"] for case in cases)


@pytest.mark.parametrize("seed", [11, 90210])
@pytest.mark.parametrize("task", ["lift", "slide", "round-the-corner"])
@pytest.mark.parametrize("policy", ["nothing", "holds", "lifts alone"])
def test_who_ignores_the_partner_scores_nothing(task, policy, seed, monkeypatch):
    """Of partners who behave: a follower who moves first has lost, and a score is the worst role's (docs/gym.md)."""
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    good = {role: won(task, role, policy, 3, seed) for role in ("leader", "follower", "auto")}
    assert good["follower"] == 0
    assert policy == "lifts alone" or sum(good.values()) == 0


@pytest.mark.parametrize("task", RUNNABLE)
def test_who_does_nothing_or_holds_succeeds_nowhere_also_where_a_task_ends_where_it_began(task, monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    got = {(role, policy): won(task, role, policy, 1, 5) for role in ("leader", "follower") for policy in ("nothing", "holds")}
    assert got == dict.fromkeys(got, 0)


def test_the_board_gives_them_a_score_of_nothing(tmp_path, skills):
    """The whole way: files, trials in three roles, results, the table. One that lifts alone leads well, and scores 0."""
    alone = f"""
class Policy:
    def __init__(self):
        self.reset()

    def reset(self):
        self.n, self.start = 0, None

    def __call__(self, seen):
        self.n, self.start = self.n + 1, seen[0] if self.start is None else self.start
        s = min(self.n / 200, 1.0)
        return [5.0 * (self.start + s**3 * (10.0 + s * (-15.0 + 6.0 * s)) * {named("lift").phases[0].to[0]} - seen[0])]
"""
    policies = {
        "nothing": "def policy(seen): return [0.0]\n",
        "holds": "def policy(seen): return [5.0 * (0.85 - seen[0])]\n",
        "alone": alone,
    }
    for name, text in policies.items():
        (tmp_path / f"{name}.py").write_text(text)
    laws, result = [str(tmp_path / f"{name}.py") for name in policies], {}
    met = {role: trial_cases(role, 4, seed=77, misbehaving=0.0) for role in ("leader", "follower", "auto")}
    for role, cases in met.items():
        result[role] = {law: summary(run_cases(cases, skills, law, workers=1), cases) for law in laws}
    every = [case for cases in met.values() for case in cases]
    told = about(every, laws, version="1", plant="beam", tasks=["lift"], by_task=False)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "all.json").write_text(json.dumps({**result, "about": told}))
    ranked = {one.law.split(".")[0]: one for one in entries(gathered(tmp_path / "results"))}
    assert {law: one.worst.score for law, one in ranked.items()} == dict.fromkeys(policies, 0.0)
    led = {row.role: row.score for row in ranked["alone"].rows}
    assert led["leader"] > 0.0, "the one that lifts alone does lift, and its score is 0 all the same"
    assert max(row.score for law in ("nothing", "holds") for row in ranked[law].rows) == 0.0


@pytest.mark.parametrize("about", [{}, {"action": "acceleration"}, {"envelope": False}, {"task": "round-the-corner"}])
def test_what_is_beyond_the_action_space_is_clipped_to_the_byte(about, monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    one, other = (make(role="leader", **about) for _ in range(2))
    one.reset(seed=1)
    other.reset(seed=1)
    most, d = one.setting.seen.most, one.action_space.shape[0]
    assert one.action_space.high.tolist() == pytest.approx([most] * d, rel=1e-6)
    for k in range(40):
        sign = np.sign(np.sin(0.2 * k + np.arange(d)) + 0.01)
        assert one.step(1e3 * most * sign)[0].tobytes() == other.step(most * sign)[0].tobytes()


def test_what_is_said_moves_the_hand_from_the_next_observation_on_and_not_before(monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    still, moved = make(role="leader"), make(role="leader")
    still.reset(seed=3)
    moved.reset(seed=3)
    differ = []
    for k in range(20):
        a, b = still.step([0.0])[0], moved.step([0.05 if k == 10 else 0.0])[0]
        differ += [k] if (a != b).any() else []
    assert 10 <= differ[0] <= 12, "said at tick 10, and 20 ms of an actuator"
    assert differ == list(range(differ[0], 20))


def test_what_is_seen_is_position_velocity_and_force_of_now():
    """The next place is this one and dt times the velocity; the force is that of the partner, to the estimate's lag."""
    env, law = make(misbehaving=0.0), MassDamper(n_axes=1, dt=0.01, mass_kg=6.0, damping_ns_per_m=20.0)
    obs, _ = env.reset(seed=0)
    law.reset(None)
    rows, felt = [obs], [0.0]
    over = False
    while not over:
        obs, _, over, _, _ = env.step(law.move(obs[2:3].copy(), 20.0))
        rows.append(obs)
        felt.append(env.episode.loop.plant.channels["hand.true_force"][0][0])
    assert len(rows) > 150
    place, speed, force = np.array(rows).T
    assert np.corrcoef(np.diff(place), speed[1:])[0, 1] > 0.9
    assert 0.01 * speed.sum() == pytest.approx(place[-1] - place[0], abs=5e-3)
    assert np.corrcoef(force[5:], felt[:-5])[0, 1] > 0.9
    assert np.abs(force).max() > 1.0


def test_nearer_softer_and_smoother_is_worth_more(monkeypatch):
    """Each part of the reward has the sign that docs/gym.md states, and its size."""
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    env, dt = make(role="leader", misbehaving=0.0), 0.01
    env.reset(seed=0)
    parts = [env.step([0.0])[4]["parts"] for _ in range(50)]
    far = abs(env.episode.taught_end()[0] - 0.85) / env.episode.size_m
    assert parts[-1]["place"] == pytest.approx(-dt * min(far, 1.0), rel=0.05)
    assert parts[-1]["rough"] == pytest.approx(0.0, abs=1e-6)
    env.reset(seed=0)
    rough = env.step([0.01])[4]["parts"]["rough"]
    assert rough == pytest.approx(-dt * 0.25), "1 m/s^2 of the 2 m/s^2 that cost one a second"
    before = env.step([0.02])[4]["parts"]["place"]
    for _ in range(40):
        parts = env.step([0.1])[4]["parts"]
        felt = env.episode.loop.plant.channels["hand.true_force"][0][0]
        assert parts["effort"] == pytest.approx(-dt * min((felt / 5.0) ** 2, 1.0))
    assert parts["place"] > before, "it is nearer"
    assert parts["effort"] < 0.0, "the partner is pulled"


@pytest.mark.parametrize(
    ("task", "goes"), [("lift", (0, 1)), ("lower", (0, -1)), ("slide", (1, 0)), ("round-the-corner", (1, 1)), ("crank", (1, 1))]
)
def test_a_picture_shows_each_way_as_it_goes(task, goes):
    """Up is up, along the object is sideways, across it is slantwise, whatever the axes are called."""
    from comanip.gym.render import projection

    what = named(task)
    shown, turned = projection(what)
    to = what.phases[0].to or [1.0] * len(what.axes)
    right, up = shown @ np.array(to if task in ("lift", "lower", "slide") else np.ones(len(what.axes)))
    assert (np.sign(np.round([right, up], 6)) == goes).all()
    assert not turned.any()


def test_what_turns_is_drawn_turned(monkeypatch):
    monkeypatch.setattr(Setting, "learned", lambda self: {})
    env = make("turn", role="leader", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    for _ in range(80):
        env.step([0.3])
    from comanip.gym.render import projection

    last, angle = env.render(), projection(env.setting.task)[1] @ (env.episode.loop.obs.position - env.episode.case.start_m)
    assert angle > 0.5
    changed = np.argwhere((first != last).any(axis=2))[:, 1]
    assert changed.min() >= 45, "left of the hand nothing turns"
    assert len(changed) > 50


def test_without_gymnasium_the_room_says_what_to_install(monkeypatch):
    from comanip.gym.needing import needed

    with pytest.raises(ParameterError, match=r"pip install 'comanip\[gym\]'"):
        needed("no_such_gymnasium")
    assert comanip.gym.ID == "comanip/Carry-v0"


def test_the_ten_lines_of_the_docs_run_for_a_new_user_in_an_empty_folder(tmp_path):
    """Both blocks: the loop, and the policy with its trial and its board."""
    page = (Path(__file__).parents[2] / "docs" / "gym.md").read_text()
    loop, policy, commands = re.findall(r"```\w*\n(.*?)```", page, re.DOTALL)[:3]
    assert len([line for line in loop.splitlines() if line.strip()]) <= 10
    (tmp_path / "loop.py").write_text(loop)
    said = forked.script(tmp_path / "loop.py", cwd=tmp_path)
    assert (said.returncode, said.stderr) == (0, "")
    assert said.stdout.split()[0] in ("True", "False")
    (tmp_path / "mine.py").write_text(policy)
    (tmp_path / "results").mkdir()
    for line in commands.strip().splitlines():
        words = line.replace("--partners 130", "--partners 2 --workers 1").replace("lift slide", "lift").partition(" > ")
        name, *rest = words[0].split()
        done = forked.run(*rest, cwd=tmp_path)
        assert name == "comanip"
        assert done.returncode == 0, done.stderr
        if words[2]:
            (tmp_path / words[2]).write_text(done.stdout)
    assert "mine.py" in (tmp_path / "board.html").read_text()
