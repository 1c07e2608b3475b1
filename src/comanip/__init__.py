"""comanip: teach a robot to handle things together with a person, by demonstration, with force."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# public name -> module, imported when first asked for, so that `import comanip` stays fast
_PUBLIC = {
    "Hmm": "comanip.models.hmm",
    "fit_hmm": "comanip.models.hmm",
    "Gmm": "comanip.models.gmm",
    "fit_gmm": "comanip.models.gmm",
    "Fit": "comanip.models.learning",
    "Regression": "comanip.models.gmr",
    "regress": "comanip.models.gmr",
    "ForwardFilter": "comanip.models.filtering",
    "select_states": "comanip.models.selection",
    "GaussianHMM": "comanip.models.estimators.gaussian_hmm",
    "GaussianMixtureRegressor": "comanip.models.estimators.regressor",
    "GMM": "comanip.models.estimators.gmm",
    "MVN": "comanip.models.estimators.mvn",
}

__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    try:
        module = _PUBLIC[name]
    except KeyError:
        raise AttributeError(f"module 'comanip' has no attribute {name!r}; it has: {', '.join(_PUBLIC)}") from None
    return getattr(import_module(module), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
