"""The paper's own law: what it does with recorded force, and what becomes of it with a living partner."""

import numpy as np

from comanip import demonstrations, draw_case, learn, leave_one_out, run_cases, teach

lessons = demonstrations(teach("follower", rng=np.random.default_rng(0)), rate_hz=100)
predictions = leave_one_out(lessons, law="paper")
print("recorded force: free run within", [f"{100 * p.free_run_position_rmse_m:.1f} cm" for p in predictions])

learned = {"follower": learn(lessons, law="paper")}
rng = np.random.default_rng(14)
cases = [draw_case("follower", rng) for _ in range(20)]
for law in ("paper", "default"):
    verdicts = run_cases(cases, learned, law)
    print(f"living partners, law {law!r}: {sum(v.success for v in verdicts)} of {len(cases)} lifts succeed")
