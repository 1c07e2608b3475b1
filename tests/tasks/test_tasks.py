"""Tasks as values: those that ship, one's own from a file, files that cannot be used; nothing else has to know of a new one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from comanip import demonstrations, parts
from comanip.commands import trying
from comanip.errors import ParameterError
from comanip.interfaces import STANDARD_GRAVITY
from comanip.tasks import TASKS, draw_lesson, named, read_task, retimed, usual, way
from comanip.teaching import teach
from comanip.trials import draw_case, judge, run_case
from comanip.trials.cases import ROLES

TWELVE = (
    "lift", "lower", "lift-hold-lower", "two-stages", "slide", "round-the-corner", "pick-carry-place", "saw", "crank",
    "two-shelves", "turn", "door",
)  # fmt: skip
RUN_HERE = tuple(name for name in TASKS if not named(name).needs)

OWN = """
name = "over-the-wall"
[axes.side]
start = 0.1
[axes.up]
start = 0.9
up = 1.0
[object]
mass_kg = 1.5
[[phases]]
to = { up = 0.20 }
duration_s = 1.2
[[phases]]
kind = "rest"
duration_s = 0.8
[[phases]]
to = { up = 0.20, side = 0.30 }
duration_s = 1.5
[obstacles.wall]
centre = { side = 0.15, up = 0.0 }
radius_m = 0.1
[lessons]
size_sd_m = 0.01
[partners]
size_m = [0.33, 0.40]
duration_s = [2.4, 5.0]
"""


@pytest.fixture
def own(tmp_path):
    file = tmp_path / "over.toml"
    file.write_text(OWN)
    return file


def test_the_twelve_ship_in_order_and_say_what_they_need():
    assert tuple(TASKS)[:12] == TWELVE
    assert [name for name in TWELVE if named(name).needs] == ["door"]
    for name in TWELVE:
        assert named(name).name == name
        assert named(name).about


@pytest.mark.parametrize("name", RUN_HERE)
def test_the_usual_way_of_each(name):
    """What the file says, measured on the course that is made of it."""
    task = named(name)
    for goal in task.goals or ("",):
        one = way(task, usual(task, goal))
        assert one.course.stop_s - one.course.start_s == pytest.approx(task.moving_s + task.rests_s, abs=0.01)
        assert one.course.end == pytest.approx(task.goals[goal] if goal else one.places[-1], abs=1e-9)
        times = np.linspace(one.course.start_s, one.course.stop_s, 2000)
        moved = one.course.sampled(times)
        lengths = [lever != lever for lever in task.levers_m]  # the size of a task is that of its lengths, where it has any
        assert np.linalg.norm(moved[:, lengths if any(lengths) else slice(None)], axis=1).max() <= task.size_m + 1e-6
        for place in one.places:
            assert np.linalg.norm(moved - place, axis=1).min() < 2e-3
        axes = [one.course.along(i) for i in range(one.course.n_axes)]
        speeds = np.array([[axis.at(t)[1] for axis in axes] for t in times.tolist()])
        np.testing.assert_allclose(np.gradient(moved, times, axis=0)[5:-5], speeds[5:-5], atol=0.02)


def test_known_places():
    corner, crank, saw = (way(named(n), usual(named(n))) for n in ("round-the-corner", "crank", "saw"))
    assert corner.places[-1] == pytest.approx([0.4, 0.4])
    assert np.linalg.norm(corner.places[0] - [0.4, 0.0]) < 0.02
    assert crank.places[:4] == pytest.approx(np.array([[0.12, 0.12], [0.0, 0.24], [-0.12, 0.12], [0.0, 0.0]]), abs=1e-9)
    assert len(crank.places) == 20
    assert saw.places[:, 0].tolist() == pytest.approx([0.25, 0.0] * 5)
    hold = way(named("lift-hold-lower"), usual(named("lift-hold-lower")))
    assert hold.course.at(3.2)[0] == pytest.approx([0.30])
    assert hold.rests.tolist() == [2.0, 0.0]


def test_a_circle_is_round_and_turns_as_often_as_asked():
    task = named("crank")
    course = way(task, usual(task)).course
    moved = course.sampled(np.linspace(course.start_s, course.stop_s, 4000)) - [0.0, 0.12]
    assert np.linalg.norm(moved, axis=1) == pytest.approx(np.full(4000, 0.12), abs=1e-4)
    turned = np.unwrap(np.arctan2(moved[:, 1], moved[:, 0]))
    assert (turned[-1] - turned[0]) / (2.0 * np.pi) == pytest.approx(5.0, abs=1e-6)


def test_a_course_at_other_times_visits_the_same_places():
    task = named("round-the-corner")
    course = way(task, usual(task)).course
    whole = course.stop_s - course.start_s
    there = retimed(course, [(1.0, 2.0, 0.5 * whole), (4.0, 2.0, -0.5 * whole)])
    assert there.at(3.5)[0] == pytest.approx(course.at(course.start_s + 0.5 * whole)[0], abs=1e-6)
    assert there.end == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("name", RUN_HERE)
def test_partners_are_drawn_wider_than_lessons(name):
    task, rng = named(name).in_arcs(), np.random.default_rng(0)
    lessons = [draw_lesson(task, rng) for _ in range(400)]
    cases = [draw_case("follower", rng, task=task) for _ in range(400)]
    assert np.std([c.lift_m for c in cases]) > 1.1 * np.std([d.size_m for d in lessons])
    assert np.std([c.duration_s for c in cases]) > 1.1 * np.std([d.duration_s for d in lessons])
    if task.obstacles:
        for case in cases[:100]:
            times = np.arange(case.course.start_s, case.course.stop_s, 0.02)
            assert task.clearance_m(case.course.sampled(times), case.start_m - task.start) > 0.0


def test_lift_is_drawn_as_it_always_was():
    """Numbers from before tasks were values: the published results rest on them."""
    case = draw_case("follower", np.random.default_rng(7), misbehaving=1.0)
    assert (case.task.name, case.axes, case.start_m.tolist()) == ("lift", ("z",), [0.85])
    assert case.legs[0][0] == case.onset_s
    steady = replace(case, behaviour="steady")
    assert steady.legs == ((case.onset_s, case.duration_s, case.lift_m),)
    assert steady.course.end.tolist() == [case.lift_m]
    assert case.carried.tolist() == [0.5 * case.beam_mass_kg * STANDARD_GRAVITY] == [case.carried_n]


@pytest.mark.parametrize("name", RUN_HERE)
@pytest.mark.parametrize("role", ["leader", "follower", "natural"])
def test_lessons_hold_force_and_honest_spread(name, role):
    task = named(name)
    n = 3 if task.moving_s + task.rests_s < 5.0 else 2  # of what takes long the second tells enough
    lessons = teach(role, n, task=name, rng=np.random.default_rng(2))
    ends, lasted = [], []
    for lesson in lessons:
        assert lesson["hand.position"].axes == task.axes
        assert lesson.metadata["task"] == name
        assert "incomplete" not in lesson.metadata
        hand = lesson["hand.position"].values
        ends.append(hand[-1] - hand[0] - lesson.metadata["end_m"])
        lasted.append(lesson.duration_s)
        force = np.linalg.norm(lesson["hand.true_force"].values, axis=1).max()
        assert 0.8 < force < 30.0
        assert lesson.metadata.get("clearance_m", 1.0) > 0.0
    assert np.abs(ends).max() < 0.06
    assert np.ptp(lasted) > (0.1 if n == 3 else 0.02)
    assert [d.axes for d in demonstrations(lessons, rate_hz=100.0)] == [task.axes] * n


def test_lessons_of_several_goals_go_to_each_of_them():
    lessons = teach("leader", 4, task="two-shelves", rng=np.random.default_rng(0))
    assert [lesson.metadata["goal"] for lesson in lessons] == ["low", "high", "low", "high"]


def test_ones_own_task_is_a_file(own, capsys):
    """Other names of axes, another vertical one: taught, learned and tried, with nothing told to anything else."""
    task = named(own)
    assert (task.axes, task.gravity.tolist()) == (("side", "up"), [0.0, -STANDARD_GRAVITY])
    (lesson,) = teach("follower", 1, task=own, rng=np.random.default_rng(0))
    assert lesson["hand.position"].axes == ("side", "up")
    first = lesson["hand.compensated_force"].values[100]
    assert np.abs(first).max() < 1.5  # the weight is gone, along the axis that the file calls upright
    raw = replace_force(lesson)
    assert np.abs(demonstrations([raw], rate_hz=100.0)[0].force[:20]).max() < 1.5
    trying.trial(["follower"], 3, 7, "beam", ["default"], [], [], None, [], [str(own)], False, 0.0, None, 1, False, True)
    result = json.loads(capsys.readouterr().out)
    assert list(result) == ["over-the-wall", "about"]
    assert result["over-the-wall"]["follower"]["default"]["partners"] == 3
    told = set(result["over-the-wall"]["follower"]["default"])
    assert {"success", "interval", "effort", "time_s", "clearance_m", "vibration_n"} <= told


def replace_force(lesson):
    """Without what eq. (3) has made of F_s already."""
    return type(lesson)({n: c for n, c in lesson.channels.items() if n != "hand.compensated_force"}, lesson.metadata)


def test_a_new_file_in_the_folder_is_found(own, tmp_path):
    assert list(parts._tasks(tmp_path, ("lift",))) == ["over"]


@pytest.mark.parametrize("role", ROLES)
def test_every_misbehaviour_runs_in_d_axes(role):
    """In the plane round the corner: who hesitates stands, who reverses comes back."""
    task = named("round-the-corner")
    for seed in range(2):
        for behaviour in ("hesitates", "reverses", "blocks", "lets go", "changes role"):
            case = replace(draw_case(role, np.random.default_rng(seed), task=task), behaviour=behaviour, event=0.5, onset_s=0.5)
            if case.leads and behaviour == "reverses":
                assert case.course.end == pytest.approx([0.0, 0.0], abs=1e-9)
            if case.leads and behaviour == "hesitates":
                stands = case.course.start_s + case._knots[0][1]
                assert np.abs(case.course.at(stands + 0.5 * case.pause_s)[1]).max() < 1e-6
                assert case.course.end == pytest.approx(case.way.course.end, abs=1e-6)
            recording = run_case(case, Still(2))
            assert np.isfinite(recording["partner.force"].values).all()
            assert judge(case, recording).peak_force_n > 0.0


class Still:
    notice = stop_reason = ""

    def __init__(self, d):
        self.diagnostics = {}

    def reset(self, obs):
        pass

    def step(self, obs, command):
        command.velocity[:] = 0.0


BAD = [
    ("start = 0.1", "start = nan", "axes.side.start: must be a finite number"),
    ("start = 0.1", "beginning = 0.1", "axes.side.beginning: unknown key; there are: kind, start, up"),
    ("start = 0.1", 'kind = "mass"', "axes.side.kind: is 'mass'; allowed: length, angle"),
    ("up = 1.0", 'up = "yes"', "axes.up.up: must be a finite number; got 'yes'"),
    ("up = 1.0", "up = 1.5", "axes.up.up: is 1.5; allowed: >= -1 and <= 1"),
    ("to = { up = 0.20 }", "to = { z = 0.20 }", r"phases\[1\].to.z: unknown axis; this task has: side, up"),
    ("duration_s = 1.2", "", r"phases\[1\].duration_s: is missing"),
    ("duration_s = 1.2", "duration_s = 0", r"phases\[1\].duration_s: is 0; allowed: > 0"),
    ("duration_s = 1.2", "duration_s = true", r"phases\[1\].duration_s: must be a finite number; got True"),
    ("duration_s = 0.8", "duration_s = 0.8\nto = { up = 0.1 }", r"phases\[2\].to: unknown key; there are: kind, duration_s"),
    ('kind = "rest"', 'kind = "nap"', r"phases\[2\].kind: is 'nap'; allowed: move, rest, strokes, circle"),
    ("to = { up = 0.20, side = 0.30 }", "to = { up = 0.05, side = 0.15 }", r"phases\[3\].to: lies inside an obstacle"),
    ("to = { up = 0.20, side = 0.30 }", "overlap_s = 0.3\nto = { side = 0.4 }", r"phases\[3\].overlap_s: needs a move before"),
    ("radius_m = 0.1", "radius_m = 0.16", "obstacles: the start lies inside an obstacle"),
    (
        "centre = { side = 0.15, up = 0.0 }",
        "centre = { side = 0.15, up = 0.25 }",
        "phases: the usual way leads through an obstacle",
    ),
    ("radius_m = 0.1", "radius_m = 0.1\ncolour = 'red'", "obstacles.wall.colour: unknown key"),
    ("mass_kg = 1.5", "mass_kg = 0.0", "object.mass_kg: is 0; allowed: > 0"),
    ("mass_kg = 1.5", 'along = "z"', "object.along: is 'z', an unknown axis; this task has: side, up"),
    ("mass_kg = 1.5", "mass = 1.5", "object.mass: unknown key; there are: mass_kg"),
    ("size_sd_m = 0.01", "size_sd_m = -0.01", "lessons.size_sd_m: is -0.01; allowed: >= 0"),
    ("size_m = [0.33, 0.40]", "size_m = [0.40, 0.33]", r"partners.size_m: must be \[lowest, highest\]"),
    ("size_m = [0.33, 0.40]", "size_m = 0.33", r"partners.size_m: must be \[lowest, highest\]; got 0.33"),
    ("[lessons]", "[goals]\nfar = { side = 0.4 }\n[lessons]", "goals: no phase goes to them"),
    ("[lessons]", "[wishes]\n[lessons]", "wishes: unknown key; there are: name, about"),
    ('name = "over-the-wall"', "name = 3", "name: must be a text; got 3"),
    ("[[phases]]", "[[phases", "not TOML"),
]


@pytest.mark.parametrize(("old", "new", "said"), BAD)
def test_a_bad_file_is_one_line_with_file_and_key(tmp_path, old, new, said):
    file = tmp_path / "bad.toml"
    assert old in OWN
    file.write_text(OWN.replace(old, new, 1))
    with pytest.raises(ParameterError, match=said) as caught:
        read_task(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert "\n" not in str(caught.value)


def test_a_goal_inside_an_obstacle_is_named(tmp_path):
    file = tmp_path / "bad.toml"
    text = OWN.replace("to = { up = 0.20, side = 0.30 }\n", "").replace("[lessons]", "[goals]\nnear = { side = 0.1 }\n[lessons]")
    file.write_text(text)
    with pytest.raises(ParameterError, match=r"bad.toml: goals.near: lies inside an obstacle"):
        read_task(file)


EMPTY = ["", "axes = 3\nphases = 4", "[axes]\nphases = []", "[axes.z]\n", "[axes.z]\n[[phases]]\nkind='rest'\nduration_s=1"]


@pytest.mark.parametrize("text", EMPTY)
def test_files_with_nothing_in_them_are_refused(tmp_path, text):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(ParameterError, match=r"bad\.toml: "):
        read_task(file)


def test_what_cannot_be_run_or_found_is_said(tmp_path):
    two = replace(named("door"), axes_=(*named("door").axes_[1:], replace(named("door").axes_[0], kind="angle")))
    with pytest.raises(ParameterError, match=r"task 'door' cannot be run yet: it needs a plant that turns .* \(yaw, x\)"):
        teach("leader", 1, task=two, rng=np.random.default_rng(0))
    with pytest.raises(ParameterError, match="task 'dance' is unknown; there are: lift, lower"):
        named("dance")
    with pytest.raises(ParameterError, match=r"no\.toml: No such file"):
        named(tmp_path / "no.toml")


def test_the_picture_of_all_twelve():
    from comanip.evaluation import drawing
    from comanip.evaluation.tasks import tasks

    figure = tasks([named(name) for name in TWELVE])
    assert [(ax.get_title(loc="left") or ax.get_title()).split(" (")[0] for ax in figure.axes] == list(TWELVE)
    assert len(drawing.to_png_bytes(figure)) > 20_000
