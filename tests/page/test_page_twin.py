"""What runs in the page is what runs in Python."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from comanip.learned import file as skill_file
from comanip.learned.learn import learn
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import demonstrations
from comanip.page.build import SHIPPED, built, compiler_problem
from comanip.page.numbers import constants, numbers, robot
from comanip.skills.baselines import MassDamper
from comanip.tasks import named
from comanip.teaching import teach
from page.node import array, ran
from page.worlds import DT, Rearmed, in_page, in_python, wandering

WITHIN = 1e-9


def same(page, recording, names=("hand.position", "hand.velocity", "hand.sensor_force", "hand.force", "command.velocity")):
    for name in names:
        np.testing.assert_allclose(page[name], recording[name].values, rtol=0.0, atol=WITHIN, err_msg=name)


def test_beam_hand_and_force_estimate_are_those_of_python_along_and_across_the_beam(tmp_path: Path) -> None:
    task = named("pick-carry-place")
    trace = wandering(task, 8.0, np.random.default_rng(1), way=np.array([0.3, 0.1, 0.2]))
    holds = np.ones(len(trace))
    holds[5000:6200] = 0.0
    found = in_page(
        tmp_path, task, trace, holds=holds, numbers=None, robot_kg=6.0, robot_ns_per_m=20.0, v_max_m_per_s=1e3, a_max_m_per_s2=1e9
    )
    skill = MassDamper(n_axes=3, dt=DT, mass_kg=6.0, damping_ns_per_m=20.0)
    recording = in_python(task, trace, holds=holds, skill=skill)
    same(found, recording)
    assert np.ptp(found["hand.position"], axis=0).min() > 0.02


@pytest.mark.parametrize("role", ["leader", "follower", "auto"])
def test_a_skill_in_the_page_moves_as_in_python(role: str, skills: dict[str, LearnedSkill], tmp_path: Path) -> None:
    task = named("lift")
    trace = wandering(task, 15.0, np.random.default_rng(2), way=np.array([0.3]))
    skill = robot(skills, role, dt=DT)
    found = in_page(tmp_path, task, trace, holds=np.ones(len(trace)), numbers=numbers(skill, task))
    recording = in_python(task, trace, holds=np.ones(len(trace)), skill=robot(skills, role, dt=DT))
    same(found, recording)
    np.testing.assert_allclose(found["mode"], recording["skill.mode"].values[:, 0], rtol=0.0, atol=0.0)
    np.testing.assert_allclose(found["tank"], recording["skill.tank"].values[:, 0], rtol=0.0, atol=WITHIN)
    assert np.ptp(found["hand.position"]) > 0.1


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_letting_go_holding_and_going_on_are_those_of_python(role: str, skills: dict[str, LearnedSkill], tmp_path: Path) -> None:
    task = named("lift")
    trace = wandering(task, 10.0, np.random.default_rng(3), way=np.array([0.3]))
    holds = np.ones(len(trace))
    holds[2200:5000] = 0.0  # lets go on the way
    holds[6000] = holds[7000] = -1.0  # asks to go on
    skill = Rearmed(robot(skills, role, dt=DT), {600, 700})
    recording = in_python(task, trace, holds=holds, skill=skill)
    found = in_page(tmp_path, task, trace, holds=holds, numbers=numbers(robot(skills, role, dt=DT), task))
    same(found, recording)
    np.testing.assert_allclose(found["mode"], recording["skill.mode"].values[:, 0], rtol=0.0, atol=0.0)
    assert found["mode"].max() >= 1.0  # it was noticed at all
    assert found["reason"][found["mode"] > 0].min() > 0


def test_a_task_in_the_plane_runs_in_the_page_as_in_python(tmp_path: Path) -> None:
    task = named("round-the-corner")
    lessons = demonstrations(teach("follower", 5, task=task.name, rng=np.random.default_rng(5)), rate_hz=100.0)
    learned = {"follower": learn(lessons, role="follower")}
    path = learned["follower"].paths[0].position
    steps = np.minimum(np.arange(6000) / 4.5e3, 1.0) * (len(path) - 1)
    low = np.minimum(steps.astype(int), len(path) - 2)
    trace = task.start + path[low] + (steps - low)[:, None] * (path[low + 1] - path[low]) - path[0]
    found = in_page(tmp_path, task, trace, holds=np.ones(len(trace)), numbers=numbers(robot(learned, "follower", dt=DT), task))
    same(found, in_python(task, trace, holds=np.ones(len(trace)), skill=robot(learned, "follower", dt=DT)))
    assert np.ptp(found["hand.position"], axis=0).min() > 0.1


def test_a_skill_file_prepared_in_the_page_gives_the_same_numbers(
    skills: dict[str, LearnedSkill], lessons, tmp_path: Path
) -> None:
    task = named("lift")
    natural = learn(demonstrations(teach("natural", 5, rng=np.random.default_rng(8)), rate_hz=100.0), role="natural")
    stiff = learn(lessons["follower"][:5], role="follower", law="even", settings={"anticipation": 0.1, "dead_zone_n": 0.7})
    for n, by_role in enumerate((skills, {**skills, "natural": natural}, {**skills, "follower": stiff})):
        folder = tmp_path / str(n)
        folder.mkdir()
        for role, one in by_role.items():
            skill_file.save(one, folder / f"{role}.json")
        script = """
        const config = { task: { axes: [{ name: "z" }] }, prepare: given.prepare };
        const skills = Object.fromEntries(given.roles.map(role => [role, readSkill(fs.readFileSync(`${given.folder}/${role}.json`, "utf8"), config).content]));
        for (const [role, numbers] of Object.entries(numbersFor(skills, config))) keep(role, numbers);
        """
        prepare = json.loads(json.dumps(constants(task, dt=DT)))
        ran(folder, script, modules={"skillfile": "readSkill, numbersFor"}, prepare=prepare, roles=list(by_role))
        for role in ("leader", "follower", "auto") if n < 2 else ("leader", "follower"):
            np.testing.assert_allclose(
                array(folder, role), numbers(robot(by_role, role, dt=DT), task), rtol=1e-11, atol=1e-12, err_msg=role
            )


def test_numbers_that_are_no_skill_are_refused_and_never_run(skills: dict[str, LearnedSkill], tmp_path: Path) -> None:
    """Every length, and every header number changed: an error, or a robot whose numbers stay finite."""
    task = named("lift")
    block = numbers(robot(skills, "auto", dt=DT), task)
    script = """
    const engine = await Engine.from(fs.readFileSync(given.wasm)), block = array("block"), said = {};
    const tried = numbers => {
      const world = new World(engine);
      world.set({ ...given.world, start: [0.85], gravity: [-9.80665] });
      try { world.skill(numbers).begin(); } catch (error) { engine.wasm.page_free(world.at); return String(error.message).includes("cannot run") ? "refused" : error.message; }
      world.advance(120);
      const fine = Number.isFinite(world.vector("position")[0]);
      engine.wasm.page_free(world.at);
      return fine ? "runs" : "not finite";
    };
    for (let n = 0; n < block.length; n += 37) (said[tried(block.slice(0, n))] ??= []).push(n);
    for (let n = 0; n < given.header; n++) for (const value of [-1, 0.5, 1e9, NaN, Infinity]) { const other = block.slice(); other[n] = value; (said[`header ${tried(other)}`] ??= []).push([n, String(value)]); }
    said.whole = tried(block);
    answer(said);
    """
    from comanip.page.export import ROBOT
    from comanip.page.numbers import HEADER

    world = {**ROBOT, "axes": 1, "mass_kg": 2.0, "stated_mass_kg": 2.0, "length_m": 0.8, "share": 0.5, "seed": 1, "robot": 0, "holds": 1,
             "hand_n_per_m": 150, "hand_ns_per_m": 22, "hand_kg": 1, "hand_cap_n": 30, "grip_n_per_m": 2000, "grip_ns_per_m": 40, "smooth_s": 0.04, "hand_m_per_s": 0.33, "grip_s": 0.15}  # fmt: skip
    said = ran(tmp_path, script, modules={"engine": "Engine, World"}, arrays={"block": block}, header=len(HEADER), world=world)
    assert said["whole"] == "runs"
    assert set(said) <= {"whole", "refused", "header refused", "header runs", "header not finite"}
    structure = {
        HEADER.index(name) for name in ("version", "d", "goals", "states", "heard", "filters", "stations", "most_pulls", "swing")
    }
    ran_anyway = {n for n, _ in said.get("header runs", [])} | {n for n, _ in said.get("header not finite", [])}
    assert not structure & ran_anyway, structure & ran_anyway


def test_what_ships_is_what_its_sources_give() -> None:
    if problem := compiler_problem():
        pytest.skip(problem)
    assert built() == SHIPPED.read_bytes(), "page.wasm differs from its sources: python -m comanip.page.build"
