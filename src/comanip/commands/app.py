"""The command line: the only place where parts are chosen by name.

Results go to standard output (with --json as one JSON document), progress and warnings to standard error. Exit code 2 and one
line for input that cannot be used.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from cyclopts import App, CycloptsError, Group, Parameter

from .. import __version__, parts
from . import on_the_page
from .flags import BackendFlags, DataFlags, LearnedLaw, LearnFlags

app = App(
    name="comanip",
    version=__version__,
    help="Teach a robot to handle things together with a person, by demonstration, with force.",
    help_format="plaintext",
)
_DATA = Group(
    "Reading data (learn, evaluate, classify, inspect, convert and doctor-force; reproduce for --force-from)", sort_key=10
)
_LEARN = Group("Learning", sort_key=5)

Data = Annotated[DataFlags, Parameter(name="*", group=_DATA)]
Learning = Annotated[LearnFlags, Parameter(name="*", group=_LEARN)]
Where = Annotated[BackendFlags, Parameter(name="*", group=_LEARN)]
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print the result as one JSON document.")]
Overwrite = Annotated[
    bool, Parameter(negative="", help="Write over files that comanip did not make, and over inputs; both are refused otherwise.")
]
Out = Annotated[Path, Parameter(name=["--out", "-o"])]
if TYPE_CHECKING:
    PlantName: TypeAlias = str
    DeviceName: TypeAlias = str
    ExportTarget: TypeAlias = str
else:  # what there is, from the tables
    PlantName, DeviceName = Literal[tuple(parts.PLANTS)], Literal[tuple(parts.DEVICES)]
    ExportTarget = Literal[tuple(parts.EXPORTS)]
Plant = Annotated[PlantName, Parameter(help="beam: exact and fast; humanoid: in physics, needs mujoco.")]


def main() -> None:
    """Entry point; never a traceback for a mistake in the input."""
    import warnings

    from .ending import ended_by, leave, show_warning

    warnings.showwarning = show_warning
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # workers run no csv.py or signal.py that lies in the user's folder
    leave(ended_by(lambda: app(exit_on_error=False, print_error=False, help_on_error=False), CycloptsError))


@app.command
def learn(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    out: Out = Path("skill.json"),
    data: Data = DataFlags(),
    learning: Learning = LearnFlags(),
    where: Where = BackendFlags(),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Learn a skill from recordings of one role: comanip learn lesson*.csv -o skill.json

    FILES may be .mcap, .csv, .npy, .npz, .mat, .parquet or a folder (of CSV files that belong together, or of LeRobot).
    """
    from ..parallel import backend
    from . import learning as command

    with backend(where.backend, address=where.address):
        command.learn(files, out, data, learning, overwrite, json)


@app.command
def evaluate(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    leave_one_out: Annotated[bool, Parameter(negative="")] = False,
    data: Data = DataFlags(),
    learning: Learning = LearnFlags(),
    json: Json = False,
) -> None:
    """Say how well a skill predicts recordings: comanip evaluate skill.json lesson*.csv

    With --leave-one-out no skill file is given: each recording is predicted by a skill learned from the others.
    One-step velocity: from each frame's position and force. Free run: only the recorded force is given after the first frame.
    """
    from . import learning as command

    command.evaluate(files, leave_one_out, data, learning, json)


@app.command
def classify(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    skill: Annotated[list[Path], Parameter(name="--skill")],
    after_s: Annotated[float | None, Parameter(help="Judge by the first so many seconds alone.")] = None,
    data: Data = DataFlags(),
    json: Json = False,
) -> None:
    """Tell which skill each recording shows: comanip classify run.csv --skill leader.json --skill follower.json

    "neither" takes part: a recording that scores as no unseen lesson of the likeliest skill does shows none of them.
    """
    from . import learning as command

    command.classify(files, skill, after_s, data, json)


@app.command
def inspect(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    plot: Annotated[Path | None, Parameter(help="Draw it into this .png, .svg or .pdf.")] = None,
    data: Data = DataFlags(),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Show what recordings or skill files hold, and make every check that learning makes: comanip inspect lift.csv

    Findings are ranked, with one line of advice that is the next command. Without a mapping the columns of a foreign file are
    listed with their ranges. --plot draws channels, rest, gaps and spectra.
    """
    from . import inspecting as command

    command.inspect(files, plot, data, overwrite, json)


_CONVERT = f"""Rewrite recordings: comanip convert lift.csv lift.mcap --position z --force Fz --rate-hz 100

FILE may be anything that is read, a folder too; OUT ends in {", ".join(parts.written_suffixes())}
({", ".join(parts.holding_several())} hold several recordings).
"""


@app.command(help=_CONVERT)
def convert(file: Path, out: Path, /, *, data: Data = DataFlags(), overwrite: Overwrite = False, json: Json = False) -> None:
    """Rewrite recordings."""
    from . import learning as command

    command.convert(file, out, data, overwrite, json)


@app.command
def recover(
    file: Path,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="The new file; default: NAME.recovered beside it.")] = None,
    json: Json = False,
) -> None:
    """Make a whole file of what a crash, a full disk or damage left of a recording: comanip recover run.live.mcap"""
    from . import recovering as command

    command.recover(file, out, json)


@app.command
def teach(
    *,
    role: Annotated[Literal["leader", "follower", "natural"], Parameter(help="Of the robot; natural: nobody is told one.")],
    task: Annotated[str, Parameter(help=f"{', '.join(parts.TASKS)}; or your own .toml.")] = "lift",
    lessons: int = 5,
    dyad: Annotated[Literal["a", "b", "c"], Parameter(help="Which two people.")] = "a",
    device: Annotated[DeviceName, Parameter(help="What the teacher holds.")] = "ideal",
    delay_ms: Annotated[float, Parameter(help="Round trip between device and robot.")] = 0.0,
    passivity: Annotated[bool, Parameter(negative="", help="Take out the energy that delay makes.")] = False,
    seed: int = 0,
    plant: Plant = "beam",
    out: Out = Path("lessons"),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Record lessons from a simulated teacher on a haptic handle with a simulated partner."""
    from . import running as command

    command.teach(role, task, lessons, dyad, device, delay_ms, passivity, seed, plant, out, overwrite, json)


@app.command
def reproduce(
    skill: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    task: Annotated[str | None, Parameter(help="What is done: a name (comanip tasks), or your own .toml; default lift.")] = None,
    seed: int = 7,
    role: Annotated[
        Literal["leader", "follower", "auto"] | None,
        Parameter(help="auto: the robot is told nothing; give skills of both roles."),
    ] = None,
    law: LearnedLaw | None = None,
    plant: Plant = "beam",
    dt: Annotated[float, Parameter(help="Control period [s].")] = 0.01,
    goal: Annotated[
        int | None,
        Parameter(help="Which of several taught goals, by the number that `learn` said; default: a leader is told the task's."),
    ] = None,
    force_from: Annotated[Path | None, Parameter(help="Replay the force of this recording instead of a partner.")] = None,
    realtime: Annotated[
        bool,
        Parameter(negative="", help="Run on the wall clock; OUT.live.mcap grows with the run."),
    ] = False,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="Keep the run as .mcap or .csv.")] = None,
    plot: Annotated[Path | None, Parameter(help="Draw the run into this .png, .svg or .pdf.")] = None,
    data: Data = DataFlags(),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Let a skill carry the beam with a simulated partner drawn by --seed, and judge what happened."""
    from . import running as command

    command.reproduce(skill, task, seed, role, law, plant, dt, goal, force_from, realtime, out, plot, data, overwrite, json)


@app.command
def run(
    skill: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    robot: Annotated[str, Parameter(help="beam or humanoid (simulated), a preset (fake, crisp, ...), or your robot.toml.")],
    role: Annotated[
        Literal["leader", "follower", "auto"] | None,
        Parameter(help="auto: the robot is told nothing; give skills of both roles."),
    ] = None,
    law: LearnedLaw | None = None,
    task: Annotated[str | None, Parameter(help="What a simulated robot's partner does; default lift.")] = None,
    seed: Annotated[int, Parameter(help="Which partner a simulated robot has.")] = 7,
    shadow: Annotated[bool, Parameter(negative="", help="Compute and record, command nothing.")] = False,
    limit: Annotated[float, Parameter(help="Share of the speed that is allowed, above 0 to 1: 0.1 for a slow start.")] = 1.0,
    preflight_s: Annotated[float, Parameter(help="How long the resting arm is measured before anything moves.")] = 10.0,
    duration_s: Annotated[float | None, Parameter(help="Default: what the partner needs; 60 on an arm.")] = None,
    goal: Annotated[int | None, Parameter(help="Its number, where the lessons had several.")] = None,
    realtime: Annotated[bool, Parameter(negative="", help="Run a simulated robot on the wall clock, too.")] = False,
    yes: Annotated[bool, Parameter(negative="", help="Move a real arm without asking in the terminal.")] = False,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="The take; default ROBOT-ROLE-N.mcap.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Run a skill on a robot, after a pre-flight that must pass: comanip run skill.json --robot robot.toml --role follower

    Space or r goes on after a HOLD, Ctrl-C brakes and keeps the take. No arm was ever tried by us: read docs/robot.md first.
    """
    from . import robots as command

    command.run(
        skill, robot, role, law, task, seed, shadow, limit, preflight_s, duration_s, goal, realtime, yes, out, overwrite, json
    )


@app.command
def export(
    skill: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    to: Annotated[ExportTarget, Parameter(help="c, ctypes, ros2-control: source without Python; page: HTML to lift on.")] = "c",
    role: Annotated[
        Literal["leader", "follower", "auto"] | None,
        Parameter(help="auto: the robot is told nothing; give skills of both roles."),
    ] = None,
    law: LearnedLaw | None = None,
    dt: Annotated[float, Parameter(help="Control period [s] at which it will be called.")] = 0.01,
    goal: Annotated[int | None, Parameter(help="Its number, where the lessons had several.")] = None,
    mass_kg: Annotated[float, Parameter(help="Of the object, where the start does not weigh it.")] = 2.0,
    load_share: Annotated[float, Parameter(help="Share of it that this hand carries.")] = 0.5,
    tare_s: Annotated[float, Parameter(help="How long the resting object is weighed at the start.")] = 0.25,
    force_delay_ms: Annotated[float, Parameter(help="By how much the force sensor comes later than the velocity.")] = 0.0,
    gravity: Annotated[
        str | None, Parameter(help="One number an axis [m/s^2], e.g. 0,0,-9.81; default: down the axis named z.")
    ] = None,
    task: Annotated[str | None, Parameter(help="page: what is carried (comanip tasks), or your own .toml; default lift.")] = None,
    study: Annotated[Path | None, Parameter(help="page: what a study on it compares, .toml (docs/page.md).")] = None,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="Default: the skill's name, here.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write a skill, its envelope and its force estimate as source without Python: comanip export skill.json --to c -o skill.c"""
    from . import exporting as command

    command.export(
        skill, to, out, role, law, dt, goal, mass_kg, load_share, tare_s, force_delay_ms, gravity, task, study, overwrite, json
    )


@app.command
def fake_robot(
    *,
    robot: Annotated[str, Parameter(help="The preset or robot.toml whose wire it speaks.")] = "fake",
    role: Annotated[Literal["leader", "follower", "auto"], Parameter(help="What the robot will be told.")] = "follower",
    task: Annotated[str, Parameter(help="What the person behind it does.")] = "lift",
    seed: int = 7,
    node_hz: Annotated[float, Parameter(help="How often it says and does something.")] = 500.0,
    duration_s: Annotated[float | None, Parameter(help="Default: until Ctrl-C.")] = None,
    loss: Annotated[float, Parameter(help="Share of its messages that never come.")] = 0.0,
    jitter_ms: Annotated[float, Parameter(help="By how much they are late at most.")] = 0.0,
) -> None:
    """Be a robot behind ROS 2's wire: the exact beam with a person, to try `comanip run --robot fake` without an arm."""
    from . import robots as command

    command.fake(robot, role, task, seed, node_hz, duration_s, loss, jitter_ms)


@app.command
def trial(
    *,
    role: Annotated[
        list[Literal["leader", "follower", "auto"]], Parameter(name="--role", help="auto: the robot is told nothing.")
    ] = [
        "leader",
        "follower",
    ],
    partners: int = 200,
    seed: int = 7,
    plant: Plant = "beam",
    law: Annotated[
        list[str],
        Parameter(
            name="--law",
            help=f"{', '.join(parts.LAWS)}; repeatable. Default: default, where there is no --law-from.",
        ),
    ] = [],
    law_from: Annotated[
        list[Path],
        Parameter(
            name="--law-from",
            consume_multiple=True,
            help="Policies of yours beside them: .py, .onnx or a Stable-Baselines3 .zip (docs/gym.md).",
        ),
    ] = [],
    task: Annotated[
        list[str],
        Parameter(
            name="--task", consume_multiple=True, help="Names (comanip tasks), all, or your own .toml; results are then by task."
        ),
    ] = [],
    ablate: Annotated[
        bool, Parameter(negative="", help="Compare the default law with the same law without lessons, and with baselines.")
    ] = False,
    skill: Annotated[list[Path], Parameter(name="--skill", help="Skill files; default: learned now from 5 lessons a role.")] = [],
    partners_from: Annotated[Path | None, Parameter(help="A Python file that implements the Partner socket.")] = None,
    people: Annotated[
        list[str],
        Parameter(
            name="--people",
            consume_multiple=True,
            help="usual, tuning, judging, all, or kinds (comanip people): --partners of each, judged by vibration and time, too.",
        ),
    ] = [],
    misbehaving: Annotated[
        float, Parameter(help="Share of partners who hesitate, reverse, block, let go or change role: safe behaviour counts.")
    ] = 0.2,
    pictures: Annotated[Path | None, Parameter(help="Draw the ten worst runs of each law into this folder.")] = None,
    workers: Annotated[int, Parameter(help="Processes; 0 is one a core.")] = 0,
    where: Where = BackendFlags(),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Try laws on many partners they have never met, in closed loop: success, effort, forces, reasons of failures."""
    from ..parallel import backend
    from . import trying as command

    with backend(where.backend, address=where.address):
        command.trial(
            role,
            partners,
            seed,
            plant,
            law,
            law_from,
            skill,
            partners_from,
            people,
            task,
            ablate,
            misbehaving,
            pictures,
            workers,
            overwrite,
            json,
        )


@app.command
def board(
    folder: Annotated[Path, Parameter(help="Holds files of `comanip trial --json`, also in folders below.")],
    /,
    *,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"], help="A .md or .html; default: markdown, printed.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Gather results of trials into one table, the best law first: comanip board results/ -o board.html"""
    from . import board as command

    command.board(folder, out, overwrite, json)


@app.command
def people(
    name: Annotated[str | None, Parameter(help="A kind to play against a rail; none lists them all.")] = None,
    /,
    *,
    seed: int = 7,
    plot: Annotated[Path | None, Parameter(help="Draw its force and motion into this .png, .svg or .pdf.")] = None,
    json: Json = False,
) -> None:
    """List the kinds of people that robots are tried with, or play one: comanip people tremor --plot tremor.png"""
    from . import people as command

    command.people(name, seed, plot, json)


@app.command
def tasks(
    names: Annotated[list[str], Parameter(help="Names or your own .toml files; default: all that ship.")] = [],
    /,
    *,
    plot: Annotated[Path | None, Parameter(help="Draw them into this .png, .svg or .pdf.")] = None,
    json: Json = False,
) -> None:
    """List tasks, and draw them: comanip tasks --plot tasks.png"""
    from . import tasks as command

    command.tasks(names, plot, json)


app.command(on_the_page.page)
app.command(on_the_page.study)


@app.command
def figures(
    numbers: Annotated[
        list[int], Parameter(help="Which of 1 to 7; default 2 to 7. 1 is rendered: needs mujoco and OSMesa or EGL.")
    ] = [],
    /,
    *,
    out: Out = Path("out/figures"),
    seed: int = 0,
    plant: Annotated[Plant | None, Parameter(help="Where lessons are taught; default the humanoid where mujoco is.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Redraw Figures 2 to 7 of the paper and test their claims as numbers, with pass or fail."""
    from . import figures as command

    command.figures(numbers, out, seed, plant, json, overwrite)


@app.command
def doctor(*, json: Json = False) -> None:
    """Say what is installed here: versions, which kernels run and on which instruction set, which extras are present."""
    from . import doctor as command

    command.doctor(json)


@app.command
def doctor_force(
    files: Annotated[list[Path], Parameter(consume_multiple=True)],
    /,
    *,
    out: Annotated[
        Path | None, Parameter(name=["--out", "-o"], help="Write the clean interaction force as .mcap or .csv.")
    ] = None,
    data: Data = DataFlags(),
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Say what a recording shows of its own force: comanip doctor-force lift.csv -o clean.csv

    Clock of force against motion, bias, and "an admittance M, D, K explains this recording to R² ..."; of a raw force
    (--sensor-force) and of a hand that turns also mass, centre of mass, gravity and the sensor's mount. Each with its
    standard error, or why the motion does not show it.
    """
    from . import identifying as command

    command.doctor_force(files, out, data, overwrite, json)


@app.command
def demo(
    *, out: Out = Path("out"), seed: int = 0, plant: Plant | None = None, overwrite: Overwrite = False, json: Json = False
) -> None:
    """Teach both roles, learn them, collaborate with partners never met, and write one HTML report about it."""
    from . import demo as command

    command.demo(out, seed, plant, overwrite, json)
