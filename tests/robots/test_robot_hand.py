"""A hand around any arm, and the arm behind ROS's messages: frames, the leash, braking."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from arms import POSE, TWIST, WRENCH, Clock, about, commanding, hand

from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.loop import run
from comanip.robots import turns
from comanip.robots.arm import Sensed
from comanip.robots.hand import HandPlant
from comanip.robots.messages import Reader, Writer, packed
from comanip.robots.ros2 import Ros2Arm
from comanip.robots.settings import Topic
from comanip.robots.wire import Loopback

QUARTER = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))  # about z: x becomes y


def observed(plant):
    obs = Observation(len(plant.axes))
    plant.read(obs)
    return obs


def commanded(plant, *velocity):
    command = Command(len(plant.axes))
    command.velocity[:] = velocity
    plant.write(command)


AXES = [{"z": [0, 0, 1]}, {"down": [0, 0, -1]}, {"a": [1, 1, 0], "b": [-1, 1, 0]}, {"q": [0.6, 0, 0.8]}]


@pytest.mark.parametrize("axes", AXES)
def test_task_axes_are_directions_and_a_velocity_along_them_comes_out_along_them(axes):
    plant, arm, _clock = hand(axes=axes)
    unit = {n: np.array(v) / np.linalg.norm(v) for n, v in axes.items()}
    obs = observed(plant)
    for i, direction in enumerate(unit.values()):
        assert obs.position[i] == pytest.approx(direction @ arm.position)
        assert obs.sensor_force[i] == pytest.approx(direction @ arm.force)
    wanted = 0.1 * np.arange(1, len(axes) + 1)
    commanded(plant, *wanted)
    velocity = np.array(arm.sent[-1][0])
    assert [direction @ velocity for direction in unit.values()] == pytest.approx(wanted)
    assert np.linalg.norm(velocity) == pytest.approx(np.linalg.norm(wanted))


def test_a_velocity_that_nobody_measures_is_told_from_poses():
    plant, arm, clock = hand()
    plant.reset()
    for _ in range(20):
        obs = observed(plant)
        clock.now += 0.01
        arm.position = (0.1, 0.2, arm.position[2] + 0.003)
    assert obs.velocity[0] == pytest.approx(0.3, rel=1e-3)


def test_a_target_is_never_farther_from_the_hand_than_the_leash():
    plant, arm, clock = hand(command=commanding("pose", leash_m=0.02))
    for _ in range(100):
        observed(plant)
        commanded(plant, 0.5)  # the arm does not follow
        assert np.linalg.norm(np.subtract(arm.sent[-1][1], arm.position)) <= 0.02 + 1e-12
        clock.now += plant.dt
    assert arm.sent[-1][1][2] == pytest.approx(arm.position[2] + 0.02)


def test_an_arm_that_was_away_is_held_where_it_is_and_not_pulled_to_where_it_was():
    plant, arm, clock = hand()
    observed(plant)
    commanded(plant, 0.3)
    arm.time = clock.now  # silent from now on
    for _ in range(30):
        clock.now += plant.dt
        observed(plant)
        commanded(plant, 0.3)
    assert arm.sent[-1][0] == (0.0, 0.0, 0.0)
    arm.time, arm.position, arm.orientation = None, (0.1, 0.2, 0.5), QUARTER
    observed(plant)
    commanded(plant, 0.0)
    assert arm.sent[-1] == ((0.0, 0.0, 0.0), (0.1, 0.2, 0.5), QUARTER)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e308])
def test_an_absurd_pose_commands_rest(number):
    plant, arm, _clock = hand()
    observed(plant)
    commanded(plant, 0.2)
    arm.position = (0.1, 0.2, number)
    observed(plant)
    commanded(plant, 0.2)
    assert arm.sent[-1][0] == (0.0, 0.0, 0.0)
    assert all(map(math.isfinite, arm.sent[-1][1]))


class Pushes:
    """A skill that goes on, or stops going on in its own way."""

    diagnostics, stop_reason, notice = {}, "", ""

    def __init__(self, ends):
        self._ends, self._left = ends, 50

    def reset(self, obs):
        pass

    def step(self, obs, command):
        command.velocity[:] = 0.3
        self._left -= 1
        if not self._left:
            self._ends()


class Broken(Exception):
    pass


@pytest.mark.parametrize("error", [KeyboardInterrupt, Broken])
def test_however_a_run_ends_the_hand_is_braked_to_rest(error):
    plant, arm, clock = hand()

    def ends():
        raise error

    with contextlib.suppress(Broken):
        run(plant, Pushes(ends), duration_s=10.0, clock=Ticks(clock))
    speeds = np.linalg.norm([velocity for velocity, _, _ in arm.sent], axis=1)
    assert speeds[40] == pytest.approx(0.3)
    assert speeds[-3:].max() == 0.0
    assert np.abs(np.diff(speeds)).max() <= 0.3  # begins at once; brakes no harder than the envelope:
    assert np.diff(speeds)[40:].min() >= -plant.settings.acceleration_m_per_s2 * plant.dt - 1e-12


class Ticks:
    def __init__(self, clock):
        self._clock = clock

    def start(self, dt):
        self._dt = dt

    def wait(self):
        self._clock.now += self._dt
        return 0.0


def test_a_real_plant_runs_on_the_wall_clock_unless_it_is_told_otherwise(monkeypatch):
    used = []
    monkeypatch.setattr("comanip.loop.WallClock", lambda: used.append("wall") or Ticks(Clock()))
    monkeypatch.setattr("comanip.loop.SimulatedClock", lambda: used.append("simulated") or Ticks(Clock()))
    for is_real in (True, False):
        plant, _arm, _clock = hand()
        plant.real = is_real
        run(plant, Pushes(lambda: None), duration_s=0.05)
    assert used == ["wall", "simulated"]


# behind the messages of ROS


class Node:
    """The other side of a wire, by hand."""

    def __init__(self, settings, clock):
        self.wire, self.heard = Loopback(), []
        self.arm = Ros2Arm(self.wire, settings, clock)
        self._say = {name: self.wire.advertise(topic) for name, topic in settings.topics.items()}
        self.wire.subscribe(settings.command.topic, lambda m: self.heard.append(Reader(settings.command.topic.type).read(m)))
        self._clock = clock

    def pose(self, position=(0.1, 0.2, 0.85), orientation=QUARTER, frame="base"):
        self._say["pose"](Writer(POSE, frame).write(self.stamp, (*position, *orientation)))

    def wrench(self, force, frame="ft"):
        self._say["wrench"](Writer(WRENCH, frame).write(self.stamp, (*force, 0.0, 0.0, 0.0)))

    def twist(self, velocity, frame="base"):
        self._say["twist"](Writer(TWIST, frame).write(self.stamp, (*velocity, 0.0, 0.0, 0.0)))

    @property
    def stamp(self):
        self._clock.now += 0.001  # no two messages are of one time
        return round((self._clock() + 1e6) * 1e9)

    def sensed(self):
        sensed = Sensed()
        self.arm.sense(sensed)
        return sensed


@pytest.mark.parametrize(
    ("turn", "frame", "right"),
    [
        ("hand", "ft", (-2.0, 1.0, 3.0)),
        ("hand", "/ft", (-2.0, 1.0, 3.0)),
        ("hand", "base", (1.0, 2.0, 3.0)),
        ("same", "ft", (1.0, 2.0, 3.0)),
        (list(QUARTER), "ft", (-2.0, 1.0, 3.0)),
        ("hand " + " ".join(map(str, QUARTER)), "ft", (-1.0, -2.0, 3.0)),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wrench_is_turned_into_the_frame_of_the_pose(turn, frame, right, sign):
    clock = Clock()
    node = Node(about(turns={"ft": turns.parsed(turn)}, sign=sign), clock)
    node.pose()
    node.wrench((1.0, 2.0, 3.0), frame)
    assert node.sensed().force == pytest.approx(tuple(sign * x for x in right))
    assert node.arm.missing() == ""


def test_a_wrench_in_a_frame_that_nobody_stated_is_refused_before_and_during_a_run():
    clock = Clock()
    node = Node(about(), clock)
    node.pose()
    node.wrench((1.0, 2.0, 3.0), "tool0")
    with pytest.raises(ParameterError, match=r"robot.toml: wrench is in frame 'tool0'; state its turn in .*there: ft"):
        HandPlant(node.arm, about(), now=clock, sleep=clock.sleep)
    node.wrench((1.0, 2.0, 3.0))
    plant = HandPlant(node.arm, about(), now=clock, sleep=clock.sleep)
    assert np.isfinite(observed(plant).sensor_force).all()
    node.wrench((1.0, 2.0, 3.0), "tool0")
    assert np.isnan(observed(plant).sensor_force).all()
    assert "tool0" in plant.notice
    node.wrench((1.0, 2.0, 3.0))
    assert np.isfinite(observed(plant).sensor_force).all()
    assert plant.notice == ""


def test_a_pose_in_another_frame_is_refused_and_what_is_silent_is_named():
    clock = Clock()
    node = Node(about(), clock)
    with pytest.raises(ParameterError, match=r"nothing came on /pose \(geometry_msgs/PoseStamped\); nothing came on /wrench"):
        HandPlant(node.arm, about(), now=clock, sleep=clock.sleep)
    node.pose(frame="camera")
    node.wrench((0.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"pose is in frame 'camera'; allowed: base"):
        HandPlant(node.arm, about(), now=clock, sleep=clock.sleep)


def test_what_is_no_message_is_said_and_the_last_one_stays():
    clock = Clock()
    node = Node(about(), clock)
    node.pose()
    node.wrench((1.0, 2.0, 3.0))
    before = node.sensed().force
    node._say["wrench"](b"\0\1\0\0 not a wrench")
    assert node.sensed().force == before
    assert "/wrench" in node.arm.notice


@pytest.mark.parametrize("frame", ["", "ft"])
def test_a_twist_comes_out_in_the_frame_that_is_asked_for(frame):
    clock = Clock()
    node = Node(about(axes={"x": [1, 0, 0], "y": [0, 1, 0]}, command=commanding("twist", frame=frame)), clock)
    node.pose()
    node.wrench((0.0, 0.0, 0.0))
    node.sensed()
    node.arm.send((0.3, 0.0, 0.0), (0.0, 0.0, 0.0), turns.NONE, (0.0, 0.0, 0.0))
    assert node.heard[-1].numbers[:3] == pytest.approx((0.0, -0.3, 0.0) if frame else (0.3, 0.0, 0.0))
    assert node.heard[-1].frame == (frame or "base")


def test_a_pose_comes_out_as_target_and_orientation():
    clock = Clock()
    node = Node(about(command=commanding("pose")), clock)
    node.pose()
    node.wrench((0.0, 0.0, 0.0))
    node.arm.send((0.3, 0.0, 0.0), (1.0, 2.0, 3.0), QUARTER, (0.0, 0.0, 0.0))
    assert node.heard[-1].numbers == pytest.approx((1.0, 2.0, 3.0, *QUARTER))


@pytest.mark.parametrize(("measured", "right"), [((0.1, 0.0, 0.0), 40.0), ((0.29, 0.0, 0.0), 2.0), ((math.nan,) * 3, 0.0)])
def test_a_wrench_pulls_to_the_velocity_and_no_harder_than_stated(measured, right):
    clock = Clock()
    node = Node(about(command=commanding("wrench", damping_ns_per_m=200.0, force_max_n=50.0)), clock)
    node.pose()
    node.wrench((0.0, 0.0, 0.0))
    node.arm.send((0.3, 0.0, 0.0), (0.0, 0.0, 0.0), turns.NONE, measured)
    assert node.heard[-1].numbers[0] == pytest.approx(right)
    node.arm.send((9.0, 0.0, 0.0), (0.0, 0.0, 0.0), turns.NONE, (0.0, 0.0, 0.0))
    assert node.heard[-1].numbers[0] == pytest.approx(50.0)


def test_joints_are_recorded_by_name():
    clock = Clock()
    settings = about(topics={**about().topics, "joints": Topic("/joint_states", "sensor_msgs/JointState")})
    node = Node(settings, clock)
    node.pose()
    node.wrench((0.0, 0.0, 0.0))
    node._say["joints"](packed("sensor_msgs/JointState", {"name": ["a", "b"], "position": [0.5, -0.5]}))
    plant = HandPlant(node.arm, settings, now=clock, sleep=clock.sleep)
    observed(plant)
    assert plant.columns["robot.joints"] == ("a", "b")
    assert plant.channels["robot.joints"][0].tolist() == [0.5, -0.5]


class Slow:
    """A tap that takes its time to begin, as one that makes a file does."""

    def __init__(self, clock):
        self._clock = clock

    def begin(self, recorder):
        self._clock.now += 0.4

    def __call__(self, obs, command):
        pass

    def end(self):
        pass


def test_a_real_run_looks_anew_after_its_files_were_made():
    """Else the first tick is late by what that took, and a real hand begins in HOLD."""
    plant, _, clock = hand()
    times = []
    run(
        plant,
        Pushes(lambda: None),
        duration_s=0.1,
        clock=Ticks(clock),
        taps=[Slow(clock), lambda obs, command: times.append(obs.time)],
    )
    assert np.diff(times).max() < 1.5 * plant.dt
