"""What users import: every name typed, documented, and short when printed."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest

import comanip
from comanip import Channel, Command, Demonstration, Gmm, Hmm, Observation, Recording, fit_hmm, learn

TREE = ast.parse(Path(comanip.__file__).read_text())


def typed() -> dict[str, str]:
    """name -> "module:own name" of the block that type checkers read."""
    (block,) = [n for n in TREE.body if isinstance(n, ast.If)]
    return {a.asname: f"comanip.{n.module}:{a.name}" for n in block.body for a in n.names}


def test_type_checkers_see_what_the_program_imports():
    own = comanip._OWN_NAME
    assert typed() == {name: f"{module}:{own.get(name, name)}" for name, module in comanip._PUBLIC.items()}


@pytest.mark.parametrize("name", sorted(comanip._PUBLIC))
def test_every_public_name_is_there_and_says_what_it_is(name):
    assert inspect.getdoc(getattr(comanip, name))


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(AttributeError, match=r"lern.*learn"):
        comanip.lern  # noqa: B018


def lessons(n=3):
    t = np.arange(0.0, 3.0, 0.01)
    x = 0.9 + 0.3 * np.sin(0.5 * t) ** 2
    rng = np.random.default_rng(0)
    return [
        Demonstration(f"lift_{i}", 0.01, {"position": (x + 0.001 * i)[:, None], "velocity": np.gradient(x, t)[:, None],
                      "force": (np.cos(t) + 0.1 * rng.normal(size=len(t)))[:, None]}, ("z",), "follower")
        for i in range(n)
    ]  # fmt: skip


def values():
    t = np.arange(3000) / 1000.0
    channel = Channel(t, np.zeros((3000, 1)), "m", "task", ("z",))
    demonstrations = lessons()
    fit = fit_hmm([x.array(("position", "velocity")) for x in demonstrations], 3, channels=("position.z", "velocity.z"))
    gmm = Gmm([1.0], [[0.0]], [[[1.0]]], ("phase",))
    return [channel, Recording({"hand.position": channel}), demonstrations[0], fit, fit.model, gmm, learn(demonstrations),
            comanip.Regression(fit.model, "position", "velocity"), Observation(1), Command(1)]  # fmt: skip


@pytest.mark.parametrize("value", values(), ids=lambda v: type(v).__name__)
def test_a_value_says_itself_in_one_line(value):
    assert type(value).__name__ in repr(value)
    assert len(repr(value)) < 150
    assert "\n" not in repr(value)
    assert " object at 0x" not in repr(value)


def test_a_value_says_what_matters():
    demonstration = lessons()[0]
    assert "300 frames at 100 Hz" in repr(demonstration)
    assert "follower" in repr(learn(lessons()))
    assert "3 lessons" in repr(learn(lessons()))
    assert "2 states over a" in repr(Hmm([1.0, 0.0], np.eye(2), [[0.0], [1.0]], np.ones((2, 1, 1)), ("a",)))


SOCKETS = [comanip.Skill, comanip.Plant, comanip.Partner, comanip.HapticDevice]


def undocumented(value) -> list[str]:
    """Public methods and properties without a word; what a socket documents is documented for all who fill it."""
    of_sockets = {name for socket in SOCKETS if socket is not value for name in vars(socket)}
    found = []
    for name, member in vars(value).items():
        function = member.fget if isinstance(member, property) else getattr(member, "func", getattr(member, "__func__", member))
        ours = inspect.isfunction(function) and not name.startswith("_") and name not in of_sockets
        if ours and not inspect.getdoc(function):
            found.append(f"{value.__name__}.{name}")
    return found


@pytest.mark.parametrize("name", [n for n in sorted(comanip._PUBLIC) if inspect.isclass(getattr(comanip, n))])
def test_every_public_method_says_what_it_does(name):
    assert undocumented(getattr(comanip, name)) == []


def test_a_method_without_a_word_is_noticed():
    class Silent:
        """Says what it is, and not what it does."""

        def act(self) -> None:
            return None

    assert undocumented(Silent) == ["Silent.act"]
