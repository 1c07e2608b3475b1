"""Lessons from arrays in memory: position and force are enough, what is derived is said."""

import numpy as np

from comanip import Channel, Recording, demonstrations, learn


def lift(rng: np.random.Generator) -> Recording:
    """0.3 m up in about 2 s, pulled by a partner; replace it by your own arrays."""
    t = np.arange(0.0, 4.0, 0.01)  # [s]
    s = np.clip((t - 1.0) / rng.normal(2.0, 0.1), 0.0, 1.0)
    z = 0.85 + rng.normal(0.30, 0.01) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)  # [m]
    force = 25.0 * np.gradient(z, t) + rng.normal(0.0, 0.05, len(t))  # [N] of the partner on the hand
    return Recording(
        {
            "hand.position": Channel(t, z[:, None], unit="m", frame="base", axes=("z",)),
            "hand.force": Channel(t, force[:, None], unit="N", frame="base", axes=("z",)),
        },
        {"role": "follower"},
    )


rng = np.random.default_rng(1)
lessons = demonstrations([lift(rng) for _ in range(5)], rate_hz=100)
skill = learn(lessons)
print(lessons[0])
print(skill)
for note in skill.notes:
    print("-", note)
