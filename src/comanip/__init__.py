"""comanip: teach a robot to handle things together with a person, by demonstration, with force."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# public name -> module, imported when first asked for, so that `import comanip` stays fast
_PUBLIC = {
    "Recording": "comanip.recording",
    "Channel": "comanip.recording",
    "read": "comanip.formats",
    "write": "comanip.formats",
    "Columns": "comanip.formats.columns",
    "LiveFile": "comanip.formats.live",
    "Demonstration": "comanip.demonstration",
    "demonstrations": "comanip.demonstration",
    "interaction_force": "comanip.interaction",
    "identify_payload": "comanip.interaction",
    "Payload": "comanip.interaction",
    "CausalInteractionForce": "comanip.interaction",
    "TaringInteractionForce": "comanip.interaction",
    "LearnedSkill": "comanip.learned",
    "learn": "comanip.learned",
    "make_skill": "comanip.reproduction",
    "save_skill": "comanip.skill_file",
    "load_skill": "comanip.skill_file",
    "PaperLaw": "comanip.skills.paper",
    "PaperSkill": "comanip.skills.paper",
    "CollaborativeLaw": "comanip.skills.collaborate",
    "CollaborativeSkill": "comanip.skills.collaborate",
    "Envelope": "comanip.skills.envelope",
    "Limits": "comanip.skills.envelope",
    "MassDamper": "comanip.skills.baselines",
    "Teleoperation": "comanip.skills.teleoperation",
    "Beam": "comanip.plants.beam",
    "BeamPlant": "comanip.plants.beam",
    "HumanoidPlant": "comanip.plants.humanoid",
    "ReplayPlant": "comanip.plants.replay",
    "HumanLeader": "comanip.plants.partners",
    "HumanFollower": "comanip.plants.partners",
    "teach": "comanip.teaching",
    "run": "comanip.loop",
    "Hmm": "comanip.models.hmm",
    "fit_hmm": "comanip.models.hmm",
    "Hsmm": "comanip.models.hsmm",
    "fit_hsmm": "comanip.models.hsmm",
    "durations_s": "comanip.models.hsmm",
    "Gmm": "comanip.models.gmm",
    "fit_gmm": "comanip.models.gmm",
    "Fit": "comanip.models.learning",
    "Regression": "comanip.models.gmr",
    "regress": "comanip.models.gmr",
    "ForwardFilter": "comanip.models.filtering",
    "DurationFilter": "comanip.models.filtering",
    "select_states": "comanip.models.selection",
    "backend": "comanip.engine",
    "fit_stream": "comanip.models.streaming",
    "learn_stream": "comanip.streamed",
    "ParquetShards": "comanip.shards",
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
    return getattr(import_module(module), {"save_skill": "save", "load_skill": "load"}.get(name, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
