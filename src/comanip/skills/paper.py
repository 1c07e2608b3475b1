"""The paper's skill: HMM weights, two regressions, one second-order controller. Equations (4) to (10).

`PaperLaw()` is the paper to the letter where the letter is defined; every other reading is an argument. Where a choice is argued:
docs/laws.md. With a living partner the literal law fails (docs/results.md); it is here because it is the reference.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array, Command, Observation
from ..models.filtering import ForwardFilter
from ..models.gaussian import log_density, marginal, normalised
from ..models.gmr import Regression
from ..models.hmm import Hmm
from ..recording import expand
from ..signals.second_order import second_order_step


@dataclass(frozen=True)
class PaperLaw:
    """Choices of the law; defaults are the paper's.

    weights           "hmm" eq. (4), "mixture" eq. (7) without priors
    weight_channels   which channels enter the weights; () is all, the paper's
    attraction_per_s  lambda_max = kappa^P_max / kappa^V [1/s]. The paper's kappa^P_max = 0.08 is PER STEP of 0.01 s, i.e.
                      800 1/s^2 against kappa^V = 100 1/s: lambda_max = 8 1/s, which has the same meaning at any rate
    velocity_gain_per_s   kappa^V [1/s]; None is 1/dt (eq. 9), and 1/(period of the lessons) for the exact integrator
    gain              "likelihood" eq. (9), "confidence" (what the text below eq. (9) describes: none within a state, all of it
                      from three standard deviations on), or "constant" (always lambda_max)
    target_position   what x_hat of eq. (6) is regressed from: "measured" velocity (paper), "predicted" velocity v_hat, which
                      opens the loop velocity -> x_hat -> velocity, or "force" alone
    bounded           True: what goes into the regressions, and what comes out, is held within the taught range (three
                      standard deviations beyond the outermost states). A regression is a line and goes on; a task does not
    integrator        "euler" eq. (10), or "exact": the linear ODE of eq. (8) solved, one motion at any control period
    weight_noise, input_noise   variances to add by channel name, (("position", 0.0016),): doubt in what enters the weights,
                      or the regression of eq. (5). A hand that runs free is not where the lessons were: weak evidence
    transition_floor, gate   the filter's guards (see ForwardFilter); off, as printed. Free runs and robots want 1e-6 and 20
    """

    weights: str = "hmm"
    weight_channels: tuple[str, ...] = ()
    attraction_per_s: float = 8.0
    velocity_gain_per_s: float | None = None
    gain: str = "likelihood"
    target_position: str = "measured"
    integrator: str = "euler"
    bounded: bool = False
    weight_noise: tuple[tuple[str, float], ...] = ()
    input_noise: tuple[tuple[str, float], ...] = ()
    transition_floor: float = 0.0
    gate: float = float("inf")

    def __post_init__(self) -> None:
        choices = {
            "weights": ("hmm", "mixture"),
            "gain": ("likelihood", "confidence", "constant"),
            "target_position": ("measured", "predicted", "force"),
            "integrator": ("euler", "exact"),
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise ParameterError(f"{name}={getattr(self, name)!r}; allowed: {', '.join(allowed)}")
        object.__setattr__(self, "weight_channels", tuple(self.weight_channels))
        for name in ("weight_noise", "input_noise"):
            object.__setattr__(self, name, tuple((str(n), float(v)) for n, v in dict(getattr(self, name)).items()))


class PositionGain:
    """Eq. (9): kappa^P(x) / kappa^P_max in [0, 1], from how unlikely the position is under every state.

    L(x) = max_i log N(x; mu_i^x, Sigma_i^x). L_max is the highest peak; L_min, the lowest value over the box W, is attained at a
    vertex because each log N is concave. (The paper leaves L(x) undefined; "closest in a likelihood sense" is this.)
    """

    def __init__(self, model: Hmm, workspace: Array) -> None:
        if not (workspace[:, 1] > workspace[:, 0]).all():
            raise ParameterError(f"the workspace is empty along some axis: {workspace.tolist()}")
        columns = [i for i, c in enumerate(model.channels) if c.startswith("position.")]
        self._means, covariances = marginal(model.means, model.covariances, columns)
        self._precision = np.linalg.inv(covariances)
        self._log_peak = np.diag(log_density(self._means, self._means, covariances))
        vertices = np.array(list(product(*workspace)))
        self._top = float(self._log_peak.max())
        self._bottom = float(log_density(vertices, self._means, covariances).min())

    def __call__(self, x: Array) -> float:
        apart = x - self._means
        closest = (self._log_peak - 0.5 * np.einsum("ki,kij,kj->k", apart, self._precision, apart)).max()
        span = self._top - self._bottom
        return float(min(max((self._top - closest) / span, 0.0), 1.0)) if span > 0.0 else 0.0


class ConfidenceGain:
    """Share of kappa^P_max in [0, 1]: squared distance to the closest state, full from `deviations` standard deviations on.

    Eq. (9) divides by the lowest value anywhere in W, thousands of times what a hand near the task ever meets, so its gain is
    nearly zero there, and SMALLER the more consistent the lessons are. The text asks for the opposite (docs/figures.md).
    """

    def __init__(self, model: Hmm, deviations: float = 3.0) -> None:
        columns = [i for i, c in enumerate(model.channels) if c.startswith("position.")]
        self._means, covariances = marginal(model.means, model.covariances, columns)
        self._precision = np.linalg.inv(covariances) / deviations**2

    def __call__(self, x: Array) -> float:
        apart = x - self._means
        return float(min(np.einsum("ki,kij,kj->k", apart, self._precision, apart).min(), 1.0))


class PaperSkill:
    """Runs a model by eqs. (4)-(10) at any control period.

    dt        control period [s]. The HMM was learned at `model_dt`, so its filter runs on its own clock of that period:
              at 1 kHz it steps every tenth tick, and evidence counts as often as in the lessons
    workspace (d, 2) W of eq. (9) [m]
    """

    notice = ""
    stop_reason = ""

    def __init__(
        self,
        model: Hmm,
        *,
        axes: tuple[str, ...],
        dt: float,
        model_dt: float,
        workspace: Array,
        law: PaperLaw = PaperLaw(),
    ) -> None:
        self.axes, self.dt = tuple(axes), dt
        self.law, self._dt, self._model_dt = law, dt, model_dt
        self._has_force = any(c.startswith("force.") for c in model.channels)
        inputs = ("position", "force") if self._has_force else ("position",)
        back = {"measured": ("force", "velocity"), "predicted": ("force", "velocity"), "force": ("force",)}
        backwards = back[law.target_position] if self._has_force else ("velocity",)
        noise = {n: v for n, v in law.input_noise if n in inputs}
        self._velocity_from = Regression(model, inputs, "velocity", input_noise=noise)  # eq. (5)
        self._position_from = Regression(model, backwards, "position")  # eq. (6)
        self._blind = Regression(model, "position", "velocity")  # eq. (5) while the force is missing
        self._partly = self._from_some_forces() if self._has_force else {}
        self._filter = ForwardFilter(
            blurred(model, dict(law.weight_noise)),
            law.weight_channels or None,
            transition_floor=law.transition_floor,
            gate=law.gate,
        )
        self._gain = ConfidenceGain(model) if law.gain == "confidence" else PositionGain(model, workspace)
        d, k = len(axes), model.n_states
        self._groups = {"position": np.zeros(d), "force": np.zeros(d), "velocity": np.zeros(d)}
        self._sources = [(g, axes.index(a)) for g, a in (c.split(".", 1) for c in self._filter.channels)]
        self._xi = np.zeros(len(self._filter.channels))
        self._marginal = marginal(model.means, model.covariances, [model.channels.index(c) for c in self._filter.channels])
        self._range: dict[str, tuple[Any, Any]] = {}
        for group in self._groups:
            channels = [c for c in model.channels if c.startswith(group + ".")]
            self._range[group] = taught_range(model, channels) if law.bounded and channels else (-np.inf, np.inf)
        self._v_hat, self._x_hat = np.zeros(d), np.zeros(d)
        self._h, self._kappa_p = np.zeros(k), np.zeros(1)
        self._position, self._velocity = np.zeros(d), np.zeros(d)

    def _from_some_forces(self) -> dict[bytes, tuple[Regression, Regression]]:
        """Eqs. (5) and (6) for every choice of force axes that may be missing, made beforehand: a tick builds nothing."""
        forces = [c for c in self._velocity_from.inputs if c.startswith("force.")]
        found = {}
        for present in product((True, False), repeat=len(forces)):
            if any(present) and not all(present):
                gone = {c for c, here in zip(forces, present, strict=True) if not here}
                both = (r.without(np.array([c in gone for c in r.inputs])) for r in (self._velocity_from, self._position_from))
                found[np.array(present).tobytes()] = (next(both), next(both))
        return found

    @property
    def diagnostics(self) -> Mapping[str, Array]:
        return {
            "weights": self._h,
            "target_velocity": self._v_hat,
            "target_position": self._x_hat,
            "position_gain": self._kappa_p,
        }

    def reset(self, obs: Observation) -> None:
        self._filter.reset()
        self._until_filter = 0.0
        self._h[:] = self._filter.weights
        self._position[:] = np.nan_to_num(obs.position)
        self._velocity[:] = 0.0
        self._force = np.zeros_like(self._position)
        self._before: Array | None = None  # force of the last tick

    def step(self, obs: Observation, command: Command) -> None:
        x = obs.position if _finite(obs.position) else np.where(np.isfinite(obs.position), obs.position, self._position)
        dx = obs.velocity if _finite(obs.velocity) else np.where(np.isfinite(obs.velocity), obs.velocity, self._velocity)
        self._weigh(x, obs.force, dx)
        force = obs.force if _finite(obs.force) else np.where(np.isfinite(obs.force), obs.force, np.nan)
        felt = self._has_force and not np.isnan(force).all()
        self._integrate(x, dx, force if felt else None)
        command.position[:], command.velocity[:] = self._position, self._velocity
        command.acceleration[:] = (self._velocity - dx) / self._dt

    def _weigh(self, x: Array, force: Array, dx: Array) -> None:
        """Eq. (4) or (7), on the model's own clock."""
        groups = {"position": x, "force": force, "velocity": dx}
        while self._until_filter <= 1e-9:
            self._until_filter += self._model_dt
            for n, (group, axis) in enumerate(self._sources):
                self._xi[n] = groups[group][axis]
            if self.law.weights == "hmm":
                self._h[:] = self._filter.step(self._xi)
            else:
                self._h[:] = normalised(log_density(self._xi[None], *self._marginal))[0]
        self._until_filter -= self._dt

    def _regress(self, x: Array, dx: Array, force: Array | None) -> None:
        """Eqs. (5) and (6) with the present weights; without force, velocity from position alone. NaN: an axis without force."""
        near = self._held(x, "position")
        if force is not None:
            self._force[:] = self._held(force, "force")  # a copy: the observation is rewritten next tick
            if not _finite(self._force):
                self._regress_partly(near, dx)
                return
            self._velocity_from.mean(self._h, np.concatenate([near, self._force]), out=self._v_hat)
        else:
            self._blind.mean(self._h, near, out=self._v_hat)
        self._v_hat[:] = self._held(self._v_hat, "velocity")
        self._position_from.mean(self._h, self._backward_inputs(dx), out=self._x_hat)
        self._x_hat[:] = self._held(self._x_hat, "position")

    def _regress_partly(self, near: Array, dx: Array) -> None:
        """The same where some axes' force is missing: it is integrated out, and the others count."""
        present = np.isfinite(self._force)
        velocity_from, position_from = self._partly[present.tobytes()]
        felt = self._force[present]
        velocity_from.mean(self._h, np.concatenate([near, felt]), out=self._v_hat)
        self._v_hat[:] = self._held(self._v_hat, "velocity")
        v = self._v_hat if self.law.target_position == "predicted" else dx
        position_from.mean(self._h, felt if self.law.target_position == "force" else np.concatenate([felt, v]), out=self._x_hat)
        self._x_hat[:] = self._held(self._x_hat, "position")
        self._force[~present] = 0.0  # kept for ticks without any

    def _held(self, values: Array, group: str) -> Array:
        """Within the taught range, where the law asks for it. (numpy.clip costs five times these two.)"""
        if not self.law.bounded:
            return values
        low, high = self._range[group]
        return np.asarray(np.minimum(np.maximum(values, low), high))

    def _backward_inputs(self, dx: Array) -> Array:
        v = self._v_hat if self.law.target_position == "predicted" else dx
        if not self._has_force:
            return v
        return self._force if self.law.target_position == "force" else np.concatenate([self._force, v])

    def _integrate(self, x: Array, dx: Array, force: Array | None) -> None:
        """Eq. (8), then eq. (10); or its exact solution, which gives one motion at any control period.

        Exact: the linear ODE is solved with targets taken in the MIDDLE of the step (force extrapolated there by half a tick), so
        what is left of the step size is of second order.
        """
        if self.law.integrator == "euler":
            self._regress(x, dx, force)
            kappa_v = self.law.velocity_gain_per_s or 1.0 / self._dt
            kappa_p = self._attraction(x, kappa_v)
            self._velocity[:] = dx + self._dt * ((self._v_hat - dx) * kappa_v + (self._x_hat - x) * kappa_p)
            self._position[:] = x + self._dt * self._velocity
            return
        kappa_v = self.law.velocity_gain_per_s or 1.0 / self._model_dt
        before, self._before = self._before, None if force is None else force.copy()
        ahead = force
        if force is not None and before is not None:
            ahead = np.where(np.isfinite(before), 1.5 * force - 0.5 * before, force)
        self._regress(x, dx, force)
        middle, speed = self._exact(x, dx, kappa_v, self._attraction(x, kappa_v), 0.5 * self._dt)
        self._regress(middle, speed, ahead)
        kappa_p = self._attraction(middle, kappa_v)
        self._position[:], self._velocity[:] = self._exact(x, dx, kappa_v, kappa_p, self._dt)

    def _attraction(self, x: Array, kappa_v: float) -> float:
        """kappa^P of eq. (9) [1/s^2]."""
        share = 1.0 if self.law.gain == "constant" else self._gain(x)
        self._kappa_p[0] = kappa_v * self.law.attraction_per_s * share
        return float(self._kappa_p[0])

    def _exact(self, x: Array, dx: Array, kappa_v: float, kappa_p: float, duration: float) -> tuple[Array, Array]:
        """Eq. (8) solved over `duration` for targets held: with y = x(t) - x, y'' = -kappa_p y - kappa_v y' + drive."""
        one = second_order_step(kappa_p, kappa_v, duration)
        drive = self._v_hat * kappa_v + (self._x_hat - x) * kappa_p
        return x + one.yv * dx + one.yu * drive, one.vv * dx + one.vu * drive


def _finite(values: Array) -> bool:
    """(A sum would do, but for inf - inf.)"""
    return all(map(isfinite, values.tolist()))


def blurred(model: Hmm, noise: Mapping[str, float]) -> Hmm:
    """The model as seen through doubt in its channels: `noise` is a variance to add, by name (squared unit)."""
    if not noise:
        return model
    added = np.zeros(model.n_channels)
    for name, variance in noise.items():
        for channel in expand(name, model.channels):
            added[model.channels.index(channel)] = variance
    return replace(model, covariances=model.covariances + np.diag(added))


def taught_range(model: Hmm, channels: Iterable[str]) -> tuple[Array, Array]:
    """Lowest and highest value of each channel (C,) that the states reach within three standard deviations."""
    columns = [model.channels.index(c) for c in channels]
    means, covariances = marginal(model.means, model.covariances, columns)
    reach = 3.0 * np.sqrt(np.einsum("kii->ki", covariances))
    return (means - reach).min(axis=0), (means + reach).max(axis=0)


def hidden_loop_gain(model: Hmm, attraction_per_s: float) -> Array:
    """(K,) gain of the loop velocity -> x_hat -> velocity: lambda ||Sigma^{x dx} (Sigma^{dx})^-1||. Above 1 it diverges."""
    inputs: tuple[str, ...] = ("force", "velocity")
    if not any(c.startswith("force.") for c in model.channels):
        inputs = ("velocity",)
    regression = Regression(model, inputs, "position")
    velocity = [i for i, c in enumerate(regression.inputs) if c.startswith("velocity.")]
    return attraction_per_s * np.linalg.norm(regression.gains[:, :, velocity], ord=2, axis=(1, 2))


def law_from(settings: Mapping[str, Any]) -> PaperLaw:
    """PaperLaw from stored settings; an unknown name is a ParameterError that lists the known ones."""
    known = PaperLaw.__dataclass_fields__
    unknown = sorted(set(settings) - set(known))
    if unknown:
        raise ParameterError(f"law 'paper' has no setting {unknown[0]!r}; it has: {', '.join(known)}")
    return PaperLaw(**settings)
