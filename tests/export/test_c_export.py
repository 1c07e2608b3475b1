"""The exported C is the Python: command, felt force, mode, reason, energy, phase and role, to the last bit."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from controllers import KINDS, TASKS, maker, skills

from comanip import kernels
from comanip.errors import MismatchError, ParameterError
from comanip.experiments import export_proof
from comanip.experiments.export_proof import KINDS as WAYS
from comanip.experiments.export_proof import Cell, Proof, c_run, differs, prove, python_run
from comanip.export import c_file, reasons
from comanip.export.c_file import identifier, source
from comanip.export.controller import controller
from comanip.export.loaded import STRICT, Loaded, compiled, compiler
from comanip.export.self_test import self_test
from comanip.export.witness import WITNESSES, Witness, missing
from comanip.parts import LAWS

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler (cc, gcc or clang) on this machine")
pytestmark = needs_compiler
QUICK = ("-O0",)  # compiles seven times as fast as -O2, which one task of each kind is compiled with
HOW = {"slide": (QUICK, 200), "pick, carry, place": (("-O2",), 400), "two goals": (QUICK, 200)}  # flags, ticks a run


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("kind", KINDS)
def test_to_the_last_bit(task, kind):
    flags, ticks = HOW[task]
    found = prove(maker(task, kind), 9 * ticks, seed=5, flags=flags, runs_of=ticks)
    assert found["differences"] == []
    assert found["weights_apart"] < 1e-9
    assert len(found["reasons"]) > 5  # else little happened
    assert found["state_bytes"] <= 65536


@pytest.mark.parametrize(("kind", "dt"), [("leader", 0.001), ("follower", 0.004), ("auto", 0.02)])
def test_at_any_period(kind, dt):
    assert prove(maker("slide", kind, dt=dt), 1200, seed=6, flags=QUICK, runs_of=400)["differences"] == []


def test_the_python_without_kernels_says_the_same(monkeypatch):
    monkeypatch.setattr(kernels, "native", None)
    found = prove(maker("two goals", "follower"), 600, seed=7, flags=QUICK, runs_of=200)
    assert found["differences"] == []


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("#define NONE_FIRST 0.10", "#define NONE_FIRST 0.11"),
        ("limits->position_jump + 2.0", "limits->position_jump + 2.5"),
        ("#define EASES_IN_S 0.3", "#define EASES_IN_S 0.31"),
        ("w->average && last == last", "last == last"),
    ],
)
def test_a_planted_fault_is_seen(right, wrong, tmp_path):
    make = maker("slide", "follower" if "NONE" in right else "leader")
    text = source(make())
    assert right in text.c
    loaded = Loaded(compiled(text._replace(c=text.c.replace(right, wrong)), tmp_path, flags=QUICK), text.h)
    runs = (python_run(make(), np.random.default_rng((1, n)), WAYS[n % 3], 500) for n in range(9))
    assert any(differs(0, taken, *c_run(loaded, taken)) for taken in runs)


@pytest.mark.parametrize("kind", KINDS)
def test_it_tests_itself(kind, tmp_path):
    """Strictly compiled, with sanitizers, and once more with a number changed."""
    make = maker("pick, carry, place", kind)
    text = source(make(), name="one", self_test=self_test(make(), "one"))
    _written(tmp_path, make, self_test(make(), "one"))
    build = [compiler(), *STRICT, "-DCOMANIP_SELF_TEST", "one.c", "-o", "one", "-lm"]
    subprocess.run([*build, *QUICK, "-fsanitize=address,undefined", "-fno-sanitize-recover"], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "one"], capture_output=True, text=True)
    assert (said.returncode, "1000 of 1000 ticks equal to the last bit" in said.stdout) == (0, True), said.stdout + said.stderr
    heavier = re.sub(r"(Numbers (?:LEADING|FOLLOWING) = \{\s+)", r"\g<1>0.01 + ", text.c)
    (tmp_path / "one.c").write_text(heavier)
    subprocess.run(build, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "one"], capture_output=True).returncode == 1


def test_a_state_is_a_value(tmp_path):
    """Copied in mid-run it goes on by itself; two robots do not disturb each other."""
    make = maker("slide", "follower")
    text = source(make())
    one = Loaded(compiled(text, tmp_path, flags=QUICK), text.h)
    obs = python_run(make(), np.random.default_rng(3), "well", 300).obs
    whole = one.run(obs).copy()
    one.init()
    one.run(obs[:150])
    kept = one._state.copy()
    one.init()
    one.run(obs[:40])
    one._state[:] = kept
    assert one.run(obs[150:]).tobytes() == whole[150:].tobytes()


def test_before_the_first_step_nothing_runs(tmp_path):
    text = source(maker("slide", "leader")())
    one = Loaded(compiled(text, tmp_path, flags=QUICK), text.h)
    assert one.reason(one.rearm()) == "not started"
    assert [one.reason(n) for n in (0, -1, 1000)] == ["", "", ""]


def test_every_reason_has_a_number():
    """What the envelope's modules say, and the list of C: none is left out, and none is told twice."""
    numbers = [reasons.number_of(said) for said in (
        "", "not started", "policy: x", "clock", "force 51 ms old", "late 40 ms", "position not finite", "position jump 0.3 m",
        "force not finite", "force 61 N > 60 N", "velocity not plausible", "force stuck", "force jumped 2.0 N at rest: sensor?",
        "the object weighs 30 N on this hand > 22 N: too heavy to carry", "does not follow: 0.06 m off",
        "let go: the hand carries the whole object", "let go or loaded: more hangs on the hand than its share",
        "pushed along with 12 N: sensor, or a weight on it?", "blocked", "let go", "checker: speed", "checker: acceleration",
        "checker: room to stop", "0.1 m outside the workspace: z 1 m, allowed 0 to 0.9 m", "in motion: 0.1 m/s",
        "pulled with 5 N > 3 N: let the object rest, or tare", "force stuck still: sensor?",
    )]  # fmt: skip
    assert sorted(numbers) == list(range(len(c_file.reasons())))
    assert set(reasons.SAID) == {name for name, _ in c_file.reasons()}


def test_the_header_says_what_it_is():
    make = maker("two goals", "auto")
    made = make()
    text = source(made, name="both")
    for said in (*made.hashes, "role auto", "axes z", "0.01 s", "m/s", "-9.80665"):
        assert said in text.h
    assert f"opaque[{text.state_bytes // 8}]" in text.h
    code = re.sub(r"/\*.*?\*/", "", text.c, flags=re.DOTALL)
    used = set(
        re.findall(
            r"\b(sqrt|exp|log|fabs|pow|sin|cos|tan|floor|ceil|round|fmin|fmax|fma|malloc|memcpy|isfinite|nearbyint)\(", code
        )
    )
    assert used == {"sqrt", "fabs"}
    assert set(re.findall(r"#include (.*)", text.c)) == {'"both.h"', "<math.h>"}


@pytest.mark.parametrize(
    ("stem", "name"), [("skill", "skill"), ("my-skill 2", "my_skill_2"), ("2x", "skill_2x"), ("int", "skill_int")]
)
def test_names_are_identifiers(stem, name):
    assert identifier(stem) == name


@pytest.mark.parametrize(
    ("about", "why"),
    [
        *(
            ({"law": law}, f"law {law!r} cannot be exported: its tick is Python alone; laws that can: default, lqt, even")
            for law, part in LAWS.items()
            if not part.yields
        ),
        ({"law": "lqr"}, "'lqr'"),
        ({"role": "natural"}, "role 'natural' cannot be exported: say leader, follower or auto"),
        ({"load_share": 0.0}, "load_share is 0; allowed: above 0, to 1"),
        ({"tare_s": -1.0}, "tare_s is -1 s; allowed: 0 or more"),
        ({"mass_kg": -1.0}, "mass_kg is -1 kg; allowed: 0 or more"),
        ({"mass_kg": np.inf}, "mass_kg is inf kg; allowed: 0 or more"),
        ({"force_delay_s": -0.005}, "the force comes -5 ms after the velocity; allowed: 0 to 100 ms"),
        ({"force_delay_s": 0.4}, "the force comes 400 ms after the velocity; allowed: 0 to 100 ms"),
        ({"force_delay_s": np.nan}, "the force comes nan ms after the velocity; allowed: 0 to 100 ms"),
        ({"gravity": np.zeros(3)}, "gravity has 3 numbers; allowed: 1, one an axis (x)"),
        ({"dt": 1.0}, "control period 1.0 s; a skill runs at 0.0002 to 0.05 s"),
        ({"role": "follower"}, "the skill was learned as 'leader'; 'follower' was asked for"),
        ({"goal": 2}, "goal 2 is unknown; the lessons have 1"),
        ({"role": "auto"}, "role 'auto' needs skills of both roles; missing: follower"),
    ],
)
def test_what_cannot_be_exported_is_said_in_one_line(about, why):
    with pytest.raises((ParameterError, MismatchError)) as said:
        controller([skills("slide")["leader"]], **about)
    assert why in str(said.value)
    assert "\n" not in str(said.value)


TARGETS = {
    "aarch64": ("aarch64-linux-musl",),
    "x86-64": ("x86_64-linux-musl",),
    "wasm32": ("wasm32-wasi", "-mexec-model=reactor"),
    "Cortex-M7": ("thumb-freestanding-eabihf", "-mcpu=cortex_m7"),
}


@pytest.mark.parametrize("target", TARGETS)
def test_it_compiles_for_other_machines(target, tmp_path):
    """With the compiler that `pip install ziglang` brings; not linked, for that builds a whole C library first."""
    pytest.importorskip("ziglang", reason="pip install ziglang compiles for other machines")
    name, *flags = TARGETS[target]
    bare = name.startswith("thumb")
    make = maker("slide", "follower")
    _written(tmp_path, make, "" if bare else self_test(make(), "one"))
    include = ["-I", str(_headers(tmp_path))] if bare else []
    level = "-O1" if bare else "-O0"
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", name, *flags, *STRICT, level, "-DCOMANIP_SELF_TEST", *include]
    subprocess.run([*zig, "-c", "one.c", "-o", "one.o"], cwd=tmp_path, check=True)


@pytest.mark.parametrize("kind", KINDS)
def test_on_another_processor_it_is_the_same_to_the_last_bit(kind, tmp_path):
    gcc, emulator = shutil.which("aarch64-linux-gnu-gcc"), shutil.which("qemu-aarch64")
    if gcc is None or emulator is None:
        pytest.skip("needs gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user of Debian")
    make = maker("slide", kind)
    _written(tmp_path, make, self_test(make(), "one"))
    level = "-O2" if kind == "auto" else "-O1"
    subprocess.run([gcc, *STRICT, level, "-static", "-DCOMANIP_SELF_TEST", "one.c", "-o", "one", "-lm"], cwd=tmp_path, check=True)
    said = subprocess.run([emulator, tmp_path / "one"], capture_output=True, text=True)
    assert "1000 of 1000 ticks equal to the last bit" in said.stdout, said.stdout


def test_another_processor_and_another_library_give_the_same_bits(tmp_path):
    """All that run here beside one Python; optimised, as a multiply-add in one step would be."""
    there = [name for name in WITNESSES if not missing(name)]
    if not there:
        pytest.skip("; ".join(map(missing, WITNESSES)))
    found = prove(maker("two goals", "auto"), 1200, seed=8, flags=QUICK, runs_of=400, witnesses=there, folder=tmp_path)
    assert (found["differences"], found["witnesses"]) == ([], {name: [] for name in there})


def test_a_witness_that_computes_otherwise_is_seen(tmp_path):
    if why := missing("x86-64-plain"):
        pytest.skip(why)
    make = maker("slide", "leader")
    text = source(make())
    other = Witness(
        "x86-64-plain",
        text._replace(c=text.c.replace("#define EASES_IN_S 0.3", "#define EASES_IN_S 0.31")),
        tmp_path,
    )
    taken = python_run(make(), np.random.default_rng(2), "well", 400)
    assert differs(0, taken, *other.answers([(taken.obs, list(taken.rearmed))])[0])


def test_a_proof_goes_on_from_where_it_was_interrupted(tmp_path, monkeypatch):
    """Chunks that were done are not done again; a line that was cut is; another C begins anew."""
    monkeypatch.setattr(export_proof, "TICKS", 60)
    monkeypatch.setattr(export_proof, "Prover", partial(export_proof.Prover, flags=QUICK))
    monkeypatch.setattr(export_proof, "RUNS", 2)
    monkeypatch.setattr(Proof, "learned", lambda self, task, role: list(skills("slide").values()))
    cell = Cell("slide", "leader", 0.01, "faults", 0)
    first = Proof(tmp_path, [], seed=1, witnesses=())
    assert first.go_on(cell)["differences"] == []
    again = Proof(tmp_path, [], seed=1, witnesses=())
    assert again.go_on(cell) is None
    assert len(again.current()) == 1
    log = tmp_path / "chunks.jsonl"
    log.write_text(log.read_text()[:-20])
    assert Proof(tmp_path, [], seed=1, witnesses=()).go_on(cell) is not None
    changed = log.read_text().replace('"c": "', '"c": "x')
    log.write_text(changed)
    assert Proof(tmp_path, [], seed=1, witnesses=()).go_on(cell) is not None


def _written(folder, make, test):
    text = source(make(), name="one", self_test=test)
    (folder / "one.c").write_text(text.c)
    (folder / "one.h").write_text(text.h)


def _headers(folder):
    """A <math.h> of the two functions that are used: what is freestanding brings none."""
    (folder / "include").mkdir()
    text = "double sqrt(double); double fabs(double);\n"
    (folder / "include" / "math.h").write_text(text + '#define NAN __builtin_nanf("")\n#define INFINITY __builtin_inff()\n')
    return folder / "include"
