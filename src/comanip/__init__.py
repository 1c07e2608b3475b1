"""comanip: teach a robot to handle things together with a person, by demonstration, with force."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .moved import follow

follow()

__version__ = "0.2.0"

# public name -> its module, imported when first asked for, so that `import comanip` stays fast
_PUBLIC = {
    # Recordings and lessons
    "Recording": "comanip.recording",
    "Channel": "comanip.recording",
    "read": "comanip.formats",
    "write": "comanip.formats",
    "Columns": "comanip.formats.columns",
    "LiveFile": "comanip.formats.live",
    "Demonstration": "comanip.lessons.demonstration",
    "demonstrations": "comanip.lessons.demonstration",
    "ParquetShards": "comanip.lessons.shards",
    "interaction_force": "comanip.interaction",
    "identify_payload": "comanip.interaction",
    "Payload": "comanip.interaction",
    "CausalInteractionForce": "comanip.interaction",
    "TaringInteractionForce": "comanip.interaction",
    # Learning a skill
    "LearnedSkill": "comanip.learned.skill",
    "learn": "comanip.learned.learn",
    "learn_stream": "comanip.learned.stream",
    "save_skill": "comanip.learned.file",
    "load_skill": "comanip.learned.file",
    # Running it
    "make_skill": "comanip.reproduction",
    "make_auto": "comanip.reproduction",
    "run": "comanip.loop",
    "SimulatedClock": "comanip.loop",
    "WallClock": "comanip.loop",
    "CollaborativeLaw": "comanip.skills.collaborate",
    "CollaborativeSkill": "comanip.skills.collaborate",
    "PaperLaw": "comanip.skills.paper",
    "PaperSkill": "comanip.skills.paper",
    "RolePolicy": "comanip.skills.roles",
    "Arbiter": "comanip.skills.arbiter",
    "MassDamper": "comanip.skills.baselines",
    "Envelope": "comanip.safety.envelope",
    "Limits": "comanip.safety.envelope",
    # Sockets
    "Observation": "comanip.interfaces",
    "Command": "comanip.interfaces",
    "Skill": "comanip.interfaces",
    "Plant": "comanip.interfaces",
    "Partner": "comanip.interfaces",
    "HapticDevice": "comanip.interfaces",
    "Tap": "comanip.interfaces",
    # Plants, people, teaching
    "Beam": "comanip.plants.beam",
    "WristSensor": "comanip.plants.beam",
    "BeamPlant": "comanip.plants.beam",
    "HumanoidPlant": "comanip.plants.humanoid",
    "ReplayPlant": "comanip.plants.replay",
    "HumanLeader": "comanip.people.partners",
    "HumanFollower": "comanip.people.partners",
    "HumanSharing": "comanip.people.partners",
    "teach": "comanip.teaching",
    "Teleoperation": "comanip.skills.teleoperation",
    # Evaluation and trials
    "predict": "comanip.evaluation.prediction",
    "leave_one_out": "comanip.evaluation.prediction",
    "classify": "comanip.evaluation.recognition",
    "recognise": "comanip.evaluation.recognition",
    "draw_case": "comanip.trials",
    "run_case": "comanip.trials",
    "run_cases": "comanip.trials",
    "judge": "comanip.trials",
    "success_interval": "comanip.trials",
    # Models
    "Hmm": "comanip.models.hmm",
    "fit_hmm": "comanip.fitting.hmm",
    "Hsmm": "comanip.models.hsmm",
    "fit_hsmm": "comanip.fitting.hsmm",
    "durations_s": "comanip.models.hsmm",
    "Gmm": "comanip.models.gmm",
    "fit_gmm": "comanip.fitting.gmm",
    "Fit": "comanip.fitting.climb",
    "fit_stream": "comanip.fitting.streaming",
    "select_states": "comanip.fitting.selection",
    "Regression": "comanip.models.gmr",
    "regress": "comanip.models.gmr",
    "ForwardFilter": "comanip.models.filtering",
    "DurationFilter": "comanip.models.filtering",
    "backend": "comanip.parallel",
    # Interfaces of hmmlearn, gmr and scikit-learn
    "GaussianHMM": "comanip.peers.gaussian_hmm",
    "GaussianMixtureRegressor": "comanip.peers.regressor",
    "GMM": "comanip.peers.gmm",
    "MVN": "comanip.peers.mvn",
    # Errors
    "ComanipError": "comanip.errors",
}
_OWN_NAME = {"save_skill": "save", "load_skill": "load"}  # where the module has a shorter one

if TYPE_CHECKING:  # the same once more for type checkers and editors; a test compares the two
    from .errors import ComanipError as ComanipError
    from .evaluation.prediction import leave_one_out as leave_one_out
    from .evaluation.prediction import predict as predict
    from .evaluation.recognition import classify as classify
    from .evaluation.recognition import recognise as recognise
    from .fitting.climb import Fit as Fit
    from .fitting.gmm import fit_gmm as fit_gmm
    from .fitting.hmm import fit_hmm as fit_hmm
    from .fitting.hsmm import fit_hsmm as fit_hsmm
    from .fitting.selection import select_states as select_states
    from .fitting.streaming import fit_stream as fit_stream
    from .formats import read as read
    from .formats import write as write
    from .formats.columns import Columns as Columns
    from .formats.live import LiveFile as LiveFile
    from .interaction import CausalInteractionForce as CausalInteractionForce
    from .interaction import Payload as Payload
    from .interaction import TaringInteractionForce as TaringInteractionForce
    from .interaction import identify_payload as identify_payload
    from .interaction import interaction_force as interaction_force
    from .interfaces import Command as Command
    from .interfaces import HapticDevice as HapticDevice
    from .interfaces import Observation as Observation
    from .interfaces import Partner as Partner
    from .interfaces import Plant as Plant
    from .interfaces import Skill as Skill
    from .interfaces import Tap as Tap
    from .learned.file import load as load_skill  # noqa: F401
    from .learned.file import save as save_skill  # noqa: F401
    from .learned.learn import learn as learn
    from .learned.skill import LearnedSkill as LearnedSkill
    from .learned.stream import learn_stream as learn_stream
    from .lessons.demonstration import Demonstration as Demonstration
    from .lessons.demonstration import demonstrations as demonstrations
    from .lessons.shards import ParquetShards as ParquetShards
    from .loop import SimulatedClock as SimulatedClock
    from .loop import WallClock as WallClock
    from .loop import run as run
    from .models.filtering import DurationFilter as DurationFilter
    from .models.filtering import ForwardFilter as ForwardFilter
    from .models.gmm import Gmm as Gmm
    from .models.gmr import Regression as Regression
    from .models.gmr import regress as regress
    from .models.hmm import Hmm as Hmm
    from .models.hsmm import Hsmm as Hsmm
    from .models.hsmm import durations_s as durations_s
    from .parallel import backend as backend
    from .peers.gaussian_hmm import GaussianHMM as GaussianHMM
    from .peers.gmm import GMM as GMM
    from .peers.mvn import MVN as MVN
    from .peers.regressor import GaussianMixtureRegressor as GaussianMixtureRegressor
    from .people.partners import HumanFollower as HumanFollower
    from .people.partners import HumanLeader as HumanLeader
    from .people.partners import HumanSharing as HumanSharing
    from .plants.beam import Beam as Beam
    from .plants.beam import BeamPlant as BeamPlant
    from .plants.beam import WristSensor as WristSensor
    from .plants.humanoid import HumanoidPlant as HumanoidPlant
    from .plants.replay import ReplayPlant as ReplayPlant
    from .recording import Channel as Channel
    from .recording import Recording as Recording
    from .reproduction import make_auto as make_auto
    from .reproduction import make_skill as make_skill
    from .safety.envelope import Envelope as Envelope
    from .safety.envelope import Limits as Limits
    from .skills.arbiter import Arbiter as Arbiter
    from .skills.baselines import MassDamper as MassDamper
    from .skills.collaborate import CollaborativeLaw as CollaborativeLaw
    from .skills.collaborate import CollaborativeSkill as CollaborativeSkill
    from .skills.paper import PaperLaw as PaperLaw
    from .skills.paper import PaperSkill as PaperSkill
    from .skills.roles import RolePolicy as RolePolicy
    from .skills.teleoperation import Teleoperation as Teleoperation
    from .teaching import teach as teach
    from .trials import draw_case as draw_case
    from .trials import judge as judge
    from .trials import run_case as run_case
    from .trials import run_cases as run_cases
    from .trials import success_interval as success_interval

__all__ = ["__version__", *_PUBLIC]


def _tell_gymnasium() -> None:
    """Whoever has Gymnasium loaded may ask it for comanip/Carry-v0: a name in its registry, and nothing more is loaded."""
    if "gymnasium" in sys.modules:
        import_module("comanip.gym")


_tell_gymnasium()


def __getattr__(name: str) -> Any:
    try:
        module = _PUBLIC[name]
    except KeyError:
        raise AttributeError(f"module 'comanip' has no attribute {name!r}; it has: {', '.join(_PUBLIC)}") from None
    return getattr(import_module(module), _OWN_NAME.get(name, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
