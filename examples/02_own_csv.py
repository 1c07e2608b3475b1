"""A CSV with columns of other names and units: the mapping is said once, the conversion is noted."""

from pathlib import Path

import numpy as np

from comanip import Columns, demonstrations, read

path = Path("out/example_lift.csv")
path.parent.mkdir(exist_ok=True)
t = np.arange(0.0, 4.0, 0.005)
height = 850.0 + 300.0 / (1.0 + np.exp(-4.0 * (t - 2.0)))  # [mm]
force = 0.02 * np.gradient(height, t) + np.random.default_rng(0).normal(0.0, 0.05, len(t))  # [N]
np.savetxt(path, np.column_stack([t, height, force]), delimiter=",", header="stamp,height_mm,pull", comments="")

columns = Columns(time="stamp", position="height_mm", position_unit="mm", force="pull")
(lesson,) = demonstrations(read(path, columns), rate_hz=100)
print(lesson)
print(f"from {lesson.position[0, 0]:.3f} m to {lesson.position[-1, 0]:.3f} m, at most {lesson.velocity.max():.2f} m/s")
for note in lesson.notes:
    print("-", note)
