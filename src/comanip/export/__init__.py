"""A skill, its envelope and its force estimate as source that runs without Python: one C file, and what goes around it."""
