"""People as partners and as teachers: what they intend, how their arms answer, how they misbehave, and the kinds of them."""

from .body import Body, draw_body
from .intent import Course
from .kinds import GROUPS, KINDS, Kind, for_tuning, kind_of, make, names_of, planned
from .person import Hand, Person, Together

__all__ = [
    "GROUPS",
    "KINDS",
    "Body",
    "Course",
    "Hand",
    "Kind",
    "Person",
    "Together",
    "draw_body",
    "for_tuning",
    "kind_of",
    "make",
    "names_of",
    "planned",
]
