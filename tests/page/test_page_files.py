"""What the page keeps is what comanip reads, what it judges is what the judge says, and a hostile file is one clear line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from comanip.evaluation.metrics import effort
from comanip.formats import read, write
from comanip.formats.cdr import SCHEMAS
from comanip.interaction import gravity_along
from comanip.learned import file as skill_file
from comanip.learned.learn import learn
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import demonstrations
from comanip.page.numbers import constants, numbers, robot
from comanip.recording import Channel, Recording
from comanip.signals.filters import smooth
from comanip.tasks import named
from comanip.teaching import teach
from comanip.trials.cases import draw_case
from comanip.trials.judging import judge
from comanip.whole_file import digest
from page.node import ran
from page.worlds import DT, in_python

TASK = {
    "name": "lift",
    "mass_kg": 2.0,
    "share": 0.5,
    "gravity": [-9.80665],
    "axes": [{"name": "z", "up": 1, "start": 0.85}],
    "schemas": dict(SCHEMAS),
}
LIFTED = """
const engine = await Engine.from(fs.readFileSync(given.wasm));
const take = seed => {
  const world = new World(engine), kept = { dt: 0.01, start: [0.85] };
  world.set({ ...given.world, seed }).begin();
  for (const name of KEPT) kept[name] = [];
  let ticks = 0;
  const rise = given.rises * (1 + 0.05 * (seed % 3));
  for (let t = 0; t < 4500; t++) {
    const s = Math.min(Math.max((t / 1000 - 1) / 2, 0), 1);
    world.vector("pointer")[0] = 0.85 + rise * s * s * s * (10 + s * (-15 + 6 * s));
    world.advance(1);
    if (world.get("ticks") !== ticks) { ticks = world.get("ticks"); for (const name of KEPT) kept[name].push(Array.from(world.vector(name))); }
  }
  return kept;
};
"""
WORLD = {
    "dt_s": 0.01, "step_s": 0.001, "wrist_stiffness_nm_per_rad": 2000.0, "wrist_damping_nms_per_rad": 29.0, "actuator_lag_s": 0.02,
    "noise_n": 0.2, "bias_n": 0.0, "delay_s": 0.005, "expected_delay_s": 0.01, "v_max_m_per_s": 0.8, "a_max_m_per_s2": 10.0,
    "hand_n_per_m": 150.0, "hand_ns_per_m": 22.0, "hand_kg": 1.0, "hand_cap_n": 30.0, "grip_n_per_m": 2000.0, "grip_ns_per_m": 40.0,
    "smooth_s": 0.04, "hand_m_per_s": 0.33, "grip_s": 0.15, "axes": 1, "mass_kg": 2.0, "stated_mass_kg": 2.0, "length_m": 0.8, "share": 0.5, "robot": 1,
    "robot_kg": 4.0, "robot_ns_per_m": 15.0, "holds": 1, "gravity": [-9.80665], "axial": [0.0], "start": [0.85],
}  # fmt: skip


def test_lessons_kept_as_csv_and_mcap_are_equal_and_are_learned_from(tmp_path: Path) -> None:
    script = LIFTED + """
    for (const seed of [1, 2, 3, 4, 5]) {
      const about = { name: `follower-${seed} "<b>ä</b>"`, role: "follower", lesson: seed }, kept = take(seed);
      fs.writeFileSync(`${given.folder}/${seed}.csv`, recordingCsv(given.task, kept, about));
      fs.writeFileSync(`${given.folder}/${seed}.mcap`, recordingMcap(given.task, kept, about));
    }
    """  # fmt: skip
    modules = {"engine": "Engine, World", "session": "KEPT", "recordings": "recordingCsv", "mcap": "recordingMcap"}
    ran(tmp_path, script, modules=modules, task=TASK, world=WORLD, rises=0.3)
    lessons = []
    for seed in range(1, 6):
        (one,), (other,) = read(tmp_path / f"{seed}.csv"), read(tmp_path / f"{seed}.mcap")
        assert {**one.metadata, "source": ""} == {**other.metadata, "source": ""}
        assert one.metadata["name"] == f'follower-{seed} "<b>ä</b>"'
        for name in one.channels:
            np.testing.assert_allclose(one[name].values, other[name].values, rtol=0.0, atol=0.0)
            np.testing.assert_allclose(one[name].time, other[name].time, rtol=0.0, atol=1e-9)
        lessons.append(one)
    found = demonstrations(lessons, rate_hz=100.0)
    learned = learn(found)
    assert learned.role == "follower"
    assert 0.25 < float(np.ptp(learned.paths[0].position)) < 0.36
    assert np.abs(found[0].force).max() < 15.0  # eq. (3) was applied: the weight is gone


def test_the_page_judges_as_the_judge_does(skills: dict[str, LearnedSkill], tmp_path: Path) -> None:
    task, case = named("lift"), draw_case("leader", np.random.default_rng(0))
    trace = np.full((9000, 1), 0.85)
    t = np.arange(9000) * 1e-3
    s = np.clip((t - 1.0) / 2.2, 0.0, 1.0)
    trace[:, 0] += 0.29 * s**3 * (10 + s * (-15 + 6 * s))
    recording = in_python(task, trace, holds=np.ones(len(trace)), skill=robot(skills, "leader", dt=DT))
    expected = judge(case, recording, start_m=task.start, taught_ends_m=skills["leader"].ends)
    names = {
        "position": "hand.position",
        "velocity": "hand.velocity",
        "force": "hand.true_force",
        "true_force": "hand.true_force",
        "tilt": "beam.tilt",
    }
    take = {"dt": DT, "start": task.start.tolist(), **{key: recording[name].values.tolist() for key, name in names.items()}}
    ends = (skills["leader"].ends - task.start).tolist()
    found = ran(
        tmp_path,
        "answer(judged(given.take, { ends: given.ends, goal: null, starts: true }));",
        modules={"judge": "judged"},
        take=take,
        ends=ends,
    )
    for ours, name in (
        ("effort_n2s", "effort_n2s"),
        ("peak_n", "peak_force_n"),
        ("residual_n", "residual_force_n"),
        ("tilt_deg", "tilt_deg"),
        ("ripple_m_per_s", "ripple_m_per_s"),
        ("end_error_m", "end_error_m"),
    ):
        assert found[ours] == pytest.approx(abs(getattr(expected, name)), rel=1e-6, abs=1e-9), ours
    assert found["effort_n2s"] == pytest.approx(effort(smooth(recording["hand.true_force"].values, DT, 15.0), DT), rel=1e-9)
    assert (not found["failures"]) == expected.success


OPEN = """
const said = [];
for (const name of given.files) {
  const bytes = new Uint8Array(fs.readFileSync(`${given.folder}/${name}`));
  try {
    const recording = name.endsWith(".mcap") ? readMcap(bytes) : readCsv(new TextDecoder().decode(bytes)), lesson = lessonOf(recording, given.task);
    const cut = within(recording, lesson.time[20], lesson.time[119]);
    fs.writeFileSync(`${given.folder}/again-${name}.csv`, csvOf(recording));
    fs.writeFileSync(`${given.folder}/again-${name}.mcap`, mcapOf(recording, given.task.schemas));
    fs.writeFileSync(`${given.folder}/cut-${name}.csv`, csvOf(cut));
    said.push(["taken", lesson.role, lesson.take.position.length, lesson.take.dt]);
  } catch (error) { said.push([error.constructor.name, error.message]); }
}
answer(said);
"""
OPENS = {"recordings": "csvOf, lessonOf, readCsv, within", "mcap": "mcapOf, readMcap"}


def thinned(recording: Recording, stride: int = 5) -> Recording:
    """Every fifth frame of a lesson: files are as good, and read in a fifth of the time."""
    of = {n: Channel(c.time[::stride], c.values[::stride], c.unit, c.frame, c.axes) for n, c in recording.channels.items()}
    return Recording(of, recording.metadata)


def test_lessons_of_comanip_are_opened_trimmed_and_kept_with_nothing_lost(tmp_path: Path) -> None:
    recording = thinned(teach("leader", 1, rng=np.random.default_rng(3))[0]).with_metadata(
        note="<img src=x onerror=alert(1)> ä\u2028"
    )
    slow = recording["hand.position"]
    mixed = Recording(
        {**recording.channels, 'camera, "x"': Channel(slow.time[::7], slow.values[::7], "m", "room", slow.axes)},
        recording.metadata,
    )
    write(mixed, tmp_path / "one.csv")
    found = ran(tmp_path, OPEN, modules=OPENS, task=TASK, files=["one.csv"])
    assert found[0][:3] == ["taken", "leader", len(slow.time)]
    for again in ("again-one.csv.csv", "again-one.csv.mcap"):
        (same,) = read(tmp_path / again)
        assert same.metadata["note"] == recording.metadata["note"]
        assert set(same.channels) == set(mixed.channels)
        for name, channel in mixed.channels.items():
            np.testing.assert_allclose(same[name].values, channel.values, rtol=0.0, atol=0.0)
            np.testing.assert_allclose(same[name].time, channel.time, rtol=0.0, atol=1e-9)
            assert (same[name].unit, same[name].frame, same[name].axes) == (channel.unit, channel.frame, channel.axes)
    (cut,) = read(tmp_path / "cut-one.csv.csv")
    assert cut["hand.position"].time.tolist() == slow.time[20:120].tolist()
    found = ran(tmp_path, OPEN, modules=OPENS, task=TASK, files=["again-one.csv.mcap"])
    assert found[0][:3] == ["taken", "leader", len(slow.time)]


def test_what_is_no_lesson_is_one_clear_line(tmp_path: Path) -> None:
    recording = thinned(teach("leader", 1, rng=np.random.default_rng(3))[0])
    write(recording, tmp_path / "fine.csv")
    write(recording, tmp_path / "packed.mcap")
    fine, packed, nasty = (
        (tmp_path / "fine.csv").read_text(),
        (tmp_path / "packed.mcap").read_bytes(),
        "<img src=x onerror=alert(1)>",
    )
    unsigned = "\n".join([line for n, line in enumerate(fine.split("\n")) if n != 1])
    place = recording["hand.position"]
    write(
        Recording({**recording.channels, "hand.position": Channel(place.time, place.values * 1e3, "mm", "task", place.axes)}, {}),
        tmp_path / "mm.csv",
    )
    write(Recording({"hand.position": place}, {}), tmp_path / "bare.csv")
    wrong: dict[str, tuple[bytes, str]] = {
        "table.csv": (f"time,{nasty}\n0,1\n".encode(), "no recording of comanip"),
        "digit.csv": (fine.replace("0.85", "0.86", 1).encode(), "checksum"),
        "head.csv": (unsigned.replace('"channels"', nasty, 1).encode(), "damaged comanip header"),
        "cell.csv": (unsigned.replace("\n0.005,", f"\n{nasty},", 1).encode(), "is not a number"),
        "cut.csv": (unsigned[: len(unsigned) // 2].encode(), "cells, want"),
        "proto.csv": (unsigned.replace('"metadata": {', '"metadata": {"__proto__": {"polluted": 1}, ', 1).encode(), ""),
        "mm.csv": ((tmp_path / "mm.csv").read_bytes(), "want m"),
        "bare.csv": ((tmp_path / "bare.csv").read_bytes(), "no force"),
        "packed.mcap": (packed, "convert"),
        "cut.mcap": (packed[:900], "cut short|convert"),
        "none.mcap": (nasty.encode() * 9, "no MCAP"),
    }  # fmt: skip
    for name, (content, _) in wrong.items():
        (tmp_path / name).write_bytes(content)
    found = ran(tmp_path, OPEN, modules=OPENS, task=TASK, files=list(wrong))
    for (name, (_, says)), (kind, *rest) in zip(wrong.items(), found, strict=True):
        if not says:
            assert kind == "taken", (name, rest)
            continue
        assert kind == "Error", (name, kind, rest)
        assert re.search(says, rest[0]), (name, rest)
        assert "\n" not in rest[0], name
        assert len(rest[0]) < 300, name


def damaged(good: dict) -> dict[str, str]:
    """Files that are no skill of ours, by what is wrong; texts that want to be markup stand in all of them."""
    nasty = "<img src=x onerror=alert(1)>"
    signed = lambda content: json.dumps({**content, "sha256": digest(content)})  # noqa: E731
    other = {key: value for key, value in good.items() if key != "sha256"}
    return {
        "no JSON": "{" + nasty,
        "another format": json.dumps({"format": nasty}),
        "edited by hand": json.dumps({**good, "role": "follower" if good["role"] == "leader" else "leader"}),
        "a stray field": signed({**other, nasty: 1}),
        "a prototype": json.dumps(good)[:-1] + ', "__proto__": {"polluted": true}}',
        "a field twice": json.dumps(good)[:-1] + ', "role": "x"}',
        "a newer version": signed({**other, "version": 4}),
        "other axes": signed({**other, "axes": [nasty]}),
        "no number": signed({**other, "workspace_m": [[nasty, 1]]}),
        "a period of nothing": signed({**other, "dt_s": 1e-300}),
        "a huge number": json.dumps(good).replace('"dt_s": 0.01', '"dt_s": 1e999'),
        "deep": "[" * 100000,
        "an unknown law": signed({**other, "law": nasty}),
        "a setting that is text": signed({**other, "settings": {"anticipation": nasty}}),
        "no path": signed({**other, "paths": []}),
        "a path of text": signed({**other, "paths": [{**other["paths"][0], "spread_m": nasty}]}),
        "a model of text": signed({**other, "model": {**other["model"], "means": nasty}}),
        "no covariance": signed(
            {**other, "model": {**other["model"], "covariances": [[[0.0] * 3] * 3] * len(other["model"]["means"])}}
        ),
    }


def test_hostile_skill_files_are_one_line_and_a_good_one_with_markup_for_names_is_data(
    skills: dict[str, LearnedSkill], tmp_path: Path
) -> None:
    good = skill_file.to_json(skills["leader"])
    bad = damaged(good)
    fine = {
        **{k: v for k, v in good.items() if k != "sha256"},
        "provenance": {"name": "<script>alert(1)</script>", "note": "\u2028ä😀\x7f"},
    }
    skill_file.from_json(fine | {"sha256": digest(fine)})
    for number, text in enumerate(bad.values()):
        (tmp_path / f"{number}.json").write_text(text)
    (tmp_path / "fine.json").write_text(json.dumps(fine | {"sha256": digest(fine)}))
    script = """
    const config = { task: { axes: [{ name: "z" }] }, prepare: given.prepare }, said = [];
    const open = name => { const one = readSkill(fs.readFileSync(`${given.folder}/${name}.json`, "utf8"), config); return one.numbers({ [one.content.role]: one.content }).leader.length; };
    for (let n = 0; n < given.count; n++) { try { said.push([n, "taken", open(n)]); } catch (error) { said.push([n, error.constructor.name, error.message]); } }
    answer({ said, fine: open("fine"), polluted: {}.polluted ?? null });
    """
    found = ran(
        tmp_path,
        script,
        modules={"skillfile": "readSkill"},
        count=len(bad),
        prepare=json.loads(json.dumps(constants(named("lift"), dt=DT))),
    )
    for (_, kind, text), name in zip(found["said"], bad, strict=True):
        assert kind == "Error", (name, kind, text)
        assert "\n" not in text, (name, text)
        assert len(text) < 300, (name, text)
    assert found["polluted"] is None
    assert found["fine"] == len(numbers(robot({"leader": skills["leader"]}, "leader", dt=DT), named("lift")))
    assert gravity_along(("z",))[0] == TASK["gravity"][0]
