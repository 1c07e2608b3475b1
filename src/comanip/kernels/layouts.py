"""Blocks of numbers that Python and C share, each once, as names in the order of memory.

C states its own order (kernels/_layout.h), and the two are compared when the compiled module is imported: a field that moved,
came or went on one side alone fails there, by name, and not as another number in the middle of a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

BLOCKS: dict[str, tuple[str, ...]] = {
    "wrist": (
        "mass_kg", "length_m", "wrist_stiffness_nm_per_rad", "wrist_damping_nms_per_rad", "actuator_lag_s", "inertia",
        "decay", "step_s", "yy", "yv", "yu", "vy", "vv", "vu",
    ),  # plants.beam: the beam on the robot's wrist
    "person": (
        "stiffness_n_per_m", "damping_ns_per_m", "feedforward", "yields", "yielding_ns_per_m", "persistence", "lag_s",
        "dead_zone_n", "mix", "intent_step_s", "keep", "fresh", "relative", "absolute_n", "tremor_n", "phase_step",
    ),  # people.partners.Person.numbers
    "along": (
        "axial", "gravity", "start", "moves", "carried", "origin", "phase",
    ),  # of each axis: the beam, and the person along it
    "end": (
        "position", "velocity", "acceleration", "tilt", "tilt_rate", "tilt_acceleration", "sensor_force", "far_position",
        "far_velocity", "pull", "sampled",
    ),  # what a plant shows of each axis, the first numbers of C's End
    "law": (
        "virtual_mass_kg", "moving_damping_ns_per_m", "resting_damping_ns_per_m", "untaught_damping_ns_per_m",
        "moving_speed_m_per_s", "dead_zone_n",
        "anticipation", "anticipation_s", "foresight", "attraction_per_s", "start_delay_s", "comfortable_n", "yield_gain_per_n",
        "slowest_clock", "patience_s", "reach_m", "max_acceleration_m_per_s2", "shake_hz", "shake_n",
        "shake_damping_ns_per_m_per_n", "shake_memory_s", "shake_growth_per_s", "grip_hz", "grip_n",
        "grip_mass_kg_per_n", "lead_s",
    ),  # fields of skills.collaborate.CollaborativeLaw
    "policy": (
        "insist_n", "insist_ns_per_m", "stiff_ns_per_m", "ahead_n", "insist_s", "held_m_per_s", "resting_n", "resting_m_per_s",
        "start_patience_s", "midway_patience_s", "finished_m", "held_s", "probe_n", "probe_at_start_n",
        "probe_most_n", "probe_n_per_s", "nudge_m", "settles_s", "probe_s", "progress_m", "probe_damping_ns_per_m",
        "elsewhere_m", "elsewhere_n", "offers_at_start", "blend_s",
    ),  # fields of skills.roles.RolePolicy
    "limits": (
        "v_max_m_per_s", "a_max_m_per_s2", "force_limit_n", "energy_j", "stuck_s", "stuck_m", "moving_m_per_s",
        "position_jump_m", "drift_m", "blocked_n", "blocked_s", "alone_n", "alone_s", "steady_n_s", "stands_m_per_s",
        "sink_m", "pushed_n", "pushed_j", "let_go_n", "let_go_s", "held_n", "let_go_m_per_s", "tare_n", "jump_n",
        "jump_rest_s", "jump_stays_s", "comply_damping_ns_per_m", "fade_s", "rest_m_per_s", "pull_n", "impact_s", "impact_n",
        "load_n", "feel_s", "passed_s", "offer_s", "offer_n", "shake_n", "_dt", "_late", "_stale",
    ),  # of safety.limits.Limits, and of the envelope
    "scalars": (
        "_period", "_time", "_stamp", "_age", "_elapsed", "_impact_s", "_blocked_ns", "_rest_s", "_energy", "_leads", "_sinks_s",
        "_missing.known", "_missing.held", "_missing.met", "_missing.alone_s", "_missing.mistakes", "_let_go._for_s",
        "_let_go._weighed", "_sinking.sunk", "_sinking._peak", "_sinking._again_s", "_sinking.led", "_sinking._since_up_s",
        "_pushed.work", "_pushed._peak", "_jump._usual", "_jump._heard_s", "_jump._still_s", "_shaking._mean",
        "_shaking.amplitude", "_drag.ticks", "_drag.speeds", "_drag.squares", "_drag.pulls",
        "_drag.products", "_drag.error",
    ),  # the envelope's memory, lent to the compiled tick (safety/compiled_tick.py)
    "vectors": (
        "_x", "_sent", "_at", "_v", "_force", "_wanted", "_asked", "_rate", "_felt", "_senses", "_missing.zero",
        "_missing.pull", "_let_go.weight", "_stuck.last", "_stuck.same_s", "_stuck._same_m", "_stuck._changes", "_stuck._least",
        "_stuck._usual", "_stuck._dead", "_jump.last", "_shaking._slow", "_checker.at", "_checker.last",
    ),  # the same, (d,) each
    "guard": (
        "_state", "reason", "value", "_passes", "passed", "passed_value", "_passed_s", "_wait_s", "_sinks_wait_s", "_bound",
        "_feels_s", "ran", "_first", "_known", "_ticks", "confidence", "_let_go.was_mistaken", "pending", "_jump._count",
        "_jump._for_s", "fresh", "late", "limit_n",
    ),  # the envelope's memory of what stopped it; a name without "_" is of C alone, or Python has it otherwise
    "guarded": (
        "_cause", "_pulled", "_at_first", "before_jump", "jump", "jump_sum", "low", "high",
    ),  # the same, (d,) each
    "reasons": (
        "NONE", "NOT_STARTED", "POLICY", "CLOCK", "OLD", "LATE", "POSITION", "POSITION_JUMP", "FORCE", "TOO_STRONG", "VELOCITY",
        "STUCK", "TOO_HEAVY", "FORCE_JUMPED", "NOT_FOLLOWING", "GONE", "SINKS", "PUSHED", "BLOCKED", "LET_GO", "CHECKER_SPEED",
        "CHECKER_ACCELERATION", "CHECKER_ROOM", "OUTSIDE", "IN_MOTION", "PULLED", "STUCK_STILL",
    ),  # of the envelope, by number
    "role": (
        "acts", "gives", "answers", "placed", "gave_way", "put_back", "reached", "push", "meant", "blend", "complies_only",
        "outside",
    ),  # of skills.roles.RoleSkill
    "carry": (
        "dt_s", "noise_n", "bias_n", "half_mass_kg", "sums", "fastest_m_per_s", "good_s", "average", "late_ticks", "blend",
        "size_m", "effort_n", "rough_m_per_s2", "ends_early", "waits", "onset_s", "starts_by_s", "tilt_rad", "moved_m",
    ),  # of a run of the gym (gym.compiled)
    "felt": (
        "gravity", "load_kg", "offset_n", "b0", "b1", "b2", "a1", "a2", "s1", "s2", "started", "velocity", "force", "elapsed",
        "sample", "age",
    ),  # of each axis: interaction.CausalInteractionForce, lent
}  # fmt: skip


def agree(block: str, names: Iterable[str], whose: str) -> None:
    """ImportError that names the first field in which `names` differ from the block's."""
    ours, theirs = BLOCKS[block], tuple(names)
    for n in range(max(len(ours), len(theirs))):
        one, other = (some[n] if n < len(some) else "nothing" for some in (ours, theirs))
        if one != other:
            raise ImportError(
                f"block {block!r} differs at field {n + 1}: kernels/layouts.py has {one}, {whose} has {other}; give both the "
                "same order, and install comanip again where C changed"
            )


def check(stated: Mapping[str, str]) -> None:
    """ImportError where C states another block than Python: `stated` is what `_native.layouts()` gives."""
    for block in BLOCKS:
        agree(block, stated.get(block, "").split(), "C")


def packed(block: str, values: Mapping[str, Any]) -> np.ndarray:
    """The numbers of a block in its order, from their names; KeyError for a name that is missing."""
    assert len(values) == len(BLOCKS[block]), sorted(set(values) ^ set(BLOCKS[block]))
    return np.array([float(values[name]) for name in BLOCKS[block]])
