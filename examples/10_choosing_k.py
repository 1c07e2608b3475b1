"""How many states? Every count is tried on lessons that it did not learn from."""

import numpy as np

from comanip import demonstrations, select_states, teach

lessons = demonstrations(teach("follower", rng=np.random.default_rng(0)), rate_hz=100)
channels = lessons[0].channels
sequences = [lesson.array(channels) for lesson in lessons]
print(select_states(sequences, range(2, 11, 2), channels=channels, criterion="cross-validation"))
