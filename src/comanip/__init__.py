"""comanip: teach a robot to handle things together with a person, by demonstration, with force."""

from importlib import import_module
from typing import Any

from .moved import follow

follow()

__version__ = "0.1.0"

# public name -> module, imported when first asked for, so that `import comanip` stays fast
_PUBLIC = {
    "Recording": "comanip.recording",
    "Channel": "comanip.recording",
    "read": "comanip.formats",
    "write": "comanip.formats",
    "Columns": "comanip.formats.columns",
    "LiveFile": "comanip.formats.live",
    "Demonstration": "comanip.lessons.demonstration",
    "demonstrations": "comanip.lessons.demonstration",
    "interaction_force": "comanip.interaction",
    "identify_payload": "comanip.interaction",
    "Payload": "comanip.interaction",
    "CausalInteractionForce": "comanip.interaction",
    "TaringInteractionForce": "comanip.interaction",
    "LearnedSkill": "comanip.learned.skill",
    "learn": "comanip.learned.skill",
    "make_skill": "comanip.reproduction",
    "save_skill": "comanip.learned.file",
    "load_skill": "comanip.learned.file",
    "PaperLaw": "comanip.skills.paper",
    "PaperSkill": "comanip.skills.paper",
    "CollaborativeLaw": "comanip.skills.collaborate",
    "CollaborativeSkill": "comanip.skills.collaborate",
    "Envelope": "comanip.safety.envelope",
    "Limits": "comanip.safety.envelope",
    "MassDamper": "comanip.skills.baselines",
    "Teleoperation": "comanip.skills.teleoperation",
    "Beam": "comanip.plants.beam",
    "BeamPlant": "comanip.plants.beam",
    "HumanoidPlant": "comanip.plants.humanoid",
    "ReplayPlant": "comanip.plants.replay",
    "HumanLeader": "comanip.people.partners",
    "HumanFollower": "comanip.people.partners",
    "teach": "comanip.teaching",
    "run": "comanip.loop",
    "Hmm": "comanip.models.hmm",
    "fit_hmm": "comanip.fitting.hmm",
    "Hsmm": "comanip.models.hsmm",
    "fit_hsmm": "comanip.fitting.hsmm",
    "durations_s": "comanip.models.hsmm",
    "Gmm": "comanip.models.gmm",
    "fit_gmm": "comanip.fitting.gmm",
    "Fit": "comanip.fitting.climb",
    "Regression": "comanip.models.gmr",
    "regress": "comanip.models.gmr",
    "ForwardFilter": "comanip.models.filtering",
    "DurationFilter": "comanip.models.filtering",
    "select_states": "comanip.fitting.selection",
    "backend": "comanip.parallel",
    "fit_stream": "comanip.fitting.streaming",
    "learn_stream": "comanip.learned.stream",
    "ParquetShards": "comanip.lessons.shards",
    "GaussianHMM": "comanip.peers.gaussian_hmm",
    "GaussianMixtureRegressor": "comanip.peers.regressor",
    "GMM": "comanip.peers.gmm",
    "MVN": "comanip.peers.mvn",
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
