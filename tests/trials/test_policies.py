"""Anybody's policy in the trials: what a file may hold, the same numbers as a law of ours, and one line for each mistake."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import forked
from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation, Skill
from comanip.trials import draw_case
from comanip.trials.policies import policy_skill
from comanip.trials.running import one_run
from comanip.trials.sight import Seen, Sight

SKILL = """
import numpy as np
class skill:
    def __init__(self, axes, dt):
        self.v, self.dt = np.zeros(len(axes)), dt
    def reset(self, obs):
        self.v[:] = 0.0
    def step(self, obs, command):
        self.v[:] = (6.0 * self.v + self.dt * np.where(np.isfinite(obs.force), obs.force, 0.0)) / (6.0 + self.dt * 20.0)
        command.velocity[:] = self.v
        command.position[:] = obs.position + self.dt * self.v
        command.acceleration[:] = 0.0
"""
OBJECT = """
class Policy:
    def __init__(self, axes, dt):
        self.d, self.dt = len(axes), dt
    def reset(self):
        self.v = 0.0
    def __call__(self, seen):
        self.v = (6.0 * self.v + self.dt * seen[2 * self.d :]) / (6.0 + self.dt * 20.0)
        return self.v
"""
DAMPER = "def policy(seen, axes, dt):\n    return dt * seen[2 * len(axes) : 3 * len(axes)] / (dt * 40.0)\n"


@pytest.fixture
def case():
    return draw_case("follower", np.random.default_rng(4))


def made(tmp_path, text, name="mine.py", **about):
    (tmp_path / name).write_text(text)
    return policy_skill(str(tmp_path / name), "follower", {}, **{"axes": ("z",), "dt": 0.01, **about})


@pytest.mark.parametrize(("text", "law"), [(SKILL, "mass-damper"), (OBJECT, "mass-damper"), (DAMPER, "damping")])
def test_a_policy_that_is_a_law_of_ours_has_its_numbers(tmp_path, skills, case, text, law):
    (tmp_path / "mine.py").write_text(text)
    (one, verdict), (other, wanted) = (one_run(case, skills, name) for name in (str(tmp_path / "mine.py"), law))
    assert np.abs(one["hand.position"].values - other["hand.position"].values).max() < 1e-12
    assert verdict.failures == wanted.failures
    assert one["skill.mode"].values.shape == other["skill.mode"].values.shape, "within the same envelope"


def test_a_policy_is_told_what_it_names(tmp_path):
    text = "def policy(seen, role, dt, goal, task):\n    return [0.1 * (role == 'follower') * dt * (goal is None)]\n"
    skill, obs, command = made(tmp_path, text), Observation(1), Command(1)
    obs.position[:] = obs.velocity[:] = obs.force[:] = 0.0
    skill.reset(obs)
    skill.step(obs, command)
    assert isinstance(skill, Skill)
    assert command.velocity[0] == pytest.approx(0.001)


def test_history_and_a_goal_are_seen_as_said(tmp_path):
    sight, obs = Sight(Seen(2, history=3, goal=True), np.array([7.0, 8.0])), Observation(2)
    for n in range(5):
        obs.position[:], obs.velocity[:], obs.force[:] = (n, 10 + n), (20 + n, 30 + n), (40 + n, 50 + n)
        (sight.begin if n == 0 else sight.look)(obs)
    rows = sight.values[:18].reshape(3, 6)
    assert rows[:, 0].tolist() == [2.0, 3.0, 4.0]
    assert rows[2].tolist() == [4.0, 14.0, 24.0, 34.0, 44.0, 54.0]
    assert sight.values[18:].tolist() == [7.0, 8.0]
    obs.force[:] = np.nan
    assert sight.look(obs)[16:18].tolist() == [44.0, 54.0], "what is missing keeps its last value"
    text = "HISTORY = 4\nACTION = 'acceleration'\ndef policy(seen):\n    assert seen.shape == (26,)\n    return [1.0, 0.0]\n"
    skill, command = made(tmp_path, text, axes=("x", "z"), goal=np.zeros(2)), Command(2)
    skill.reset(obs)
    for _ in range(3):
        skill.step(obs, command)
    assert command.velocity.tolist() == pytest.approx([0.03, 0.0])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def policy(seen): return [1.0, 2.0]", r"mine\.py: .*action has shape \(2,\); allowed: \(1,\) finite numbers"),
        ("def policy(seen): return [float('nan')]", r"mine\.py: .*action is \[nan\]"),
        ("def policy(seen):\n    return seen['z']", r"mine\.py: IndexError: .*\(line 2\)"),
        ("x = 1", r"mine\.py holds no policy: give a class or function `skill`"),
        ("def policy(:", r"mine\.py: SyntaxError"),
        ("import nowhere", r"mine\.py: ModuleNotFoundError.*\(line 1\)"),
        ("HISTORY = 'long'\ndef policy(seen): return [0.0]", r"mine\.py: history is 'long'"),
        ("ACTION = 'torque'\ndef policy(seen): return [0.0]", r"mine\.py: action 'torque' is unknown; there are: velocity"),
        ("def skill(): return 3", r"mine\.py: skill gives int, which has no reset and no step"),
        ("class Policy: pass", r"mine\.py: Policy cannot be called"),
        ("class Policy:\n    def __init__(self):\n        1 / 0", r"mine\.py: Policy: ZeroDivisionError.*\(line 3\)"),
    ],
)
def test_what_is_no_policy_is_said_before_anything_runs(tmp_path, text, says):
    with pytest.raises(ParameterError, match=says):
        made(tmp_path, text)


@pytest.mark.parametrize("file", ["mine.txt", "none.py", "none.onnx"])
def test_what_is_no_file_is_said(file):
    with pytest.raises(ParameterError, match=rf"--law-from {file}: "):
        policy_skill(file, "follower", {}, axes=("z",), dt=0.01)


@pytest.mark.parametrize("fault", ["raise ValueError('boom')", "return [float('nan')]", "return [0.0, 0.0]"])
@pytest.mark.parametrize("whole", [True, False])
def test_a_policy_that_fails_in_a_run_is_stopped_and_has_lost(tmp_path, skills, case, fault, whole):
    law = "        self.n += 1\n        if self.n > 200:\n            FAULT\n".replace("FAULT", fault)
    if whole:  # as a skill
        law = law.replace("return [float('nan')]", "command.velocity[:] = float('nan')\n            return")
        law = law.replace("return [0.0, 0.0]", "command.velocity = [0.0, 0.0]\n            return")
        text = SKILL.replace("        self.v[:] = (6", f"{law}        self.v[:] = (6").replace(
            "[:] = 0.0\n", "[:] = self.n = 0\n", 1
        )
    else:
        text = OBJECT.replace("        self.v = (6", f"{law}        self.v = (6").replace("self.v = 0.0", "self.v = self.n = 0")
    (tmp_path / "mine.py").write_text(text)
    recording, verdict = one_run(replace(case, behaviour="steady"), skills, str(tmp_path / "mine.py"))
    assert any(why.startswith("policy: ") for why in verdict.failures)
    assert recording["skill.mode"].values[-1] == 2.0
    assert abs(recording["command.velocity"].values[-1]).max() == 0.0


def onnx_file(path, rows, *, memory=False, meta=None):
    """v = A (seen of 3); with memory, the sum of all forces so far / 1000."""
    onnx = pytest.importorskip("onnx", reason="onnx, which writes the test's file, is not installed")
    pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")
    h, t = onnx.helper, onnx.TensorProto.FLOAT
    a = h.make_tensor("A", t, (3, len(rows)), np.array(rows, dtype=np.float32).T.ravel())
    shape, nodes = ([1, len(rows), 1] if len(rows) > 1 else [1, 1]), [h.make_node("MatMul", ["seen", "A"], ["flat"])]
    ins, outs = [h.make_tensor_value_info("seen", t, [1, 3])], [h.make_tensor_value_info("said", t, shape)]
    tensors = [a, h.make_tensor("shape", onnx.TensorProto.INT64, (len(shape),), shape)]
    if memory:
        ins.append(h.make_tensor_value_info("h", t, [1, 1]))
        outs.append(h.make_tensor_value_info("h2", t, [1, 1]))
        nodes += [h.make_node("Add", ["flat", "h"], ["h2"]), h.make_node("Reshape", ["h2", "shape"], ["said"])]
    else:
        nodes.append(h.make_node("Reshape", ["flat", "shape"], ["said"]))
    model = h.make_model(h.make_graph(nodes, "g", ins, outs, tensors), opset_imports=[h.make_opsetid("", 17)], ir_version=9)
    h.set_model_props(model, meta or {})
    onnx.save(model, str(path))


def said_by(skill, forces):
    obs, command, told = Observation(1), Command(1), []
    for n, force in enumerate(forces):
        obs.time, obs.position[:], obs.velocity[:], obs.force[:] = 0.01 * n, 0.0, 0.0, force
        if n == 0:
            skill.reset(obs)
        skill.step(obs, command)
        told.append(float(command.velocity[0]))
    return told


def test_an_onnx_file_is_a_policy_also_with_memory_and_in_chunks(tmp_path):
    path, about = tmp_path / "m.onnx", {"axes": ("z",), "dt": 0.01}
    onnx_file(path, [[0.0, 0.0, 0.025]])
    assert said_by(policy_skill(str(path), "follower", {}, **about), [4.0, 8.0]) == pytest.approx([0.1, 0.2])
    onnx_file(path, [[0.0, 0.0, 0.001]], memory=True)
    skill = policy_skill(str(path), "follower", {}, **about)
    for _ in range(2):  # a reset forgets
        assert said_by(skill, [1.0, 2.0, 3.0]) == pytest.approx([0.001, 0.003, 0.006])
    onnx_file(path, [[0.0, 0.0, 0.01], [0.0, 0.0, 0.02]])  # a chunk: now, and twice as much in the next tick
    w = np.exp(-0.01)
    wanted = [0.01, (0.02 + w * 0.02) / (1 + w), (0.04 + w * 0.03) / (1 + w)]
    assert said_by(policy_skill(str(path), "follower", {}, **about), [1.0, 2.0, 3.0]) == pytest.approx(wanted)
    onnx_file(path, [[0.0, 0.0, 0.1]], meta={"action": "acceleration"})
    assert said_by(policy_skill(str(path), "follower", {}, **about), [10.0, 10.0]) == pytest.approx([0.01, 0.02])


def test_an_onnx_file_of_another_size_is_said(tmp_path):
    onnx_file(tmp_path / "m.onnx", [[0.0, 0.0, 0.025]])
    with pytest.raises(ParameterError, match=r"m\.onnx: sees 3 numbers; on 2 axes they are 6 a tick"):
        policy_skill(str(tmp_path / "m.onnx"), "follower", {}, axes=("x", "z"), dt=0.01)
    (tmp_path / "m.onnx").write_bytes(b"garbage")
    with pytest.raises(ParameterError, match=r"m\.onnx: no ONNX model"):
        policy_skill(str(tmp_path / "m.onnx"), "follower", {}, axes=("z",), dt=0.01)


def test_a_zip_that_is_none_of_stable_baselines_is_said(tmp_path):
    for content in ({}, {"data": "{}"}, {"data": "["}):
        with zipfile.ZipFile(tmp_path / "m.zip", "w") as packed:
            for name, text in content.items():
                packed.writestr(name, text)
        with pytest.raises(ParameterError, match=r"m\.zip: (no zip of Stable-Baselines3|of none of the algorithms PPO, SAC)"):
            policy_skill(str(tmp_path / "m.zip"), "follower", {}, axes=("z",), dt=0.01)


@pytest.mark.parametrize("name", ["PPO", "SAC"])
def test_a_zip_of_stable_baselines_says_its_mean_action_spread_over_what_may_be_said(tmp_path, name):
    sb3 = pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")
    gymnasium = pytest.importorskip("gymnasium", reason="the extra gym is not installed")
    import comanip.gym  # noqa: F401

    env = gymnasium.wrappers.RescaleAction(gymnasium.make("comanip/Carry-v0"), -1.0, 1.0)
    model = getattr(sb3, name)("MlpPolicy", env, seed=0, device="cpu")
    model.save(tmp_path / "m.zip")
    seen = np.array([0.85, 0.1, 3.0])
    skill, obs, command = policy_skill(str(tmp_path / "m.zip"), "follower", {}, axes=("z",), dt=0.01), Observation(1), Command(1)
    obs.position[:], obs.velocity[:], obs.force[:] = seen
    skill.reset(obs)
    skill.step(obs, command)
    assert command.velocity[0] == pytest.approx(0.8 * float(model.predict(seen, deterministic=True)[0][0]), abs=1e-6)


def test_the_command_line_tries_them_beside_laws_and_board_gathers(tmp_path):
    (tmp_path / "soft.py").write_text(DAMPER)
    (tmp_path / "results").mkdir()

    def shell(*words, code=0):
        done = forked.run(*words, cwd=tmp_path)
        assert done.returncode == code, done.stderr
        return done

    words = ("trial", "--role", "follower", "--law-from", "soft.py", "--partners", "3", "--workers", "1", "--json")
    for name, more in (("a", ("--law", "damping")), ("b", ("--seed", "8"))):
        (tmp_path / "results" / f"{name}.json").write_text(shell(*words, *more).stdout)
    result = json.loads((tmp_path / "results" / "a.json").read_text())
    assert list(result["follower"]) == ["damping", "soft.py"]
    assert result["follower"]["damping"]["behaviours"] == result["follower"]["soft.py"]["behaviours"]
    assert set(result["about"]["policies_sha256"]) == {"soft.py"}
    printed = shell("board", "results").stdout
    assert printed.count("| lift | follower | soft.py ") == 2
    told = json.loads(shell("board", "results", "--json").stdout)
    assert {one["law"].split()[0] for one in told["entries"]} == {"damping", "soft.py"}
    assert all(one["lacks"] == "not tried as leader" for one in told["entries"])
    shell("board", "results", "-o", "b.html")
    assert "<td>damping</td>" in (tmp_path / "b.html").read_text()
    assert shell("board", "nowhere", code=2).stderr.startswith("error: nowhere: is no folder")
    assert "a policy is a file that ends in" in shell(*words[:3], "--law-from", "results/a.json", code=2).stderr
