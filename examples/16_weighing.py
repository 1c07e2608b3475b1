"""Eq. (3): weigh the load in a window at rest, take the sensor's bias out, and get the force that the partner means."""

import numpy as np

from comanip import identify_payload, interaction_force

G = np.array([0.0, 0.0, -9.80665])  # gravity in the task frame x, y, z [m/s^2]
rng = np.random.default_rng(16)
bias = np.array([0.4, -0.2, 1.1])  # [N], nobody knows it
empty = bias + rng.normal(0.0, 0.2, (300, 3))  # nothing in the hand
holding = bias + 0.5 * 3.0 * G + rng.normal(0.0, 0.2, (300, 3))  # half of a 3 kg object, both at rest

payload = identify_payload(holding, gravity=G, empty=empty)
print(f"mass {payload.mass_kg:.3f} +- {payload.mass_std_kg:.3f} kg; bias {np.round(payload.force_bias_n, 2)} N")

sensed = bias + 0.5 * 3.0 * (G - [0.0, 0.0, 0.8]) + [0.0, 0.0, 4.0]  # accelerating up at 0.8 m/s^2, lifted with 4 N
force = interaction_force(sensed - payload.force_bias_n, np.array([0.0, 0.0, 0.8]), mass_kg=payload.mass_kg, gravity=G)
print("the partner's force:", np.round(force, 2), "N")
