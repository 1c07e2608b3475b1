"""Drawings: the only module that knows matplotlib, and only its object-oriented half.

Everything returns a Figure; `save`, `to_svg` and `to_png_bytes` turn it into a file or text. Leader is always dark and solid,
follower always light and dashed, so that a drawing survives a grey printer. The caption says what would refute the picture.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from ..learned.skill import LearnedSkill
from ..lessons.demonstration import Demonstration
from ..models.gaussian import marginal
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..recording import Recording
from ..whole_file import write_whole
from .shown import for_drawing

SUFFIXES = (".png", ".svg", ".pdf")
DPI = 160
SIGNATURE = "comanip"

# five colours that also differ in lightness, darkest first; used in this order
INK, CLAY, SEA, SAND, ASH = "#14213d", "#c8553d", "#2a9d8f", "#e9b44c", "#9aa0a6"
COLOURS = (INK, CLAY, SEA, SAND, ASH)
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (9, 2)))

ROLE_STYLE: Mapping[str, Mapping[str, Any]] = {
    "leader": {"color": INK, "linestyle": "-"},
    "follower": {"color": "#e07a3f", "linestyle": (0, (5, 1.4))},
    "": {"color": "#5c6770", "linestyle": "-"},
}

_TASTE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e8ea",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 2.6,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "figure.facecolor": "white",
    "svg.hashsalt": "comanip",  # the same numbers give the same file
}
_CAPTION_SIZE = 7.5  # [pt]
_LETTER_IN = 0.0555  # width of an average letter of a caption [in]
_LINE_IN = 0.145
_TITLE_LETTER_IN = 0.094  # of a bold title; 0.087 is the average, and a title of capitals must fit too
_TITLE_LINE_IN = 0.2


@contextmanager
def taste() -> Iterator[None]:
    """One look for everything drawn inside; the caller's matplotlib settings stay as they were."""
    try:
        import matplotlib
    except ImportError:
        raise ParameterError("drawing needs matplotlib: pip install 'comanip[plot]'") from None
    with matplotlib.rc_context(_TASTE):
        yield


def blank(width_in: float, height_in: float, *, title: str = "", legend: Sequence[Any] = (), caption: str = "") -> Any:
    """An empty Figure with room for title and caption, wrapped, and legend (handles); call it inside `taste()` and add axes.

    The legend stands above all panels, where it hides nothing and moves nothing.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ParameterError("drawing needs matplotlib: pip install 'comanip[plot]'") from None
    lines = textwrap.wrap(for_drawing(caption), int(width_in / _LETTER_IN)) if caption else []
    heads = textwrap.wrap(for_drawing(title), int(width_in / _TITLE_LETTER_IN)) if title else []
    below = (len(lines) * _LINE_IN + 0.14) if lines else 0.0
    titled = len(heads) * _TITLE_LINE_IN + 0.12 if heads else 0.0
    above = titled + (0.26 if legend else 0.0)
    whole = height_in + below + above
    figure = Figure(figsize=(width_in, whole), layout="constrained")
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0.0, below / whole, 1.0, height_in / whole), w_pad=0.06, h_pad=0.05, wspace=0.03, hspace=0.03)
    if heads:
        figure.text(
            0.06 / width_in, 1.0 - 0.09 / whole, "\n".join(heads), fontsize=10.5, fontweight="bold", va="top", linespacing=1.25
        )
    if legend:
        top = 1.0 - (titled + 0.02 if heads else 0.04) / whole
        figure.legend(handles=legend, loc="upper left", bbox_to_anchor=(0.0, top), ncols=len(legend), borderaxespad=0.0)
    if lines:
        figure.text(
            0.06 / width_in,
            0.07 / whole,
            "\n".join(lines),
            fontsize=_CAPTION_SIZE,
            va="bottom",
            color="#3c4650",
            linespacing=1.25,
        )
    return figure


def demonstrations(lessons: Sequence[Demonstration]) -> Any:
    """Position, velocity and force over time, and force against velocity; one row a task axis. Returns a Figure."""
    lessons = list(lessons)
    if not lessons:
        raise ParameterError("no demonstrations to draw; give at least one")
    axes_names = lessons[0].axes
    with_force = all("force" in lesson.signals for lesson in lessons)
    panels = ["position", "velocity", *(["force", "force-velocity"] if with_force else [])]
    caption = f"{_counted(lessons)}. Points mark where each begins."
    if with_force:
        caption += (
            " F is the partner's force on the hand without the object's weight and inertia. Refuted as one task in one role if "
            "the lessons do not overlap after a shift in time; as a constant damping if force against velocity is a loop or a "
            "curve instead of one straight line."
        )
    with taste():
        square = len(axes_names) == 1
        shape = (2, len(panels) // 2) if square else (len(axes_names), len(panels))
        size = (7.2, 4.6) if square and with_force else (7.2, 2.6) if square else (2.7 * shape[1], 2.1 * shape[0])
        if square and not with_force:
            shape = (1, 2)
        figure = blank(*size, legend=roles_legend([lesson.role for lesson in lessons]), caption=caption)
        grid = figure.subplots(*shape, squeeze=False)
        for i, name in enumerate(axes_names):
            row = grid.ravel() if square else grid[i]
            for panel, ax in zip(panels, row, strict=True):
                _draw_lessons(ax, lessons, panel, i, "" if square else f" {name}")
    return figure


def _counted(lessons: Sequence[Demonstration]) -> str:
    roles = [lesson.role for lesson in lessons]
    parts = [f"{roles.count(r)} {'as ' + r if r else 'of unstated role'}" for r in dict.fromkeys(roles)]
    return f"{len(lessons)} demonstration{'s' if len(lessons) > 1 else ''} ({', '.join(parts)})"


def _unit(units: Mapping[str, str], group: str, i: int) -> str:
    """ "[m]", "[rad/s]", "F [N]": the axis' own unit, where a group has one an axis ("m,m,rad"), else the group's."""
    stated = [u.strip() for u in (units.get(group) or _USUAL[group]).split(",")]
    unit = stated[i] if i < len(stated) > 1 else stated[0]
    return f"F [{unit}]" if group == "force" else f"[{unit}]"


_USUAL = {"position": "m", "velocity": "m/s", "force": "N"}


def _draw_lessons(ax: Any, lessons: Sequence[Demonstration], panel: str, i: int, axis: str) -> None:
    units = lessons[0].units
    for lesson in lessons:
        style = {**ROLE_STYLE.get(lesson.role, ROLE_STYLE[""]), "linewidth": 1.1}
        if panel == "force-velocity":
            x, y = lesson.velocity[:, i], lesson.force[:, i]
        else:
            x, y = np.asarray(np.arange(len(lesson)) * lesson.dt), lesson[panel][:, i]
        ax.plot(x, y, **style)
        ax.plot(x[0], y[0], "o", color=style["color"], markersize=3)
    if panel == "force-velocity":
        label(ax, f"velocity{axis} {_unit(units, 'velocity', i)}", f"force{axis} {_unit(units, 'force', i)}")
        ax.axhline(0.0, color=ASH, linewidth=0.7, zorder=0)
        ax.axvline(0.0, color=ASH, linewidth=0.7, zorder=0)
    else:
        label(ax, "time [s]", f"{panel}{axis} {_unit(units, panel, i)}")


def roles_legend(roles: Sequence[str]) -> list[Any]:
    """Handles that name the roles among `roles`, each once."""
    names = {"leader": "robot leads", "follower": "robot follows", "natural": "nobody was told a role"}
    return [line(label=names.get(r) or for_drawing(r), **ROLE_STYLE.get(r, ROLE_STYLE[""])) for r in dict.fromkeys(roles) if r]


def label(ax: Any, x: str, y: str, title: str = "") -> None:
    ax.set_xlabel(for_drawing(x))
    ax.set_ylabel(for_drawing(y))
    if title:
        ax.set_title(for_drawing(title))


def line(**style: Any) -> Any:
    """A handle for a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **style)


def skills(named: Mapping[str, LearnedSkill]) -> Any:
    """The states of each skill as ellipses in three planes, numbered in order of time; one row a task axis. Returns a Figure."""
    if not named:
        raise ParameterError("no skills to draw; give at least one")
    skill_list = list(named.values())
    axes_names = skill_list[0].axes
    if any(s.axes != axes_names for s in skill_list):
        raise ParameterError(f"skills of different axes cannot share a drawing: {[list(s.axes) for s in skill_list]}")
    planes = [("position", "velocity")]
    if all(s.has_force for s in skill_list):
        planes = [("velocity", "force"), ("position", "velocity"), ("position", "force")]
    styles = _skill_styles(named)
    caption = (
        "; ".join(f"{n}: {s.model.n_states} states, {s.role or 'role not stated'}" for n, s in named.items())
        + ". Each ellipse holds 86 % of its state (2 standard deviations); numbers follow time. A tilted ellipse is a "
        "correlation that the regression uses. Refuted if lessons of one role run outside its ellipses, or if numbers jump "
        "back and forth along position."
    )
    with taste():
        handles = [line(label=for_drawing(n), **styles[n]) for n in named]
        width = 2.9 * len(planes) if len(planes) > 1 else 4.6
        figure = blank(width, 2.8 * len(axes_names), legend=handles, caption=caption)
        grid = figure.subplots(len(axes_names), len(planes), squeeze=False)
        for i, axis in enumerate(axes_names):
            for (a, b), ax in zip(planes, grid[i], strict=True):
                for name, skill in named.items():
                    ellipses(ax, skill.model, f"{a}.{axis}", f"{b}.{axis}", **styles[name])
                suffix = "" if len(axes_names) == 1 else f" {axis}"
                label(ax, *(f"{g}{suffix} {_unit(skill_list[0].units, g, i)}" for g in (a, b)))
    return figure


def _skill_styles(named: Mapping[str, LearnedSkill]) -> dict[str, Mapping[str, Any]]:
    """By role while each role appears once, else by order."""
    roles = [s.role for s in named.values()]
    if len(set(roles)) == len(roles):
        return {n: ROLE_STYLE.get(s.role, ROLE_STYLE[""]) for n, s in named.items()}
    return {n: {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[i % len(DASHES)]} for i, n in enumerate(named)}


def ellipses(
    ax: Any,
    model: Hmm | Gmm,
    x: str,
    y: str,
    *,
    color: str = INK,
    linestyle: Any = "-",
    deviations: float = 2.0,
    numbers: bool = True,
    alpha: float = 0.13,
) -> None:
    """The Gaussians of `model` over the channels x and y, each at `deviations` standard deviations, numbered from 1."""
    from matplotlib.patches import Ellipse

    means, covariances = marginal(model.means, model.covariances, [model.channels.index(x), model.channels.index(y)])
    for k, (mu, sigma) in enumerate(zip(means, covariances, strict=True)):
        values, vectors = np.linalg.eigh(sigma)
        width, height = 2.0 * deviations * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        common = {"xy": tuple(mu), "width": width, "height": height, "angle": angle}
        ax.add_patch(Ellipse(**common, facecolor=color, edgecolor="none", alpha=alpha))
        ax.add_patch(Ellipse(**common, facecolor="none", edgecolor=color, linestyle=linestyle, linewidth=1.1))
        if numbers:
            ax.annotate(
                str(k + 1),
                mu,
                ha="center",
                va="center",
                fontsize=7,
                color="white",
                bbox={"boxstyle": "circle,pad=0.18", "facecolor": color, "edgecolor": "white", "linewidth": 0.5},
            )
    ax.autoscale_view()


def reproduction(recording: Recording, *, title: str = "") -> Any:
    """One run over time: position, velocity, force as felt and as it was, weights or phase, tilt. Returns a Figure."""
    hand = recording["hand.position"]
    names, t0 = hand.axes, float(hand.time[0])
    thought = "skill.weights" if "skill.weights" in recording else ""
    below = [n for n in (thought, "skill.role", "skill.phase", "beam.tilt") if n and n in recording]
    rows = ["position", "velocity", *(["force"] if _has_force(recording) else []), *below]
    role, reason = str(recording.metadata.get("role", "")), str(recording.metadata.get("stop_reason", ""))
    caption = (
        (f"{_AS.get(role, f'Robot as {role}')}. " if role else "")
        + (f"Ended by: {_ENDS.get(reason, reason)}. " if reason else "")
        + (f"Said by the skill: {recording.metadata['notice']}. " if recording.metadata.get("notice") else "")
        + "Refuted as collaboration if force stays after motion has ended, if position misses the goal, or if the object tilts."
    )
    with taste():
        width = 7.2 if len(names) == 1 else 2.6 * len(names) + _LEGEND_IN
        figure = blank(width, 1.35 * len(rows) + 0.3, title=title, caption=caption)
        grid = figure.add_gridspec(len(rows), len(names))
        first: Any = None
        for r, row in enumerate(rows):
            columns = range(len(names)) if row in _USUAL else [slice(None)]
            for c in columns:
                ax = figure.add_subplot(grid[r, c], sharex=first)
                first = first or ax
                if row in _USUAL:
                    _draw_run(ax, recording, row, int(c), t0)  # type: ignore[arg-type]
                else:
                    _draw_thought(ax, recording, row, t0)
                narrow = len(names) > 1 and row in _USUAL and (r + 1 == len(rows) or rows[r + 1] not in _USUAL)
                ax.tick_params(labelbottom=narrow or r == len(rows) - 1)  # numbers under the last row of each width
                if r == len(rows) - 1:
                    ax.set_xlabel("time [s]")
        figure.align_ylabels()
        first.set_xlim(0.0, float(hand.time[-1]) - t0)
    return figure


def _has_force(recording: Recording) -> bool:
    return "hand.force" in recording or "hand.true_force" in recording


_AS = {"auto": "Robot told nothing", "leader": "Robot leads", "follower": "Robot follows"}
_ENDS = {"duration": "the time given was over", "interrupted": "Ctrl-C: the run is cut"}
_LEGEND_IN = 1.5


def _draw_run(ax: Any, recording: Recording, row: str, c: int, t0: float) -> None:
    """One axis of a signal; the legend stands once a row, beside its last axis, where it takes room from none."""
    hand = recording["hand.position"]
    several = len(hand.axes) > 1
    drawn: dict[str, tuple[tuple[str, str, Mapping[str, Any]], ...]] = {
        "position": (
            ("partner.position", "partner's end", {"color": SAND, "linestyle": DASHES[1], "linewidth": 2.0}),
            ("hand.position", "hand", {"color": INK}),
        ),
        "velocity": (
            ("command.velocity", "commanded", {"color": SAND, "linestyle": "-", "linewidth": 2.4}),
            ("hand.velocity", "hand", {"color": INK}),
        ),
        "force": (
            ("hand.true_force", "true", {"color": SAND, "linestyle": "-", "linewidth": 2.4}),
            ("hand.force", "felt by the skill", {"color": INK, "linewidth": 1.0}),
            ("skill.expected_force", "expected", {"color": CLAY, "linestyle": DASHES[1]}),
        ),
    }
    for name, text, style in drawn[row]:
        if name in recording and recording[name].values.shape[1] > c:
            channel = recording[name]
            ax.plot(channel.time - t0, channel.values[:, c], label=text, **style)
    if row == "position":
        _draw_goal(ax, recording, c, t0)
    else:
        ax.axhline(0.0, color=ASH, linewidth=0.7, zorder=0)
    units = {row: next((recording[name].unit for name, _, _ in drawn[row] if name in recording), "")}
    axis = f" {for_drawing(hand.axes[c])}" if several else ""
    ax.set_ylabel(f"{row}{axis}\n{for_drawing(_unit(units, row, c))}")
    if c == len(hand.axes) - 1:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_goal(ax: Any, recording: Recording, c: int, t0: float) -> None:
    """Where a leading partner means to be, when the run says so: by a plan, or, of one axis, by how far, when and how long."""
    from ..people.partners import minimum_jerk

    hand = recording["hand.position"]
    partner = recording.metadata.get("partner")
    time, start = np.asarray(hand.time - t0), float(hand.values[0, c])
    if isinstance(plan := recording.metadata.get("plan"), Mapping):
        meant = np.interp(time, plan["time_s"], np.asarray(plan["displacement_m"])[:, c])
        ax.plot(time, start + meant, color=CLAY, linestyle=DASHES[2], label="partner's plan")
        return
    if not isinstance(partner, Mapping) or partner.get("role", recording.metadata.get("role")) != "follower":
        return
    if "lift_m" not in partner or len(hand.axes) > 1:
        return
    onset, duration = float(partner.get("onset_s", 0.0)), float(partner.get("duration_s", 0.0))
    share = np.array([minimum_jerk((t - onset) / duration)[0] if duration > 0.0 else 1.0 for t in time])
    ax.plot(time, start + float(partner["lift_m"]) * share, color=CLAY, linestyle=DASHES[2], label="partner's plan")


def _draw_thought(ax: Any, recording: Recording, row: str, t0: float) -> None:
    channel = recording[row]
    time, values = channel.time - t0, channel.values
    if row == "skill.weights":
        _draw_weights(ax, time, values)
    elif row == "skill.role":
        _draw_opinion(ax, time, values)
    elif row == "skill.phase":
        ax.plot(time, values[:, 0], color=INK)
        ax.set_ylabel("phase of\nthe task [s]")
    else:
        for i, name in enumerate(channel.axes):
            style = {"color": COLOURS[i % 5], "linestyle": DASHES[i % 5]}
            ax.plot(time, np.degrees(values[:, i]), label=name if len(channel.axes) > 1 else None, **style)
        ax.axhline(0.0, color=ASH, linewidth=0.7, zorder=0)
        ax.set_ylabel("beam's tilt\n[deg]")
        if len(channel.axes) > 1:
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_opinion(ax: Any, time: Array, values: Array) -> None:
    """What a robot that was told nothing takes itself for: probabilities, in the order of `skills.roles`."""
    for name, role, column in zip(("leads", "follows", "shares"), ("leader", "follower", ""), values.T, strict=False):
        ax.plot(time, column, label=name, **{**ROLE_STYLE[role], "linewidth": 1.6 if role else 1.0})
    ax.set_ylim(-0.03, 1.03)
    ax.set_ylabel("takes itself\nfor [-]")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_weights(ax: Any, time: Array, weights: Array) -> None:
    """Weights as areas that add to 1, dark to light in order of time; a state's number stands where it rules longest."""
    from matplotlib import colormaps

    n = weights.shape[1]
    shades = colormaps["cividis"](np.linspace(0.05, 0.97, n))
    ax.stackplot(time, weights.T, colors=shades, linewidth=0)
    below = np.cumsum(weights, axis=1) - 0.5 * weights
    for k in range(n):
        start, stop = _longest_run(weights[:, k] > 0.5)
        if stop - start > 0.025 * len(time):
            middle = (start + stop) // 2
            colour = "white" if shades[k][:3].mean() < 0.45 else "black"
            ax.text(time[middle], below[middle, k], str(k + 1), color=colour, ha="center", va="center", fontsize=7.5)
    ax.set_ylim(0.0, 1.0)
    ax.set_ylabel("weights of\nstates [-]")
    ax.grid(False)


def _longest_run(flags: np.ndarray) -> tuple[int, int]:
    """First and one-past-last index of the longest stretch of True; (0, 0) when there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    if not len(edges):
        return 0, 0
    best = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * best]), int(edges[2 * best + 1])


def save(figure: Any, path: str | Path) -> Path:
    """Writes a figure as its suffix says; the same figure gives the same file. Makes the folder."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ParameterError(
            f"{path.name}: cannot draw into {path.suffix or 'a name without suffix'!r}; allowed: {', '.join(SUFFIXES)}"
        )
    drawn = io.BytesIO()
    with taste():
        _settle(figure)
        figure.savefig(drawn, format=path.suffix.lower()[1:], dpi=DPI, metadata=_signed(path.suffix.lower()))
    write_whole(path, drawn.getvalue())
    return path


def _settle(figure: Any) -> None:
    """Fixes the layout once, rounded: its solver varies in the last bit, and the same figure must give the same file."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if not isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
        return
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for ax in figure.axes:
        ax.set_position([round(v, 4) for v in ax.get_position(original=True).bounds])


def _signed(suffix: str) -> dict[str, Any]:
    """What a picture says of itself: who drew it, so that it may be drawn again, and no date, so that it is the same again."""
    by_suffix: dict[str, dict[str, Any]] = {
        ".svg": {"Date": None, "Creator": SIGNATURE},
        ".pdf": {"CreationDate": None, "Creator": SIGNATURE},
        ".png": {"Software": SIGNATURE},
    }
    return by_suffix[suffix]


def to_svg(figure: Any) -> str:
    """The figure as an <svg> element, ready to stand inside an HTML page."""
    text = io.StringIO()
    with taste():
        _settle(figure)
        figure.savefig(text, format="svg", metadata=_signed(".svg"))
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


def to_png_bytes(figure: Any, dpi: int = DPI) -> bytes:
    picture = io.BytesIO()
    with taste():
        _settle(figure)
        figure.savefig(picture, format="png", dpi=dpi)
    return picture.getvalue()
