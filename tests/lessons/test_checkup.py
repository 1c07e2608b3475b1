"""One look finds everything that is planted, says it once, worst first, and its advice mends it."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.formats.listing import listed, look
from comanip.learned.skill import learn
from comanip.lessons.checkup import STOPS, SUSPICIOUS, checkup, stretches
from comanip.recording import Channel, Recording

RNG = np.random.default_rng(0)
T = np.arange(0.0, 4.0, 0.01)
S = np.clip((T - 1.0) / 2.0, 0.0, 1.0)
X = (0.3 * S**3 * (10 - 15 * S + 6 * S**2))[:, None]
V = np.gradient(X[:, 0], T)[:, None]
F = 15.0 * V + 2.0 * np.gradient(V[:, 0], T)[:, None] + 0.05 * RNG.normal(size=V.shape)


LEFT_OUT = "leave out --velocity: it is derived from position"


def taken(time=T, x=X, v=V, f=F, name="lift", role="follower", notes=()):
    channels = {"hand.position": (x, "m"), "hand.force": (f, "N"), "hand.velocity": (v, "m/s")}
    made = {n: Channel(time, values, unit, "task", ("z",)) for n, (values, unit) in channels.items() if values is not None}
    return Recording(made, {"name": name, "role": role, "notes": list(notes)})


def texts(found, rank):
    return [f.text for f in found.findings if f.rank == rank]


def test_a_good_recording_has_no_finding_but_what_is_told():
    found = checkup([taken()])
    assert texts(found, STOPS) == texts(found, SUSPICIOUS) == []
    assert (len(found.lessons), found.remedies) == (1, ())


def test_several_faults_of_one_recording_are_all_found_in_one_look():
    """A frame that is not finite hides the gap behind it from `learn`, and the gap the bias behind that."""
    f = F + 4.0
    f[150] = np.nan
    kept = np.r_[0:200, 260:400]
    found = checkup([taken(T[kept], X[kept], V[kept], f[kept])])
    stops = texts(found, STOPS)
    assert any("nan" in t for t in stops)
    assert any("gap" in t for t in stops)
    assert any("force at rest is 4" in t for t in texts(found, SUSPICIOUS))
    assert found.remedies == ("--drop-bad", "--split-gaps", "--tare")
    assert found.preparation.drop_bad
    assert found.preparation.split_gaps
    assert [f.rank for f in found.findings] == sorted(f.rank for f in found.findings)


@pytest.mark.parametrize(
    ("spoiled", "said", "remedy"),
    [
        (taken(v=-V), "sign is flipped", LEFT_OUT),
        (taken(x=1e3 * X, v=None), "millimetres", "--position-unit=mm"),
        (taken(x=40.0 * X, v=40.0 * V), "millimetres per second", "--velocity-unit=mm/s"),
        (taken(v=0.7 * V), "is the rate 100 Hz right", LEFT_OUT),
        (taken(v=0.7 * V, notes=["no stamps: frame i is taken to be at i / 100 s"]), "is the rate 100 Hz right", "--rate-hz=70"),
        (taken(f=F + 4.0), "force at rest", "--tare"),
        (taken(T[150:], X[150:], V[150:], F[150:]), "begins in motion", ""),
        (taken(T[:200], X[:200], V[:200], F[:200]), "ends in motion", ""),
        (taken(f=np.interp(T - 0.04, T, F[:, 0])[:, None]), "ms late", "doctor-force"),
        (taken(f=np.clip(F, -9.0, 2.5)), "saturated", ""),
        (taken(f=np.where((T > 1.6)[:, None] & (T < 2.2)[:, None], F[160], F)), "stays exactly still", ""),
        (taken(f=-F, role="follower"), "against the motion", ""),
    ],
)
def test_each_fault_is_named_with_what_mends_it(spoiled, said, remedy):
    found = checkup([spoiled])
    (one,) = [f for f in found.findings if said in f.text][:1]
    assert one.rank in (STOPS, SUSPICIOUS)
    assert one.remedy == remedy


def test_what_a_set_does_not_share_and_copies_and_fragments_are_found():
    few = slice(100, 108)
    others = [taken(f=F + 0.1 * RNG.normal(size=F.shape), name=f"lift {i}") for i in range(3)]
    found = checkup([*others, others[0], taken(T[few], X[few], V[few], F[few], name="bit")])
    said = " | ".join(texts(found, SUSPICIOUS))
    assert "the same lesson twice" in said
    assert "8 frames" in said
    assert "bit: under a fifth" in said


def test_one_fault_of_many_recordings_is_said_once_with_how_many():
    found = checkup([taken(f=F + 4.0 + 0.1 * i, name=f"lift {i}") for i in range(4)])
    said = [t for t in texts(found, SUSPICIOUS) if "force at rest" in t]
    assert len(said) == 1
    assert "and 3 more like it" in said[0]


def test_rest_and_gaps_lie_where_they_are_drawn():
    kept = np.r_[0:200, 260:400]
    found = stretches(taken(T[kept], X[kept], V[kept], F[kept]))
    (gap,) = {(s.start_s, s.stop_s) for s in found if s.kind == "gap"}
    assert gap == pytest.approx((1.99, 2.6))
    rest = [s for s in found if s.kind == "rest"]
    assert rest[0].start_s == 0.0
    assert rest[0].stop_s == pytest.approx(1.1, abs=0.15)
    assert rest[-1].stop_s == pytest.approx(3.99)


def test_columns_are_listed_with_ranges_units_and_what_their_names_suggest(tmp_path):
    (tmp_path / "t.csv").write_text("t,z [mm],Fz,word\n0.0,1,2,a\n0.1,-3,,b\n0.2,5,7,c\n")
    time, z, force, word = listed(look(tmp_path / "t.csv"))
    assert (time.suggests, z.unit, z.low, z.high, z.suggests) == ("--time", "mm", -3.0, 5.0, "--position")
    assert (force.low, force.high, force.bad) == (2.0, 7.0, 1)
    assert word.problem
    np.savez(tmp_path / "t.npz", a=np.arange(5.0))
    assert [(c.name, c.high) for c in listed(look(tmp_path / "t.npz"))] == [("a", 4.0)]


def test_fewer_frames_than_states_can_be_learned_from_get_a_word(lessons):
    """Ten states over six channels from 72 frames: 270 numbers."""
    from dataclasses import replace

    def cut(lesson):
        signals = {n: np.hstack([v, v[::-1]])[100:124] for n, v in lesson.signals.items()}
        return replace(lesson, signals=signals, axes=("x", "z"), signal_axes={})

    short = [cut(x) for x in lessons["leader"][:3]]
    with pytest.warns(UserWarning, match="72 frames for 10 states of 6 channels; least 140.*n_states=5"):
        learned = learn(short)
    assert any("72 frames" in note for note in learned.notes)
