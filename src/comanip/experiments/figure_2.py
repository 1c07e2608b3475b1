"""Fig. 2: Gaussian mixture regression, with one Gaussian and with two.

The paper shows how a joint density of input and output becomes an estimate of the output with its spread. Claims: with one
Gaussian the estimate IS linear least squares, spread included; with two it is the conditional mean and variance of the
mixture, so it bends where they meet and is wider where they disagree. Refuted by any slope, mean or spread that differs
from what the data themselves say.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.experiments.readings import script
from comanip.fitting.gmm import fit_gmm
from comanip.interfaces import Array
from comanip.models.gmm import Gmm
from comanip.models.gmr import regress

CHANNELS = ("position", "velocity")
QUERY = np.linspace(0.0, 0.3, 121)[:, None]  # [m]
ASKED_M = (0.07, 0.145, 0.23)  # where the conditional density is drawn and tested
TRUTH = Gmm(
    np.array([0.5, 0.5]),
    np.array([[0.09, 0.10], [0.20, 0.22]]),
    np.array([[[9e-4, 9e-4], [9e-4, 1.3e-3]], [[1.2e-3, -7e-4], [-7e-4, 8e-4]]]),
    CHANNELS,
)


class Numbers(NamedTuple):
    data: Array  # (N, 2)
    one: Gmm
    two: Gmm
    line: tuple[Array, float]  # least squares at QUERY, and the residuals' standard deviation
    drawn: dict[float, Array]  # outputs of draws from TRUTH whose input is close to each asked position


def numbers(seed: int, *, n_data: int = 400, n_draws: int = 1_000_000) -> Numbers:
    rng = np.random.default_rng([seed, 2])
    data = _draw(rng, n_data)
    one = fit_gmm(np.split(data, 2), 1, channels=CHANNELS).model
    two = fit_gmm(np.split(data, 2), 2, channels=CHANNELS, initial_guess="kmeans", rng=rng).model
    slope, offset = np.polyfit(data[:, 0], data[:, 1], 1)
    residual = float(np.std(data[:, 1] - slope * data[:, 0] - offset))
    many = _draw(rng, n_draws)
    drawn = {x: many[np.abs(many[:, 0] - x) < 5e-4, 1] for x in ASKED_M}
    return Numbers(data, one, two, (slope * QUERY[:, 0] + offset, residual), drawn)


def _draw(rng: np.random.Generator, n: int) -> Array:
    which = rng.random(n) < TRUTH.weights[0]
    draws = [rng.multivariate_normal(m, c, n) for m, c in zip(TRUTH.means, TRUTH.covariances, strict=True)]
    return np.where(which[:, None], draws[0], draws[1])


def claims(found: Numbers) -> list[Claim]:
    line, residual = found.line
    one = regress(found.one, "position", "velocity", QUERY)
    apart = float(np.abs(one.mean[:, 0] - line).max() / found.data[:, 1].std())
    spread = float(np.abs(np.sqrt(one.covariance[:, 0, 0]) / residual - 1.0).max())
    asked = np.array(ASKED_M)[:, None]
    truth = regress(TRUTH, "position", "velocity", asked, weights="mixture-with-priors")
    mean_z, variance_z = 0.0, 0.0
    for n, y in enumerate(found.drawn.values()):
        mean_z = max(mean_z, abs(float(y.mean() - truth.mean[n, 0])) / float(y.std() / np.sqrt(len(y))))
        error = float(np.sqrt((np.mean((y - y.mean()) ** 4) - y.var() ** 2) / len(y)))  # standard error of a variance
        variance_z = max(variance_z, abs(float(y.var() - truth.covariance[n, 0, 0])) / error)
    middle = regress(TRUTH, "position", "velocity", asked[1:2])
    return [
        at_most(
            "one Gaussian gives the line of least squares: largest distance, in standard deviations of the output",
            apart,
            1e-6,
            refuted_by="any other slope or offset",
        ),
        at_most(
            "its spread is that of the residuals: largest relative difference",
            spread,
            1e-6,
            refuted_by="a spread that varies with the input or differs from the residuals'",
        ),
        at_most(
            "two Gaussians give the mean of draws with that input: worst of three inputs, in standard errors",
            mean_z,
            4.0,
            refuted_by="a mean more than 4 standard errors away (chance: 2 in 10,000)",
        ),
        at_most(
            "and their variance (law of total variance): the same",
            variance_z,
            4.0,
            refuted_by="a variance that forgets how much the two disagree",
        ),
        at_least(
            "between the two the spread is wider than either state's own: ratio of standard deviations",
            float(np.sqrt(middle.covariance[0, 0, 0] / _widest_state())),
            1.1,
            refuted_by="no widening where the states disagree",
        ),
    ]


def _widest_state() -> float:
    own = [c[1, 1] - c[0, 1] ** 2 / c[0, 0] for c in TRUTH.covariances]
    return float(max(own))


def draw(found: Numbers) -> Any:
    caption = (
        "Fig. 2. Left: data, states (2 standard deviations) and the regression with its band of 2 standard deviations. "
        "Right: the output's density at three inputs; areas are 1 million draws of the true density, lines the Gaussian "
        "that the regression gives for the model behind the draws. Refuted if the upper line is not least squares, or if "
        "a lower line's mean or width differs from its area's."
    )
    with figures.taste():
        dashed = zip(ASKED_M, figures.DASHES, strict=False)
        asked = [figures.line(color=figures.SEA, linestyle=d, label=f"asked at x = {x:g} m") for x, d in dashed]
        figure = figures.blank(7.2, 4.9, legend=asked, caption=caption)
        grid = figure.subplots(2, 2, width_ratios=[1.5, 1.0])
        for row, (model, title) in enumerate(((found.one, "One Gaussian"), (found.two, "Two Gaussians"))):
            _joint(grid[row, 0], found, model, title)
            _conditional(grid[row, 1], found, one=row == 0)
    return figure


def _joint(ax: Any, found: Numbers, model: Gmm, title: str) -> None:
    y = regress(model, "position", "velocity", QUERY)
    spread = 2.0 * np.sqrt(y.covariance[:, 0, 0])
    ax.plot(*found.data.T, ".", color=figures.ASH, markersize=2.2, zorder=1, label="data")
    ax.fill_between(QUERY[:, 0], y.mean[:, 0] - spread, y.mean[:, 0] + spread, color=figures.CLAY, alpha=0.16, linewidth=0)
    ax.plot(QUERY[:, 0], y.mean[:, 0], color=figures.CLAY, linewidth=2.0, label="regression")
    figures.ellipses(ax, model, "position", "velocity", color=figures.INK, alpha=0.0)
    if model.n_states == 1:
        ax.plot(QUERY[:, 0], found.line[0], color=figures.INK, linestyle=figures.DASHES[2], label="least squares")
    for x, dash in zip(ASKED_M, figures.DASHES, strict=False):
        ax.axvline(x, color=figures.SEA, linestyle=dash, linewidth=0.9)
    ax.set_xlim(0.0, 0.3)
    ax.set_ylim(-0.02, 0.34)
    figures.label(ax, "input: position x [m]", "output: velocity dx [m/s]", title)
    ax.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")


def _conditional(ax: Any, found: Numbers, *, one: bool) -> None:
    y = np.linspace(-0.02, 0.34, 200)
    model = found.one if one else TRUTH
    given = regress(model, "position", "velocity", np.array(ASKED_M)[:, None], weights="mixture-with-priors")
    for n, (x, dash) in enumerate(zip(ASKED_M, figures.DASHES, strict=False)):
        mean, variance = given.mean[n, 0], given.covariance[n, 0, 0]
        if not one:
            ax.hist(found.drawn[x], bins=50, density=True, color=figures.SEA, alpha=0.25)
        ax.plot(y, np.exp(-0.5 * (y - mean) ** 2 / variance) / np.sqrt(2 * np.pi * variance), color=figures.CLAY, linestyle=dash)
    ax.set_xlim(-0.02, 0.34)
    figures.label(ax, "output: velocity dx [m/s]", "density [s/m]", "Output given the input")


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    figures.save(draw(found), out / "figure_2.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
