"""Regression between any channels by their names, with the uncertainty of each answer."""

import numpy as np

from comanip import fit_gmm, regress

rng = np.random.default_rng(12)
x = rng.uniform(0.0, 2.0 * np.pi, 2000)
y = np.sin(x) + rng.normal(0.0, 0.05 + 0.1 * (x > np.pi), len(x))
model = fit_gmm([np.column_stack([x, y])], 8, channels=("x", "y"), initial_guess="kmeans", rng=rng).model

asked = np.linspace(0.5, 5.5, 6)[:, None]
answer = regress(model, "x", "y", asked, weights="mixture-with-priors")
for at, mean, covariance in zip(asked[:, 0], answer.mean[:, 0], answer.covariance[:, 0, 0], strict=True):
    print(f"x = {at:.1f}: y = {mean:+.2f} +- {np.sqrt(covariance):.2f} (sin x = {np.sin(at):+.2f})")
