"""The hand goes where it is told, level and at speed; the arm refuses what its joints cannot do. Checked against mink."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.people.partners import minimum_jerk
from comanip.plants.humanoid import InverseKinematics, load_robot
from comanip.plants.humanoid.scene import build

mujoco = pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")

STEP_S = 0.005


@pytest.fixture(scope="module")
def robot():
    return load_robot("hrp2-class")


@pytest.fixture(scope="module")
def scene(robot):
    return build(robot, load_mass_kg=2.0, length_m=0.8)


@pytest.fixture
def ik(scene, robot):
    return started(scene, robot)


def started(scene, robot, **settings):
    ik = InverseKinematics(scene, robot, step_s=STEP_S, **settings)
    ik.stand_at(mujoco.MjData(scene.model).qpos[:7])
    ik.reach(np.array(robot.grasp_m))
    return ik


def lifted(ik, lift_m, duration_s):
    """Joints, hand positions and tilts (rotation angle away from level) along a minimum-jerk lift."""
    joints, hands, tilts, wanted = [], [], [], []
    start = ik.hand()[0][2]
    steps = round(duration_s / STEP_S)
    for n in range(steps):
        wanted.append(start + lift_m * minimum_jerk((n + 1) / steps)[0])
        ik.step(np.array([wanted[-1] - (wanted[-2] if n else start)]) / STEP_S)
        position, rotation = ik.hand()
        joints.append(ik.joints.copy())
        hands.append(position)
        tilts.append(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    return np.array(joints), np.array(hands), np.array(tilts), np.array(wanted)


def test_the_whole_lift_is_followed_within_a_millimetre_and_half_a_degree(ik, robot):
    _, hands, tilts, wanted = lifted(ik, 0.38, 1.6)
    assert np.abs(hands[:, 2] - wanted).max() < 1e-3
    assert np.abs(hands[:, :2] - robot.grasp_m[:2]).max() < 1e-3
    assert np.degrees(tilts.max()) < 0.5


def test_joints_agree_with_mink(ik, scene, robot):
    mink = pytest.importorskip("mink", reason="mink is the oracle of this test: pip install mink")
    ours, *_ = lifted(ik, 0.38, 2.0)
    configuration = mink.Configuration(scene.model, q=mujoco.MjData(scene.model).qpos.copy())
    q = configuration.q.copy()
    start = started(scene, robot).joints
    q[scene.position_at] = start
    configuration.update(q)
    task = mink.FrameTask(robot.grasp, "site", position_cost=1.0, orientation_cost=1.0)
    others = np.setdiff1d(np.arange(scene.model.nv), scene.velocity_at[scene.arm])
    steps = len(ours)
    for n in range(0, steps):
        height = robot.grasp_m[2] + 0.38 * minimum_jerk((n + 1) / steps)[0]
        task.set_target(mink.SE3.from_rotation_and_translation(mink.SO3.identity(), np.array([*robot.grasp_m[:2], height])))
        frozen = mink.DofFreezingTask(scene.model, others.tolist())
        velocity = mink.solve_ik(configuration, [task], STEP_S, solver="daqp", constraints=[frozen])
        configuration.integrate_inplace(velocity, STEP_S)
        if n % 20 == 19:
            apart = configuration.q[scene.position_at] - ours[n]
            assert np.degrees(np.abs(apart).max()) < 0.2
    assert np.degrees(np.abs(ours[-1] - start)[scene.arm].max()) > 20.0  # they agree about a real motion


def test_reach_puts_the_beam_level_where_it_was_asked(scene, robot):
    ik = started(scene, robot)
    for height in (0.85, 1.0, 1.23):
        ik.reach(np.array([0.48, -0.25, height]))
        position, rotation = ik.hand()
        assert position == pytest.approx([0.48, -0.25, height], abs=1e-6)
        assert rotation == pytest.approx(np.eye(3), abs=1e-6)


def test_what_is_out_of_reach_is_refused_with_numbers(ik):
    with pytest.raises(ParameterError, match=r"cannot hold the beam level at \[0.48, -0.25, 2.0\] m.*start elsewhere"):
        ik.reach(np.array([0.48, -0.25, 2.0]))


def test_towards_a_straight_elbow_the_hand_slows_down_and_joints_keep_their_speed(ik, scene, robot):
    """O8: below 0.80 m the elbow is straight. Commanded down at 0.3 m/s, the arm may not jerk."""
    limits = np.array([robot.servo_of(j).speed for j in robot.arm])
    before, heights = ik.joints[scene.arm].copy(), []
    for _ in range(200):
        ik.step(np.array([-0.3]))
        speed = np.abs(ik.joints[scene.arm] - before) / STEP_S
        assert (speed <= limits + 1e-9).all()
        before = ik.joints[scene.arm].copy()
        heights.append(ik.hand()[0][2])
    assert np.isfinite(heights).all()
    assert ik.singular_values()[-1] < 0.05  # it did come close to singular
    fall = np.diff(heights) / STEP_S
    assert fall[:5].mean() == pytest.approx(-0.3, abs=0.01)
    assert np.abs(fall[-20:]).max() < 0.05
    assert np.abs(ik.hand()[0][:2] - robot.grasp_m[:2]).max() < 0.004  # slower, and within the damping still on its line
    for _ in range(100):
        ik.step(np.array([0.2]))
    assert ik.hand()[0][2] > heights[-1] + 0.03  # and it comes back


def test_a_hand_that_is_asked_for_too_much_keeps_its_line_and_every_joint_its_speed(ik, scene, robot):
    """O8: 6 m/s upwards would take 20 rad/s at the shoulder."""
    limits = np.array([robot.servo_of(j).speed for j in robot.arm])
    before, start, fastest = ik.joints[scene.arm].copy(), ik.hand()[0], np.zeros(6)
    for _ in range(30):
        ik.step(np.array([6.0]))
        assert ik.slowed < 1.0
        assert ik.holds_back
        fastest = np.maximum(fastest, np.abs(ik.joints[scene.arm] - before) / STEP_S)
        before = ik.joints[scene.arm].copy()
    assert (fastest / limits).max() == pytest.approx(1.0, abs=1e-6)
    assert ik.hand()[0][2] > start[2] + 0.1
    assert np.abs(ik.hand()[0][:2] - start[:2]).max() < 0.02


@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.parametrize("number", range(6))
def test_every_joint_brakes_before_either_end_of_its_range(scene, robot, number, end):
    """O9: a hand motion that drives one joint into its limit ends in front of it, with the stated braking."""
    ik = started(scene, robot, braking_rad_per_s2=20.0)
    joint = scene.joints[scene.arm[number]]
    low, high = scene.model.jnt_range[scene.model.joint(joint).id]
    dof = scene.velocity_at[scene.arm[number]]
    sign = 1.0 if end == "high" else -1.0
    jacobian, path = np.zeros((6, scene.model.nv)), []
    for _ in range(1500):
        ik.hand()
        mujoco.mj_jacSite(scene.model, ik._data, jacobian[:3], jacobian[3:], scene.grasp_site)
        ik.move(sign * 2.0 * STEP_S * jacobian[:, dof])
        path.append(ik.joints[scene.arm[number]])
        arm = ik.joints[scene.arm]
        ranges = scene.model.jnt_range[[scene.model.joint(j).id for j in robot.arm]]
        assert (arm >= ranges[:, 0]).all()
        assert (arm <= ranges[:, 1]).all()
    speed = np.diff(path) / STEP_S
    assert np.abs(speed[-1]) < 1e-3  # it stopped
    assert np.abs(speed).max() > 1.0  # after it had moved
    gap = min(path[-1] - low, high - path[-1])
    stopped_by_another = (ik.joints[scene.arm] - ranges[:, 0]).min() < 0.02 or (ranges[:, 1] - ik.joints[scene.arm]).min() < 0.02
    assert gap < 0.02 or stopped_by_another
    assert np.diff(np.abs(speed)).min() / STEP_S > -20.0 * 1.3


def test_with_joints_to_spare_the_arm_returns_to_its_posture_without_moving_the_hand():
    pytest.importorskip("jvrc_description", reason="JVRC-1 comes with: pip install jvrc-description")
    robot = load_robot("jvrc1")
    scene = build(robot, load_mass_kg=2.0, length_m=0.8)
    ik = InverseKinematics(scene, robot, step_s=STEP_S)
    base = mujoco.MjData(scene.model).qpos[:7].copy()
    base[2] = 0.743
    ik.stand_at(base)
    ik.reach(np.array(robot.grasp_m))
    place = ik.hand()[0]
    null = np.linalg.svd(ik._arm_jacobian())[2][-1]
    ik.joints[scene.arm] += 0.2 * null
    away = np.linalg.norm((ik.joints - scene.posture)[scene.arm] @ np.outer(null, null))
    for _ in range(400):
        ik.step(np.zeros(1))
    assert ik.hand()[0] == pytest.approx(place, abs=1e-4)
    assert np.linalg.norm((ik.joints - scene.posture)[scene.arm] @ np.outer(null, null)) < 0.5 * away
