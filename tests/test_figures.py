"""Numbers behind the figures, what planted defects do to them, and that every drawing becomes a file."""

from __future__ import annotations

import json
import sys
import tomllib
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import forked
from comanip.errors import ParameterError
from comanip.evaluation.claims import at_least, at_most
from comanip.learned.learn import learn
from comanip.lessons.demonstration import Demonstration, demonstrations
from comanip.loop import run
from comanip.plants.replay import ReplayPlant
from comanip.recording import Channel
from comanip.reproduction import make_skill
from comanip.skills.paper import ConfidenceGain, PaperLaw, PaperSkill, PositionGain
from lifts import lift

pytest.importorskip("matplotlib")
from comanip.evaluation import drawing as figures
from comanip.experiments import figure_3, figure_4, figure_5, figure_6, figure_7, planar
from comanip.experiments.lifts import LESSONS, taught
from comanip.experiments.readings import READING
from pictures import is_drawn

ROOT = Path(__file__).parents[1]
QUIET = pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
pytestmark = QUIET


def failed(claims):
    return [c.text for c in claims if not c.passed]


def hit(claims, words):
    """The claims that fail are those that start with `words`, and perhaps others."""
    return any(words in text for text in failed(claims))


@pytest.fixture(scope="module")
def lessons():
    return demonstrations([lift(n, name=f"lift{n}") for n in range(3)])


@pytest.fixture(scope="module")
def plane_lessons():
    rng = np.random.default_rng(0)
    return [
        Demonstration(
            x.name, x.dt, {**x.signals, "force": 20.0 * x.velocity}, x.axes, role="leader", units={**x.units, "force": "N"}
        )
        for x in planar.lessons(figure_3.PATH, 3, 0.005, rng)
    ]


@pytest.mark.parametrize("number", [2, 3, 4, 5, 6, 7])
def test_every_claim_of_a_figure_holds_and_its_picture_is_drawn(number, tmp_path):
    claims = import_module(f"comanip.experiments.figure_{number}").run(tmp_path, seed=0)
    assert failed(claims) == []
    assert all(np.isfinite(c.measured) and c.bound and c.refuted_by for c in claims)
    assert is_drawn(tmp_path / f"figure_{number}.png")


def test_a_pull_of_the_wrong_sign_refutes_figure_3():
    claims = figure_3.claims(figure_3.numbers(0, law=replace(READING, attraction_per_s=-8.0)))
    assert hit(claims, "both terms: mean distance")
    assert hit(claims, "position term alone comes to the path")


def test_lessons_that_vary_alike_refute_figure_4(monkeypatch):
    monkeypatch.setattr(figure_4, "SPREADS_M", {"consistent": 0.012, "variable": 0.012})
    assert hit(figure_4.claims(figure_4.numbers(0)), "2 cm beside the path the consistent model pulls harder")


def test_swapped_roles_refute_figure_5():
    found = figure_5.numbers(0)
    swapped = {"leader": found.lessons["follower"], "follower": found.lessons["leader"]}
    claims = figure_5.claims(found._replace(lessons=swapped))
    assert hit(claims, "the partner works on a following hand")
    assert hit(claims, "a leading hand works on the partner")


def test_a_partner_who_is_a_damper_refutes_figure_6(monkeypatch):
    monkeypatch.setattr(figure_6, "ROLES", ("follower",))
    rng = np.random.default_rng(0)
    shown = taught("follower", 0)[:LESSONS]
    forces = [30.0 * x.velocity + 0.1 * rng.normal(size=x.velocity.shape) for x in shown]
    damped = {"follower": [replace(x, signals={**x.signals, "force": f}) for x, f in zip(shown, forces, strict=True)]}
    claims = figure_6.claims(figure_6.numbers(0, lessons=damped))
    assert hit(claims, "so does its slope")
    assert hit(claims, "robot as follower: variance")


def test_a_hold_stronger_than_the_teacher_waits_for_refutes_figure_7():
    assert hit(figure_7.claims(figure_7.numbers(0, hold_n=12.0)), "under a steady 4 N it stands still")


def test_the_field_is_what_the_skill_asks_for_from_rest():
    skill = learn(planar.lessons(figure_3.PATH, 3, 0.006, np.random.default_rng(1)), n_states=5, law="paper", with_force=False)
    law = replace(READING, weights="mixture", bounded=True)
    box = planar.workspace(figure_3.PATH)
    for start in figure_3.STARTS[:2]:
        plant = ReplayPlant(np.zeros((1, 2)), dt=planar.DT, start_position=np.array(start), axes=planar.AXES)
        runner = PaperSkill(
            skill.model, axes=planar.AXES, dt=planar.DT, model_dt=skill.dt, workspace=box, law=replace(law, bounded=True)
        )
        asked = run(plant, runner, duration_s=planar.DT)["command.velocity"].values[0]
        terms = planar.field(skill, np.array([start]), law)
        np.testing.assert_allclose(asked, (terms.velocity_term + terms.position_term)[0], rtol=1e-9)


def test_the_confidence_gain_is_zero_at_a_centre_and_whole_far_away():
    model = learn(planar.lessons(figure_4.PATH, 5, 0.01, np.random.default_rng(0)), law="paper", with_force=False).model
    gain = ConfidenceGain(model)
    assert gain(model.means[2, :2]) == pytest.approx(0.0, abs=1e-12)
    assert gain(np.array([5.0, 5.0])) == 1.0
    assert PositionGain(model, planar.workspace(figure_4.PATH))(model.means[2, :2] + 0.01) < gain(model.means[2, :2] + 0.01)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_demonstrations_are_drawn_into_every_kind_of_file(lessons, tmp_path, suffix):
    path = figures.save(figures.demonstrations(lessons), tmp_path / "new" / f"lessons{suffix}")
    assert is_drawn(path)


def test_several_axes_and_both_roles_fit_in_one_drawing(plane_lessons, tmp_path):
    others = [replace(x, role="follower") for x in plane_lessons]
    figure = figures.demonstrations([*plane_lessons, *others])
    assert len(figure.axes) == 8
    assert "2 axes" not in figures.to_svg(figure)
    skills = {"a": learn(plane_lessons, n_states=3), "b": learn(others, n_states=3)}
    assert len(figures.skills(skills).axes) == 6
    assert len(figures.to_png_bytes(figures.skills(skills))) > 5_000


def test_a_skill_without_force_is_drawn_in_one_plane(lessons):
    assert len(figures.skills({"blind": learn(lessons, n_states=3, with_force=False)}).axes) == 1


def test_lessons_without_force_are_drawn(lessons):
    blind = [replace(x, signals={n: v for n, v in x.signals.items() if n != "force"}) for x in lessons]
    assert len(figures.demonstrations(blind).axes) == 2


@pytest.mark.parametrize("law", ["default", "paper"])
def test_a_run_is_drawn_with_what_it_holds(lessons, law):
    skill = make_skill(learn(lessons, n_states=4), axes=("z",), dt=0.01, law=law)
    recording = run(ReplayPlant(lessons[0].force, dt=0.01, start_position=lessons[0].position[0]), skill, duration_s=1.0)
    time = recording["hand.position"].time
    tilted = recording.with_channels({"beam.tilt": Channel(time, np.zeros((len(time), 1)), "rad", "task", ("z",))})
    told = tilted.with_metadata(role="follower", partner={"role": "follower", "lift_m": 0.3, "onset_s": 0.1, "duration_s": 0.5})
    assert len(figures.reproduction(recording).axes) == (5 if law == "default" else 4)
    assert len(figures.reproduction(tilted).axes) == (6 if law == "default" else 5)
    assert "partner's plan" in [t.get_text() for t in figures.reproduction(told, title="A run").axes[0].get_legend().get_texts()]


def test_the_same_figure_gives_the_same_file(lessons, tmp_path):
    one, two = (figures.save(figures.demonstrations(lessons), tmp_path / f"{n}.svg").read_bytes() for n in "ab")
    assert one == two


def test_a_suffix_that_cannot_be_drawn_lists_those_that_can(lessons, tmp_path):
    with pytest.raises(ParameterError, match=r"allowed: \.png, \.svg, \.pdf"):
        figures.save(figures.demonstrations(lessons), tmp_path / "lessons.jpg")


def test_nothing_to_draw_is_said():
    with pytest.raises(ParameterError, match="no demonstrations"):
        figures.demonstrations([])
    with pytest.raises(ParameterError, match="no skills"):
        figures.skills({})


def test_without_matplotlib_the_message_says_what_to_install(lessons, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ParameterError, match=r"pip install 'comanip\[plot\]'"):
        figures.demonstrations(lessons)


def test_drawing_leaves_the_settings_of_matplotlib_alone(lessons):
    import matplotlib

    before = dict(matplotlib.rcParams)
    figures.to_svg(figures.demonstrations(lessons))
    assert dict(matplotlib.rcParams) == before


def test_matplotlib_is_known_to_one_module_only():
    files = [*(ROOT / "src").rglob("*.py")]
    users = [f.name for f in files if "import matplotlib" in f.read_text() or "from matplotlib" in f.read_text()]
    assert set(users) - {"mvn.py"} == {"drawing.py"}  # MVN.plot_ellipse draws into the caller's own axes


def test_a_claim_that_is_not_a_number_fails():
    assert not at_most("x", float("nan"), 1.0, refuted_by="y").passed
    assert not at_least("x", float("nan"), 1.0, refuted_by="y").passed


def test_every_package_is_installed():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    source = ROOT / "src"
    here = {".".join(f.parent.relative_to(source).parts) for f in (source / "comanip").rglob("__init__.py")}
    assert sorted(listed) == sorted(here | {"comanip.experiments"})


def command(*arguments):
    return forked.run("figures", *arguments)


def test_the_command_draws_what_was_asked_for(tmp_path, capsys):
    from comanip.commands.figures import figures as command_figures

    command_figures([6], tmp_path, 0, "beam", True)
    result = json.loads(capsys.readouterr().out)
    assert result["passed"] is True
    assert list(result["figures"]) == ["6"]
    assert Path(result["figures"]["6"]["picture"]).exists()


def test_the_command_says_which_claim_fails(tmp_path, monkeypatch, capsys):
    from comanip.commands.figures import figures as command_figures

    monkeypatch.setattr(figure_4, "SPREADS_M", {"consistent": 0.012, "variable": 0.012})
    with pytest.raises(SystemExit, match="1"):
        command_figures([4], tmp_path, 0, "beam", False)
    assert "failed: Fig. 4: 2 cm beside the path" in capsys.readouterr().err


def test_a_number_without_figure_lists_those_there_are(tmp_path):
    done = command("8", "--out", str(tmp_path))
    assert done.returncode == 2
    assert "there is no Fig. 8 to draw; there are: 1, 2, 3, 4, 5, 6, 7" in done.stderr


def test_the_letter_is_the_papers_law():
    from comanip.experiments.readings import LETTER

    assert PaperLaw() == LETTER
