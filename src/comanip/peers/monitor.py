"""How an estimator's fit is watched."""

from __future__ import annotations

import logging
import sys
from collections import deque

import numpy as np

_log = logging.getLogger(__name__)


class ConvergenceMonitor:
    """Watches the likelihood during `fit`: `history` of log-likelihoods, `iter` count, `converged`."""

    def __init__(self, tol: float, n_iter: int, verbose: bool) -> None:
        self.tol, self.n_iter, self.verbose = tol, n_iter, verbose
        self.history: deque[float] = deque()
        self.iter = 0

    def _reset(self) -> None:
        self.iter = 0
        self.history.clear()

    def report(self, log_prob: float) -> None:
        gain = log_prob - self.history[-1] if self.history else np.nan
        if self.verbose:
            print(f"{self.iter + 1:>10d} {log_prob:>16.8f} {gain:>+16.8f}", file=sys.stderr)
        if gain < -1e-8 * max(abs(log_prob), 1.0):
            _log.warning("The likelihood fell by %g to %g: a prior outweighs the data.", -gain, log_prob)
        self.history.append(float(log_prob))
        self.iter += 1

    @property
    def converged(self) -> bool:
        """True also when the iterations ran out: hmmlearn's meaning. `fit_hmm` tells the two apart."""
        few = len(self.history) < 2
        return self.iter == self.n_iter or (not few and self.history[-1] - self.history[-2] < self.tol)
