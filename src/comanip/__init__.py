"""comanip: teach a robot to handle things together with a person, by demonstration, with force."""

__version__ = "0.1.0"
