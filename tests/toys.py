"""Small models and demonstrations for tests: everything from a seed, nothing from a file."""

import numpy as np

from comanip.models.gmm import Gmm
from comanip.models.hmm import Hmm
from comanip.models.hsmm import Hsmm

CHANNELS = ("position.z", "force.z", "velocity.z")


def agree(a, b, *, tolerance=1e-10):
    np.testing.assert_allclose(a, b, rtol=0.0, atol=tolerance * max(np.abs(b).max(), 1e-300))


def same(a, b, err_msg=""):
    """`np.testing.assert_array_equal` for loops of ticks: its 50 us are paid only where type, shape or bytes differ."""
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype != b.dtype or a.shape != b.shape or a.tobytes() != b.tobytes():
        np.testing.assert_array_equal(a, b, err_msg=err_msg)


def resident():
    """Bytes of memory that this process holds."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * 4096


def random_covariances(rng, n_states, n_channels, size=1.0):
    root = rng.normal(size=(n_states, n_channels, n_channels)) * size
    return root @ np.swapaxes(root, 1, 2) + 0.1 * size**2 * np.eye(n_channels)


def random_hmm(rng, n_states=3, n_channels=2, spread=2.0):
    return Hmm(
        rng.dirichlet(np.ones(n_states)),
        rng.dirichlet(np.ones(n_states), size=n_states),
        spread * rng.normal(size=(n_states, n_channels)),
        random_covariances(rng, n_states, n_channels),
        tuple(f"c{i}" for i in range(n_channels)),
    )


def random_gmm(rng, n_states=3, n_channels=3, spread=2.0):
    return Gmm(
        rng.dirichlet(np.full(n_states, 5.0)),
        spread * rng.normal(size=(n_states, n_channels)),
        random_covariances(rng, n_states, n_channels),
        tuple(f"c{i}" for i in range(n_channels)),
    )


def lift(rng, n_frames=200, rate_hz=100.0):
    """One demonstration of a lift with a short rest at both ends: position [m], force [N], velocity [m/s], (T, 3)."""
    n = int(n_frames * rng.uniform(0.9, 1.1))
    s = np.clip(np.linspace(-0.1, 1.1, n), 0.0, 1.0)
    height = 0.3 + 0.02 * rng.normal()
    x = height * (10 * s**3 - 15 * s**4 + 6 * s**5) + 0.01 * rng.normal() + 2e-4 * np.cumsum(rng.normal(size=n))
    force = 6.0 * np.sin(np.pi * s) * (1.0 + 0.1 * rng.normal()) + 0.3 * rng.normal(size=n)
    return np.column_stack([x, force, np.gradient(x, 1.0 / rate_hz)])


def lifts(n_demonstrations=5, seed=0, n_frames=200):
    rng = np.random.default_rng(seed)
    return [lift(rng, n_frames) for _ in range(n_demonstrations)]


class Stored:
    """A reader for `fit_stream`: reads .npz files of sequences, two at a time."""

    def __call__(self, path):
        with np.load(path) as file:
            sequences = [file[name] for name in file.files]
        for i in range(0, len(sequences), 2):
            yield sequences[i : i + 2]

    def __repr__(self):
        return "Stored()"


def random_hsmm(rng, n_states=3, n_channels=2, longest=4, spread=2.0, left_right=False):
    p = random_hmm(rng, n_states, n_channels, spread)
    rows = p.transition * ~np.eye(n_states, dtype=bool)
    if left_right or n_states == 1:
        rows = np.eye(n_states, k=1)
        rows[-1, -1] = 1.0
    initial = np.eye(n_states)[0] if left_right else p.initial
    durations = rng.dirichlet(np.ones(longest), size=n_states)
    return Hsmm(initial, rows / rows.sum(axis=1, keepdims=True), durations, p.means, p.covariances, p.channels)
