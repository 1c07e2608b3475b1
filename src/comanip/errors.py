"""Every error comanip raises on purpose.

A message says what was wrong, what was given, what is allowed and what to try, in one line:
"channel 'hand.forse' is not in this recording; it has: hand.force, hand.position".
"""


class ComanipError(Exception):
    """Base of all errors a user can act on; the command line prints it as one line and exits with 2."""


class RecordingError(ComanipError):
    """A file or recording that cannot be read as it is: names file, channel, frame, time and value."""


class ChannelError(ComanipError):
    """A channel name, unit, frame or shape that does not fit; lists what there is."""


class TrainingError(ComanipError):
    """Data from which no model can be learned as asked: too short, constant, not finite."""


class SkillFileError(ComanipError):
    """A skill file that is damaged, foreign, newer than this program, or not what was asked for."""


class MismatchError(ComanipError):
    """A skill that was learned for another robot: other channels, units, axes, role or control period."""


class ParameterError(ComanipError):
    """A parameter outside what is allowed."""


class BackendError(ComanipError):
    """A cluster that was asked for and cannot be used: absent, unreachable, or of another version."""


class InternalError(ComanipError):
    """A law of the method was broken (for example a likelihood that fell): a defect of comanip, please report it."""


class ComanipWarning(UserWarning):
    """Something was suspicious, or was changed: said, never silent."""
