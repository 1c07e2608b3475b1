"""The compiled ordinary tick of the envelope changes nothing: two envelopes, one in Python alone, say the same for ever."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from comanip import kernels
from comanip.interfaces import Command, Observation
from comanip.safety.compiled_tick import LENT, NUMBERS, ROWS, CompiledTick
from comanip.safety.envelope import RUN, Envelope
from comanip.safety.limits import Limits
from envelopes import Dictated
from toys import same

pytestmark = pytest.mark.skipif(kernels.native is None, reason="nothing was compiled, or COMANIP_KERNELS=numpy")


class Pair:
    """The same observations to both; a hand that goes where the first one sends it."""

    def __init__(self, d, dt, limits, start):
        self.envelopes = [Envelope(Dictated(d), axes=tuple("xyzuvw"[:d]), dt=dt, limits=limits) for _ in range(2)]
        self.envelopes[1]._compiled = None
        self.commands, self.obs, self.d, self.dt = [Command(d), Command(d)], Observation(d), d, dt
        self.hand = np.full(d, start)
        self.obs.position[:], self.obs.velocity[:], self.obs.force[:] = self.hand, 0.0, 0.0
        self.again()

    def again(self):
        for envelope in self.envelopes:
            envelope.reset(self.obs)

    def tick(self, where):
        for envelope, command in zip(self.envelopes, self.commands, strict=True):
            envelope.step(self.obs, command)
        a, b = self.commands
        for name in ("position", "velocity", "acceleration"):
            same(getattr(a, name), getattr(b, name), err_msg=f"{name}, {where}")
        one, other = self.envelopes
        assert (one.mode, one.reason) == (other.mode, other.reason), where
        for name in ("tank", "confidence", "mode"):
            same(one.diagnostics[name], other.diagnostics[name], err_msg=f"{name}, {where}")

    def everything(self):
        """Takes all back, and compares what either remembers."""
        one, other = self.envelopes
        assert one.notice == other.notice
        for name in sorted(LENT - {"_period"}):
            a, b = getattr(one, name), getattr(other, name)
            a, b = (vars(x) if hasattr(x, "__dict__") else x for x in (a, b))
            assert repr(a) == repr(b), name


def scene(rng, pair, weight):
    """One thing that happens, as a function (tick, seconds) -> None that sets wish, force and sensors; and for how long."""
    d, obs = pair.d, pair.obs
    speed, pull = (
        rng.choice([0.0, 0.005, 0.1, 0.5, 2.0]) * rng.normal(size=d),
        rng.choice([0.1, 2.5, 8.0, 25.0]) * rng.normal(size=d),
    )
    hz, noise = rng.choice([0.0, 0.5, 3.0, 12.0]), rng.choice([0.0, 1e-6, 0.05])
    kind = rng.choice(["plain", "rest", "blocked", "alone", "bump", "zero moves", "stuck", "empty-handed", "held fast"])
    pair.follows = kind != "held fast"

    def happens(n, t):
        wish = speed * np.cos(2.0 * np.pi * hz * t)
        force = pull * np.sin(2.0 * np.pi * hz * t + 0.3) + noise * rng.normal(size=d)
        sensed = weight - force
        if kind in ("rest", "zero moves"):
            wish, force = 0.0 * wish, 0.02 * rng.normal(size=d)
            sensed = weight - force + (rng.choice([0.0, 1.0, 3.0]) if kind == "zero moves" and n > 15 else 0.0)
        elif kind == "blocked":
            force = -np.sign(pair.commands[0].velocity) * (n + 1.0) * abs(pull)
        elif kind == "alone" and n > 5:
            force = weight.copy()
            sensed = 2.0 * weight
        elif kind == "empty-handed" and n > 10:
            force = 0.01 * rng.normal(size=d)
        elif kind == "bump" and n == 7:
            force = force + rng.choice([30.0, 70.0])
        elif kind == "stuck":
            force, sensed = pull, weight - pull
        for envelope in pair.envelopes:
            envelope.skill.velocity[:] = wish
        obs.force[:], obs.sensor_force[:] = force, sensed

    return happens, int(rng.integers(5, 60))


def mischief(rng, pair):
    """What sensors, clocks and policies do wrong: rarely, and once."""
    obs, d = pair.obs, pair.d
    name = rng.choice(["position", "force", "velocity", "sensor_force"])
    value, trust = rng.choice([np.nan, np.inf, -np.inf, 1e7, 61.0, 9.0, 0.05]), float(rng.uniform())

    def policy(trick):
        for envelope in pair.envelopes:
            envelope.skill.trick = trick

    def shape(command):
        command.velocity = np.zeros(d + 1)

    def nan(command):
        command.acceleration[0] = np.nan

    def other_arrays(command):
        command.velocity, command.acceleration = np.full(d, 0.05), np.full(d, -30.0)

    what = rng.integers(9)
    if what == 0:
        getattr(obs, name)[rng.integers(d)] = value
    elif what == 1:
        setattr(obs, name, np.full(d + int(rng.integers(2)), value))
    elif what == 2:
        obs.time += rng.choice([0.02, 0.025, 0.05, -0.004, -0.0095, -1.0, np.nan])
    elif what == 3:
        policy(rng.choice([shape, nan, other_arrays, lambda command: 1 / 0]))
    elif what == 4:
        for envelope in pair.envelopes:
            envelope._tells = lambda obs: trust
    elif what == 5:
        for envelope in pair.envelopes:
            envelope.change_skill(Dictated(d), obs)
    elif what == 6:
        pair.everything()
    elif what == 7:
        obs.position[rng.integers(d)] += rng.choice([0.015, 0.03, 0.2])
    else:
        for command in pair.commands:
            command.velocity = command.velocity.copy()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 3), st.integers(0, 2**31))
def test_for_ever_the_same(d, seed):
    rng = np.random.default_rng(seed)
    dt = float(rng.choice([0.001, 0.005, 0.01, 0.02]))
    limits = [
        Limits(workspace_m=((0.0, 1.0),) * d),
        Limits(),
        Limits(workspace_m=((0.3, 0.7),) * d, energy_j=0.2, blocked_s=0.1, let_go_s=0.05),
        Limits(v_max_m_per_s=0.3, a_max_m_per_s2=3.0, steady_n_s=60.0, drift_m=0.5, force_limit_n=200.0, stuck_s=0.05),
    ]
    chosen = limits[rng.integers(4)]
    low, high = chosen.workspace_m[0] if chosen.workspace_m else (0.0, 1.0)
    pair = Pair(d, dt, chosen, rng.choice([0.5, low + 0.03, high - 0.03]))
    obs, weight = pair.obs, rng.choice([0.0, -6.0, -20.0]) * rng.uniform(0.2, 1.0, size=d)
    left, time = 0, 0.0
    for tick in range(400):
        if left == 0:
            (happens, left), n = scene(rng, pair, weight), 0
        time += dt * (rng.choice([0.3, 1.0, 1.3, 2.0]) if rng.random() < 0.1 else 1.0)
        pair.hand += pair.commands[0].velocity * dt * pair.follows
        obs.time, obs.position, obs.velocity = time, pair.hand + 1e-5 * rng.normal(size=d), pair.commands[0].velocity.copy()
        obs.force, obs.sensor_force = np.zeros(d), np.zeros(d)
        happens(n, time)
        if rng.random() < 0.02:
            mischief(rng, pair)
        if rng.random() > 0.03:  # else the same sample again, as of an estimator that is late
            pair.tick(f"seed {seed}, tick {tick}")
        left, n = left - 1, n + 1
        if pair.envelopes[0].mode != "RUN" and rng.random() < 0.1:
            for envelope in pair.envelopes:
                envelope.skill.trick = envelope._tells = None
            obs.position, obs.force, obs.velocity, obs.time = pair.hand.copy(), np.zeros(d), np.zeros(d), time
            said = {envelope.rearm(obs) for envelope in pair.envelopes}
            assert len(said) == 1
            if any(said):
                pair.hand[:] = obs.position[:] = 0.5
                pair.again()
    pair.everything()


@pytest.mark.parametrize("seed", range(6))
def test_near_letting_go_it_is_the_same_too(seed):
    """Ends that are free and swing, walls that push by turns, hands that stand or move: `for_s` and `since_s` at every tick."""
    rng = np.random.default_rng(seed)
    weight, speed = -9.8, rng.choice([0.01, 0.05, 0.1])
    hz, swing, offset = rng.choice([2.0, 3.0, 6.5, 10.0]), rng.choice([1.0, 2.5, 5.0]), rng.choice([-2.5, -1.0, 0.0])
    pair = Pair(1, 0.01, Limits(), 0.3)
    for n in range(200):
        pair.obs.time, pair.obs.position[:], pair.obs.velocity[:] = n * 0.01, pair.hand, pair.commands[0].velocity
        gone = weight + offset + swing * np.cos(2.0 * np.pi * hz * n * 0.01)
        pair.obs.force[:] = gone if n > 70 else 0.0
        pair.obs.sensor_force[:] = (
            rng.choice([1e308, 1e9, np.nan]) if n % 61 == 50 else weight + pair.obs.force + 1e-3 * rng.normal()
        )
        for envelope in pair.envelopes:
            envelope.skill.velocity[:] = speed if n > 35 else 0.0
        pair.tick((seed, n))
        pair.hand += pair.commands[0].velocity * 0.01
        if n % 7 == 0:
            pair.everything()


@pytest.mark.parametrize("towards", [1.0, -1.0])
@pytest.mark.parametrize(
    ("stricter", "rule"),
    [({"walls": ((0.45, 0.55),)}, "room to stop"), ({"v_max": 0.2}, "speed"), ({"a_max": 4.0}, "acceleration")],
)
def test_the_compiled_checker_trusts_no_clip(stricter, rule, towards):
    """With rules of its own that the clip does not know: what it lets through is what the Python's lets through."""
    pair = Pair(1, 0.01, Limits(drift_m=1.0), 0.5)
    for envelope in pair.envelopes:
        vars(envelope._checker).update(stricter)
    pair.envelopes[0]._compiled = CompiledTick(pair.envelopes[0])
    for n in range(150):
        for envelope in pair.envelopes:
            envelope.skill.velocity[:] = towards * min(0.003 * n, 0.3) * (1.0 if n % 50 else 3.0)
        pair.hand += pair.commands[0].velocity * 0.01
        pair.obs.time, pair.obs.position[:] = 0.01 * n, pair.hand
        pair.obs.force[:] = pair.obs.sensor_force[:] = 0.1 * np.sin(n)
        pair.tick(n)
    assert pair.envelopes[0].reason == f"checker: {rule}"
    pair.everything()


def test_all_that_the_envelope_remembers_is_lent_or_stays():
    """A memory that is added later is not forgotten: each is lent, or named as one that an ordinary tick leaves alone."""
    alone = {
        "skill", "limits", "_dt", "_tells", "_timer", "_axes", "_d", "_late", "_stale", "_walls", "_mode", "_tank", "_confidence",
        "_inner", "_frozen", "_compiled", "_is_lent", "_state", "_reason", "_first", "_known", "_ran", "_ticks", "_at_first",
        "_feels_s",
        "_passes", "_passed", "_passed_s", "_wait_s", "_sinks_wait_s", "_cause", "_bound", "_pulled", "_taught", "_leading",
    }  # fmt: skip
    parts = {
        "_let_go": {"_alone_n", "_alone_s", "_stands_m_s", "_most_apart_n", "_swing", "_pulls", "_before", "was_mistaken"},
        "_missing": {"_nobody_n", "_nobody_s", "_held_n", "_bias_n", "_fast_m_per_s", "_moving_m_per_s"},
        "_sinking": {"_alone_n"},
        "_pushed": {"_usual_n"},
        "_stuck": {"_stuck_s", "_stuck_m"},
        "_jump": {"_least_n", "_rest_s", "_stays_s", "pending", "_sum", "_count", "_for_s"},
        "_shaking": set(),
        "_checker": {"v_max", "a_max", "walls", "dt"},
    }
    envelope = Envelope(Dictated(), axes=("z",), dt=0.01)
    assert set(vars(envelope)) == alone | LENT
    for part, own in parts.items():
        lent = {name.split(".")[1] for name in (*NUMBERS, *ROWS) if name.startswith(part + ".")}
        assert set(vars(getattr(envelope, part))) == own | lent, part


def test_ordinary_ticks_are_compiled():
    pair = Pair(1, 0.01, Limits(), 0.5)
    one, obs, in_python = pair.envelopes[0], pair.obs, []
    for n in range(100):
        obs.time = 0.01 * n
        obs.force[:] = obs.sensor_force[:] = 0.1 * np.sin(0.1 * n)
        if n == 40:
            one._clock = lambda obs: in_python.append(1)
        one.step(obs, pair.commands[0])
    assert one._state == RUN
    assert not in_python


def test_what_is_lent_comes_back_to_who_asks():
    pair = Pair(1, 0.01, Limits(), 0.5)
    one, obs = pair.envelopes[0], pair.obs
    obs.sensor_force[:] = -5.0
    for n in range(100):
        obs.time, obs.force[:] = 0.01 * n, 0.1 * np.sin(n)
        one.step(obs, pair.commands[0])
    assert not LENT & set(vars(one))
    assert one._force == obs.force.tolist()
    assert set(vars(one)) > LENT
    with pytest.raises(AttributeError, match="no attribute '_else'"):
        one._else  # noqa: B018


def test_a_skill_may_look_at_its_envelope():
    pair = Pair(1, 0.01, Limits(), 0.5)
    for envelope in pair.envelopes:
        envelope.skill.trick = lambda command, envelope=envelope: command.velocity.fill(0.1 + 0.0 * len(envelope._x))
    for n in range(60):
        pair.obs.time = 0.01 * n
        pair.obs.position[:] = 0.5 + 0.001 * n
        pair.obs.force[:] = pair.obs.sensor_force[:] = 0.1 * np.sin(n)
        pair.tick(n)
    pair.everything()
