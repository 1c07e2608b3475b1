"""Learning from files that are read again in every pass: memory holds one at a time."""

from pathlib import Path

import numpy as np

from comanip import Columns, Recording, fit_stream, teach, write
from comanip.lessons.demonstration import Preparation
from comanip.lessons.shards import RecordingShards

folder = Path("out/example_stream")
folder.mkdir(parents=True, exist_ok=True)
paths = [str(folder / f"follower_{number}.mcap") for number in range(4)]
for path, lesson in zip(paths, teach("follower", len(paths), rng=np.random.default_rng(0)), strict=True):
    hand = {name: lesson[name] for name in ("hand.position", "hand.velocity", "hand.sensor_force")}
    write(Recording(hand, lesson.metadata), path)  # what each pass reads again is what it learns from, and no more

channels = ("position.z", "force.z", "velocity.z")
reader = RecordingShards(channels, Columns(), Preparation(rate_hz=100.0))
fit = fit_stream(paths, 5, channels=channels, read=reader)
print(fit)
