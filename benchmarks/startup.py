"""What a person waits for: imports, --help, a first model from cold, and choosing the number of states."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

FRAMES = """
import numpy as np
rng = np.random.default_rng(0)
s = np.linspace(0.0, 1.0, 300)
x = [np.column_stack([0.3 * s**2 * (3 - 2 * s), 6 * np.sin(np.pi * s), 1.8 * s * (1 - s)]) + 0.02 * rng.normal(size=(300, 3))
     for _ in range(10)]
"""
LEARN = (
    FRAMES
    + """
from comanip.models.hmm import fit_hmm
import warnings
warnings.simplefilter("ignore")
fit_hmm(x, 5, channels=("position.z", "force.z", "velocity.z"), max_iterations=20, tolerance=0.0)
"""
)
CHOOSE = (
    FRAMES
    + """
import warnings
warnings.simplefilter("ignore")
from comanip.fitting.selection import select_states
names = ("position.z", "force.z", "velocity.z")
if __name__ == "__main__":
    select_states(x, range(2, 13), channels=names, criterion="cross-validation", folds=5, restarts=10,
                  rng=np.random.default_rng(0), n_jobs=2)
"""
)
COMMANDS = {
    "python alone": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "import comanip": ["-c", "import comanip"],
    "comanip --help": ["-m", "comanip", "--help"],
    "import and 20 EM iterations, 10 × 300, D 3, K 5": ["-c", LEARN],
    "import hmmlearn": ["-c", "from hmmlearn import hmm"],
    "import gmr": ["-c", "import gmr"],
    "import dynamax": ["-c", "from dynamax.hidden_markov_model import GaussianHMM"],
}


def seconds(arguments: list[str]) -> float:
    before = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stderr[-300:], file=sys.stderr)
        return float("nan")
    return time.perf_counter() - before


def measure(repeats: int = 7) -> dict[str, float]:
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(repeats):
        for name, arguments in COMMANDS.items():
            times[name].append(seconds(arguments))
    found = {name: float(np.median(t)) for name, t in times.items()}
    found["K 2 to 12 × 10 restarts × 5 folds, two processes"] = seconds(["-c", CHOOSE])
    print({n: round(v, 3) for n, v in found.items()}, file=sys.stderr)
    return found


if __name__ == "__main__":
    print(measure())
