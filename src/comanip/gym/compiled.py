"""The compiled tick of an episode (kernels/_carry.h), and its memory, lent to C and taken back when the Python has to speak.

C takes ticks of a beam whose person is known by numbers (the usual people who behave, or who lead and hesitate or reverse)
within an envelope that has nothing to say. All other ticks, and all ticks of other people, plants and tasks that turn the object,
are the Python's; the numbers are the same.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from .. import kernels
from ..interaction import CausalInteractionForce, TaringInteractionForce
from ..interfaces import Array
from ..kernels import layouts
from ..people.intent import BLOCK
from ..plants.beam import BeamPlant
from ..safety.envelope import Envelope
from ..trials.judging import MOVED_M
from .episode import EFFORT_N, ROUGH_M_PER_S2, Episode, Parts

TICKED, FOR_PYTHON, FROM_ACT, NO_NOISE = range(4)
OPEN = 0
REASONS = ("", "diverged", "moved before the partner", "did not start in time", "beam not level", "")  # in C's order
ROWS = ("position", "velocity", "sensor_force", "force")
KEPT = ("mode", "tank", "confidence")  # the envelope's, and no other diagnostics
TICKS, MOST, DRAWN, HAS_MOVED = range(4)
FELT = ("b0", "b1", "b2", "a1", "a2", "s1", "s2", "started")  # of a Lowpass


class Stream:
    """The normal numbers that a run draws one after the other, from one Generator, in blocks that C draws from, too."""

    def __init__(self, rng: np.random.Generator, n_axes: int, counts: Any) -> None:
        self._rng, self._counts = rng, counts
        self.block = rng.standard_normal(2 * n_axes * BLOCK)

    def refill(self) -> None:
        """What was drawn goes, the rest moves to the front, and new ones come behind."""
        drawn = int(self._counts[DRAWN])
        left = len(self.block) - drawn
        self.block[:left] = self.block[drawn:].copy()
        self.block[left:] = self._rng.standard_normal(drawn)
        self._counts[DRAWN] = 0

    def standard_normal(self, size: Any) -> Array:
        """As a Generator's."""
        n = int(np.prod(size))
        if self._counts[DRAWN] + n > len(self.block):
            self.refill()
        at = int(self._counts[DRAWN])
        self._counts[DRAWN] += n
        return self.block[at : at + n].reshape(size).copy()


def fits(episode: Episode) -> bool:
    """Whether any of its ticks can be compiled."""
    plant, loop = episode.loop.plant, episode.loop
    return (
        kernels.native is not None
        and isinstance(plant, BeamPlant)
        and plant._compiled is not None
        and isinstance(episode.skill, Envelope)
        and episode.skill._compiled is not None
        and episode.skill.skill is episode.told
        and isinstance(loop.estimator, TaringInteractionForce)
        and tuple(episode.skill.diagnostics) == KEPT
        and loop.observed == ROWS
    )


class Compiled:
    """An episode of which C takes the ordinary ticks. `run` is C's, None while the Python has the memory."""

    def __init__(self, episode: Episode, seen: Array, parts: Array) -> None:
        """`seen` (n,) and `parts` (4,) are where C writes what the policy sees, and the reward's parts."""
        self.episode = episode
        self._plant = cast(Any, episode.loop.plant)
        self._envelope: Any = episode.skill
        self._parts, self._made = parts, None
        episode.sight.move_to(seen)
        episode.seen = seen
        d = self._d = len(episode.case.axes)
        self._counts = np.zeros(4, dtype=np.int64)
        self._counts[MOST] = episode.most
        self._stream = Stream(self._plant._rng, d, self._counts)
        self._plant.draws_from(self._stream)
        self._time, self._command, self._wish = np.zeros(1), np.zeros(3 * d), np.zeros(3 * d)
        self._truth, self._signs, self._sent = np.zeros(3 * d), np.array([0.0, 0.0, 1.0]), np.zeros(d)
        recorder = episode.loop.recorder
        self._rows = np.zeros((episode.most + 1, recorder._rows.shape[1]))
        recorder._rows = self._rows
        self.run: Any = None
        self._is_lent = False
        self.lend()

    def tick(self, status: int) -> Parts:
        """A tick that C left to the Python, from the start or from the envelope's `act` on."""
        episode = self.episode
        self._take_back()
        if status == FROM_ACT:
            inner = self._envelope._inner
            inner.position[:], inner.velocity[:], inner.acceleration[:] = self._wish.reshape(3, -1)
            self._envelope._remark(self._envelope._unfit(), episode.loop.command)
            parts = episode.after(episode.loop.send())
        else:
            parts = episode.tick()
        self._parts[:] = parts
        self.lend()
        return parts

    def end(self, why: int) -> None:
        """C says that it is over."""
        self._take_back()
        self._parts[3] = self.episode.finish(REASONS[why])

    def refill(self) -> None:
        """C has no noise left for its next tick."""
        self._stream.refill()

    def lend(self) -> None:
        """To C, where it may take the next tick."""
        episode, loop = self.episode, self.episode.loop
        estimator: Any = loop.estimator
        if episode.over or not self._envelope._is_lent or estimator._force is None:
            self.run = None
            return
        if self._made is None:
            self._made = self._make(estimator._force)
        self._lend_force(estimator._force)
        self._time[0] = loop.obs.time
        self._counts[TICKS], self._counts[HAS_MOVED] = episode.ticks, episode.moved
        for n, name in enumerate(("position", "velocity", "acceleration")):
            self._command[n * self._d : (n + 1) * self._d] = getattr(loop.command, name)
        plant, d = self._plant, self._d
        self._truth[:d], self._truth[d : 2 * d], self._truth[2 * d :] = plant._tilt, plant._acceleration, plant._true_force
        self._sent[:] = episode.sent
        self.run, self._is_lent = self._made, True

    def _take_back(self) -> None:
        """All that C has changed goes where the Python looks for it."""
        if not self._is_lent:
            return
        episode, loop, plant, d = self.episode, self.episode.loop, self._plant, self._d
        self._is_lent = False
        estimator: Any = loop.estimator
        self._take_back_force(estimator._force)
        loop.obs.time = float(self._time[0])
        plant.catch_up(loop.obs.time)
        plant._tilt[:], plant._acceleration[:], plant._true_force[:] = self._truth.reshape(3, d)
        for n, name in enumerate(("position", "velocity", "acceleration")):
            getattr(loop.command, name)[:] = self._command[n * d : (n + 1) * d]
        episode.ticks, episode.moved = int(self._counts[TICKS]), bool(self._counts[HAS_MOVED])
        episode.sent = self._sent.tolist()
        loop.recorder._count = episode.ticks

    def _make(self, force: CausalInteractionForce) -> Any:
        episode, loop, plant, sight = self.episode, self.episode.loop, self._plant, self.episode.sight
        within, told = episode.within, episode.told
        numbers = {
            "dt_s": episode.setting.dt,
            "noise_n": plant.sensor.noise_n,
            "bias_n": plant.sensor.bias_n,
            "half_mass_kg": 0.5 * plant.beam.mass_kg,
            "sums": told._sums,
            "fastest_m_per_s": told._most,
            "good_s": force._good_s,
            "average": force._average,
            "late_ticks": force._late,
            "blend": force._blend,
            "size_m": episode.size_m,
            "effort_n": EFFORT_N,
            "rough_m_per_s2": ROUGH_M_PER_S2,
            "ends_early": episode.setting.ends_early,
            "waits": within.waits,
            "onset_s": episode.onset_s,
            "starts_by_s": within.starts_by_s,
            "tilt_rad": episode.tilt_rad,
            "moved_m": MOVED_M,
        }
        self._felt = np.zeros((self._d, len(layouts.BLOCKS["felt"]) + force._late + 2))
        obs = loop.obs
        arrays = (
            layouts.packed("carry", numbers), self._counts, self._time, obs.position, obs.velocity, obs.sensor_force, obs.force,
            self._command, self._wish, told._said, told._velocity, plant._shown, plant._commanded, self._truth, self._signs,
            self._felt, self._rows, self._sent, sight._past, sight._last, np.array(episode.meant), np.array(episode.start),
            self._stream.block, self._parts, self._envelope._taught,
        )  # fmt: skip
        return kernels.native.Carry(plant._compiled, self._envelope._compiled.compiled, arrays)

    def _lend_force(self, force: CausalInteractionForce) -> None:
        names = layouts.BLOCKS["felt"]
        for i, row in enumerate(self._felt):
            section = force._filters[i]
            values = {"gravity": 0.0, "load_kg": force._loads[i], "offset_n": force._offset[i]}
            values |= {name: getattr(section, f"_{name}") for name in FELT}
            values |= {"velocity": force._velocity[i], "force": force._force[i], "elapsed": force._elapsed[i]}
            values |= {"sample": force._sample[i], "age": force._age[i]}
            row[: len(names)] = [values[name] for name in names]
            row[len(names) :] = force._past[i]

    def _take_back_force(self, force: CausalInteractionForce) -> None:
        names = layouts.BLOCKS["felt"]
        for i, row in enumerate(self._felt.tolist()):
            found, section = dict(zip(names, row, strict=False)), force._filters[i]
            section._s1, section._s2, section._started = found["s1"], found["s2"], bool(found["started"])
            force._velocity[i], force._force[i], force._elapsed[i] = found["velocity"], found["force"], found["elapsed"]
            force._sample[i], force._age[i] = found["sample"], found["age"]
            force._past[i] = row[len(names) :]
