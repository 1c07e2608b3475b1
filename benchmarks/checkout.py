"""pbdlib, where a checkout of it is given: `make bench PBDLIB=path`. It is on no package index."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np


def package() -> Any:
    """The package in the folder that PBDLIB names; ImportError without one, as of any other absent peer."""
    folder = os.environ.get("PBDLIB")
    if not folder:
        raise ImportError("no checkout of pbdlib is given: PBDLIB is not set")
    if folder not in sys.path:
        sys.path.insert(0, folder)
    import pbdlib

    return pbdlib


def model(initial: np.ndarray, transition: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> Any:
    """Its HMM with these parameters; copies, for its EM writes into what it was given."""
    hmm = package().HMM(len(initial), means.shape[1])
    hmm.mu, hmm.sigma = means.copy(), covariances.copy()
    hmm.init_priors, hmm.Trans, hmm.priors = initial.copy(), transition.copy(), initial.copy()
    return hmm
