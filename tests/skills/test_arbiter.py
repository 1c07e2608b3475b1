"""Who commands: without a jump, on request and by evidence, and not by one that fails."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from comanip.errors import MismatchError, ParameterError
from comanip.interfaces import Command, Observation, Skill
from comanip.reproduction import enveloped
from comanip.skills.arbiter import Arbiter, Insistence, Patience
from comanip.skills.baselines import MassDamper
from comanip.trials import contestant, draw_case, judge, run_case

AXES, DT = ("x", "z"), 0.01


class Says:
    """A skill, policy or person by what it says: `say(n)` (d,) [m/s] at tick n."""

    notice = stop_reason = ""
    diagnostics = MappingProxyType({})

    def __init__(self, say):
        self.say = say

    def reset(self, obs):
        self.n = 0

    def step(self, obs, command):
        self.n += 1
        command.velocity[:] = self.say(self.n)
        command.position[:] = obs.position + DT * command.velocity
        command.acceleration[:] = 0.125


def still(d=2):
    obs = Observation(d)
    obs.position[:] = obs.velocity[:] = obs.force[:] = 0.0
    return obs


def stepped(arbiter, n, obs=None, meanwhile=lambda k: None):
    """What was sent (n, d)."""
    obs, command, sent = obs or still(len(arbiter.axes)), Command(len(arbiter.axes)), []
    for k in range(n):
        meanwhile(k)
        obs.time = k * DT
        arbiter.step(obs, command)
        sent.append(command.velocity.copy())
    return np.array(sent)


def test_ten_thousand_takeovers_stay_within_the_bound_and_arrive():
    rng = np.random.default_rng(0)
    wanted = rng.uniform(-0.6, 0.6, (2, 2))
    arbiter = Arbiter(Says(lambda n: wanted[0]), Says(lambda n: wanted[1]), axes=AXES, dt=DT)
    arbiter.reset(still())
    obs, command, last, takeovers, arrived = still(), Command(2), np.zeros(2), 0, 0
    while takeovers < 10_000:
        who = "ab"[takeovers % 2]
        if arbiter.commander != who:
            wanted["ab".index(who)] = rng.uniform(-0.6, 0.6, 2)
        arbiter.request(who)
        takeovers += 1
        for _ in range(80 if rng.uniform() < 0.03 else int(rng.integers(1, 8))):  # mostly too short to arrive
            arbiter.step(obs, command)
            assert np.linalg.norm(command.velocity - last) <= 2.0 * DT * (1.0 + 1e-9)
            last = command.velocity.copy()
        assert arbiter.commander == who
        if arbiter.joined:
            arrived += 1
            assert (command.velocity == wanted["ab".index(who)]).all()
    assert arrived > 200


def test_whatever_the_two_say_no_tick_changes_the_velocity_by_more_than_the_bound():
    rng = np.random.default_rng(1)
    wild = [Says(lambda n: rng.uniform(-1.0, 1.0, 2)), Says(lambda n: rng.uniform(-1.0, 1.0, 2) * 10.0 ** rng.uniform(-3, 3))]
    arbiter = Arbiter(*wild, axes=AXES, dt=DT, takeover_m_per_s2=1.0, a_max_m_per_s2=4.0)
    arbiter.reset(still())
    sent = stepped(arbiter, 3000, meanwhile=lambda k: arbiter.request("ab"[int(rng.integers(2))]))
    assert np.linalg.norm(np.diff(sent, axis=0, prepend=0.0), axis=1).max() <= 4.0 * DT * (1 + 1e-9)


class Wild(Says):
    """Sometimes NaN, sometimes infinite, of another shape, late, raising, or spoiling what it was shown; else anything."""

    FAULTS = ("nan", "inf", "shape", "list", "raises", "late", "spoils", "says")

    def __init__(self, rng, clock, often):
        self.rng, self.clock, self.often, self.kinds = rng, clock, often, set()

    def step(self, obs, command):
        assert np.isfinite(obs.position).all(), "what the other has written into its observation is seen"
        command.velocity = self.rng.uniform(-0.6, 0.6, 2)
        command.position, command.acceleration = obs.position.copy(), np.zeros(2)
        fault = self.FAULTS[int(self.rng.integers(len(self.FAULTS)))] if self.rng.uniform() < self.often else ""
        self.kinds.add(fault)
        if fault in ("nan", "inf"):
            command.velocity[0] = float(fault)
        elif fault == "shape":
            command.velocity = np.zeros(3)
        elif fault == "list":
            command.velocity = [0.1, 0.2]
        elif fault == "raises":
            raise KeyError("boom")
        elif fault == "late":
            self.clock[0] += 0.5
        elif fault == "spoils":
            obs.position[:] = obs.force[:] = np.nan
            obs.velocity = None

    @property
    def notice(self):
        if self.rng.uniform() < 0.05:
            raise RuntimeError("notice")
        return ""

    @property
    def stop_reason(self):
        raise RuntimeError("stop_reason")

    @property
    def diagnostics(self):
        raise RuntimeError("diagnostics")


@pytest.mark.parametrize(("often", "most"), [(0.05, 1000), (0.5, 10_000), (1.0, 1000)])
def test_ten_thousand_takeovers_between_two_that_fail_at_random_stay_within_the_bound_and_nothing_raises(often, most):
    rng, clock = np.random.default_rng(int(100 * often)), [0.0]
    parts = [Wild(np.random.default_rng(n), clock, often) for n in range(2)]
    arbiter = Arbiter(*parts, axes=AXES, dt=DT, longest_s=0.01, clock=lambda: clock[0])
    arbiter.reset(still())
    obs, command, last, who, takeovers = still(), Command(2), np.zeros(2), "a", 0
    while takeovers < most:
        arbiter.request("ab"[int(rng.integers(2))])
        joined = arbiter.joined
        obs.time = rng.choice([obs.time, obs.time + DT, obs.time + 0.3, np.nan])  # late, repeated and missing ticks, too
        arbiter.step(obs, command)
        took = arbiter.commander != who
        takeovers, who = takeovers + took, arbiter.commander
        change = float(np.linalg.norm(command.velocity - last))
        assert np.isfinite([command.velocity, command.position, command.acceleration]).all()
        assert change <= (2.0 if took or not joined else 10.0) * DT * (1.0 + 1e-9)
        last = command.velocity.copy()
        assert isinstance(arbiter.notice, str)
        assert arbiter.stop_reason == ""
        assert all(name.startswith("arbiter.") for name in arbiter.diagnostics)
        assert np.isfinite(obs.position).all()
    assert often < 0.5 or set(Wild.FAULTS) <= parts[0].kinds | parts[1].kinds


def test_one_that_is_late_loses_the_command_until_it_is_in_time_again():
    clock = [0.0]

    def slow(n):
        clock[0] += 0.02 if 50 <= n < 100 else 0.004
        return 0.3, 0.0

    arbiter = Arbiter(Says(slow), Says(lambda n: (-0.1, 0.0)), axes=AXES, dt=DT, longest_s=DT, clock=lambda: clock[0])
    arbiter.reset(still())
    said = []
    sent = stepped(arbiter, 160, meanwhile=lambda k: said.append(arbiter.notice))
    assert sent[48].tolist() == [0.3, 0.0]
    assert sent[98].tolist() == [-0.1, 0.0]
    assert sent[-1].tolist() == [0.3, 0.0]
    assert said[60] == "a: its step took 0.02 s; allowed: 0.01 s"
    assert said[-1] == ""
    with pytest.raises(ParameterError, match="longest_s is 0"):
        Arbiter(Says(None), Says(None), axes=AXES, dt=DT, longest_s=0.0)


def test_a_command_passes_to_the_bit_once_it_is_reached():
    arbiter = Arbiter(Says(lambda n: (0.1 * np.sin(0.05 * n), 0.3)), Says(lambda n: (0.0, 0.0)), axes=AXES, dt=DT)
    arbiter.reset(still())
    obs, command, alone = still(), Command(2), Command(2)
    for n in range(200):
        arbiter.request("b" if 60 <= n < 100 else "a")
        arbiter.step(obs, command)
        if n in (50, 199):
            assert command.velocity.tolist() == [0.1 * np.sin(0.05 * (n + 1)), 0.3]
            assert command.acceleration.tolist() == [0.125, 0.125]
    assert isinstance(arbiter, Skill)
    assert alone.velocity.tolist() == [0.0, 0.0]


def test_the_same_bound_however_the_axes_are_turned():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])

    def sent(by):
        arbiter = Arbiter(Says(lambda n: by @ [0.4, 0.1]), Says(lambda n: by @ [-0.2, 0.5]), axes=AXES, dt=DT)
        arbiter.reset(still())
        return stepped(arbiter, 100, meanwhile=lambda k: arbiter.request("b" if k > 50 else None))

    assert sent(turn) == pytest.approx(sent(np.eye(2)) @ turn.T, abs=1e-12)


@pytest.mark.parametrize("fault", ["raises", "nan", "shape"])
def test_one_that_fails_loses_the_command_and_where_both_do_the_hand_brakes(fault):
    def bad(n):
        if n > 50 and fault == "raises":
            raise ValueError("boom")
        return (np.nan, 0.0) if n > 50 and fault == "nan" else (0.1, 0.2, 0.3) if n > 50 else (0.3, 0.0)

    one = Arbiter(Says(bad), Says(lambda n: (-0.1, 0.0)), axes=AXES, dt=DT)
    one.reset(still())
    sent = stepped(one, 120)
    assert one.commander == "b"
    assert "a: " in one.notice
    assert sent[49].tolist() == [0.3, 0.0]
    assert sent[-1].tolist() == [-0.1, 0.0]
    both = Arbiter(Says(bad), Says(bad), axes=AXES, dt=DT)
    both.reset(still())
    sent = stepped(both, 120)
    assert np.isfinite(sent).all()
    assert sent[-1].tolist() == [0.0, 0.0]
    assert np.linalg.norm(np.diff(sent[49:], axis=0), axis=1).max() <= 2.0 * DT * (1 + 1e-9)
    both.reset(still())
    assert both.notice == ""


def test_evidence_takes_over_after_it_has_lasted_and_gives_back():
    class Told:
        share = 0.0

        def reset(self, obs):
            """Nothing to forget."""

        def step(self, obs, sent):
            return self.share

    told = Told()
    arbiter = Arbiter(Says(lambda n: (0.1, 0.0)), Says(lambda n: (0.2, 0.0)), axes=AXES, dt=DT, evidence=told, for_s=0.05)
    arbiter.reset(still())
    plan = {0: 0.0, 20: 0.9, 23: 0.1, 30: 0.9, 60: 0.5, 80: 0.1, 90: np.nan, 120: 0.1}
    seen = []

    def meanwhile(k):
        told.share = plan.get(k, told.share)
        seen.append(arbiter.commander)

    stepped(arbiter, 160, meanwhile=meanwhile)
    assert seen[30] == "a", "30 ms of evidence are too short"
    assert seen[37] == "b"
    assert seen[75] == "b", "between the two it stays"
    assert seen[90] == "a"
    told.share = 0.9
    arbiter.request("a")
    stepped(arbiter, 50)
    assert arbiter.commander == "a", "a request goes before evidence"


def test_patience_leads_where_nobody_does_and_not_where_somebody_did():
    for pulls, who in ((False, "b"), (True, "a")):
        arbiter = Arbiter(
            Says(lambda n: (0.0, 0.0)), Says(lambda n: (0.1, 0.0)), axes=AXES, dt=DT, evidence=Patience(DT, patience_s=1.0)
        )
        obs = still()
        arbiter.reset(obs)

        def meanwhile(k, obs=obs, pulls=pulls):
            obs.force[0] = 5.0 if pulls and 40 < k < 60 else 0.0

        stepped(arbiter, 150, obs, meanwhile)
        assert arbiter.commander == who


def test_insistence_hears_a_pull_against_the_motion_and_not_one_along_it():
    for force, insists in (((9.0, 0.0), 0.0), ((-9.0, 0.0), 1.0), ((0.0, 9.0), 1.0), ((-3.0, 0.0), 0.0)):
        one, obs = Insistence(DT), still()
        one.reset(obs)
        obs.force[:] = force
        said = [one.step(obs, np.array([0.2, 0.0])) for _ in range(60)]
        assert said[-1] == insists
        obs.force[:] = 0.0
        assert [one.step(obs, np.zeros(2)) for _ in range(60)][-1] == 0.0


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"takeover_m_per_s2": 0.0}, "allowed: 0 < takeover <= a_max"),
        ({"takeover_m_per_s2": 20.0}, "allowed: 0 < takeover <= a_max"),
        ({"above": 0.2}, "allowed: 0 <= below < above <= 1"),
        ({"b": 3}, "skill b is 3"),
        ({"dt": 0.002}, "made for a control period dt of 0.01 s, the arbiter for 0.002 s"),
    ],
)
def test_what_cannot_be_arbitrated_is_refused(about, says):
    about = {"a": MassDamper(n_axes=2, dt=DT), "b": Says(lambda n: (0.0, 0.0)), "axes": AXES, "dt": DT} | about
    with pytest.raises((ParameterError, MismatchError), match=says):
        Arbiter(about.pop("a"), about.pop("b"), **about)
    with pytest.raises(ParameterError, match="who is 'c'; allowed: 'a', 'b'"):
        Arbiter(Says(None), Says(None), axes=AXES, dt=DT).request("c")


def test_laws_change_places_in_closed_loop_and_the_partner_feels_no_jump(skills):
    """A policy leads off, the law takes over in mid-lift, and back, twice: the lift succeeds."""
    case = draw_case("leader", np.random.default_rng(3))
    law = contestant("default", "leader", skills, dt=DT, envelope=False)
    goal = float(skills["leader"].ends.mean())

    class Policy(Says):
        def step(self, obs, command):
            self.n += 1
            command.velocity[:] = np.clip(1.5 * (goal - obs.position), -0.15, 0.15) * min(self.n / 100.0, 1.0)
            command.position[:] = obs.position + DT * command.velocity
            command.acceleration[:] = 0.0

    arbiter = Arbiter(Policy(None), law, axes=("z",), dt=DT)

    def tap(obs, command):
        arbiter.request("b" if obs.time % 2.0 > 1.0 else "a")

    recording = run_case(case, enveloped(arbiter, axes=("z",), dt=DT), taps=[tap])
    assert len(np.flatnonzero(np.diff(recording["arbiter.commander"].values[:, 0]))) >= 3
    assert np.abs(np.diff(recording["command.velocity"].values[:, 0])).max() <= 10.0 * DT
    verdict = judge(case, recording, taught_ends_m=skills["leader"].ends)
    assert verdict.success, verdict.failures
