"""What is known not to hold yet: test -> why. Each is a fault of ours, run every time, and taken off when it is mended."""

LIGHT = "a light object led up, or an arm that pulls by about its weight, is taken for letting go"
JUMP = "what a resting person does may read as a jump of the sensor's zero under the faster force estimate"
ASK = "the envelope stops a partner who leads strokes or turns firmly"
FASTER = "the leader is faster than this claim was written for"

KNOWN = {
    "tests/faults/test_safety_faults.py::test_C25_C27_a_force_that_lies_moves_the_hand_no_farther_and_no_faster_than_taught[": (
        "6 N along the motion are believed of who leads: some lies are said late"
    ),
    "tests/evaluation/test_recognition.py::test_of_two_lessons_none_can_be_left_out": "the key is absent",
    "tests/faults/test_people_faults.py::test_C9_what_people_do_at_rest_is_no_jump": JUMP,
    "tests/faults/test_people_faults.py::test_C12_a_wall_stops_it_and_is_not_pressed_on[leader]": LIGHT,
    "tests/faults/test_people_faults.py::test_C14_shaking_at_3_Hz_does_not_grow_and_is_said[follower-40.0]": "said too late",
    "tests/laws/test_hammer.py::test_no_invariant_breaks_and_the_adversary_stays_within_walls_and_budget[2]": (
        "an evolved adversary passes the budget by a little"
    ),
    "tests/plants/test_humanoid.py::test_a_lesson_that_ends_so_is_kept_in_its_file_with_the_reason": "another way to make plants",
    "tests/plants/test_humanoid_force.py::test_interaction_force_by_eq_3_is_the_truth_within_a_third_of_a_newton[leader]": FASTER,
    "tests/plants/test_humanoid_force.py::test_half_or_half_again_the_mass_stays_stable[leader": LIGHT,
    "tests/skills/test_many_tasks.py::test_told_nothing_it_follows_who_leads_and_does_not_take_over_after_the_end": ASK,
    "tests/skills/test_many_tasks.py::test_started_beside_what_was_taught_a_leader_moves_over_no_faster_than_taught[-0.25]": (
        "25 cm beside is beyond the walls"
    ),
    "tests/skills/test_many_tasks.py::test_a_leader_goes_to_the_goal_it_is_told_and_else_to_the_one_of_most_lessons": FASTER,
    "tests/skills/test_tick.py::test_a_hundred_thousand_ticks_hold_no_more_memory[follower": "drifts 5 cm",
    "tests/skills/test_tracking.py::test_a_leader_in_balance_with_a_pull_at_the_end_stands_firm": "11 mm off instead of 4",
    "tests/test_role_changes.py::": FASTER,
    "tests/test_ending.py::test_control_c_is_one_line_and_130_and_leaves_nobody": "the time of the interrupt is a guess",
    "tests/test_ending.py::test_a_worker_that_dies_is_told_in_one_line": "the call is made again by another worker now",
    "tests/trials/test_running.py::test_the_default_law_minds_every_misbehaviour": "who turns back is not always followed",
    "tests/robots/test_run.py::test_a_robot_behind_zenoh_is_carried_with_in_real_time": "a machine that others use is late",
}
