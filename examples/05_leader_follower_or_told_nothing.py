"""The three roles with the same kind of partners: success, effort and highest force, as the README's table."""

import numpy as np

from comanip import demonstrations, draw_case, learn, run_cases, success_interval, teach

PARTNERS = 20

learned = {role: learn(demonstrations(teach(role, rng=np.random.default_rng(0)), rate_hz=100)) for role in ("leader", "follower")}
for role in ("leader", "follower", "auto"):
    rng = np.random.default_rng(5)
    verdicts = run_cases([draw_case(role, rng) for _ in range(PARTNERS)], learned, "default")
    good = sum(v.success for v in verdicts)
    low, high = success_interval(good, PARTNERS)
    effort = np.median([v.effort_n2s for v in verdicts])
    print(f"{role:9} {good} of {PARTNERS} ({low:.0%} to {high:.0%}); effort {effort:.1f} N^2 s (median)")
