"""Which kernels run is a choice that can be seen and forced."""

import importlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

import comanip
from comanip import kernels
from toys import lifts, same


def asked(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )


def test_where_there_is_a_compiler_the_kernels_were_compiled():
    """The build lets a compilation fail, and most tests here are skipped then: somebody has to notice."""
    compiler = (sysconfig.get_config_var("CC") or "cc").split()[0]
    if os.environ.get("COMANIP_KERNELS", "").lower() == "numpy":
        pytest.skip("COMANIP_KERNELS=numpy asks for the twins")
    if not shutil.which(compiler) or not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        pytest.skip(f"no C compiler {compiler!r}, or no Python.h, on this machine")
    assert kernels.native is not None, "reinstall comanip with pip -v and read why the extension was not built"


def test_numpy_can_be_forced():
    found = asked("from comanip import kernels; print(kernels.native, kernels.description)", COMANIP_KERNELS="numpy")
    assert found.stdout.startswith("None numpy")


@pytest.mark.skipif(kernels.native is None, reason="nothing was compiled")
def test_an_instruction_set_can_be_forced():
    found = asked("from comanip import kernels; print(kernels.description)", COMANIP_KERNELS="plain")
    assert found.stdout == "native, plain\n"
    assert "allowed here: numpy, native" in asked("import comanip.kernels", COMANIP_KERNELS="mmx").stderr


def test_the_doctor_says_which_kernels_run():
    found = asked("from comanip.commands.app import main; main()", COMANIP_KERNELS="numpy")
    assert found.returncode == 0
    found = subprocess.run(
        [sys.executable, "-m", "comanip", "doctor", "--json"], capture_output=True, text=True, check=True,
        env={**os.environ, "COMANIP_KERNELS": "numpy"},
    )  # fmt: skip
    assert json.loads(found.stdout)["kernels"].startswith("numpy")
    lines = subprocess.run([sys.executable, "-m", "comanip", "doctor"], capture_output=True, text=True, check=True).stdout
    assert kernels.description in lines


def test_without_a_compiled_module_the_twins_run_and_the_doctor_says_why():
    hidden = "import sys; sys.modules['comanip.kernels._native'] = None\n"
    found = asked(hidden + "from comanip.commands.doctor import doctor; doctor(False)", COMANIP_KERNELS="")
    assert "compiled kernels are absent" in found.stdout
    assert found.stderr == ""


def test_without_a_compiled_module_a_command_that_learns_says_so_once(tmp_path):
    for i, x in enumerate(lifts(2)):
        table = np.column_stack([np.arange(len(x)) / 100.0, x])
        np.savetxt(tmp_path / f"{i}.csv", table, delimiter=",", header="time,position.z,force.z,velocity.z", comments="")
    learn = f"app(['learn', {str(tmp_path / '0.csv')!r}, {str(tmp_path / '1.csv')!r}, '-o', {str(tmp_path / 's.json')!r}])\n"
    twice = f"from comanip.commands.app import app\nfor _ in range(2):\n    try: {learn}    except SystemExit: pass\n"
    found = asked("import sys; sys.modules['comanip.kernels._native'] = None\n" + twice, COMANIP_KERNELS="")
    assert found.stdout.count("learned from 2 recordings") == 2
    assert found.stderr == f"note: {kernels.ABSENT.removeprefix('numpy: ')}\n"
    assert asked(twice, COMANIP_KERNELS="numpy").stderr == ""


CHECKOUT = Path(__file__).parents[2]
NO_SUCH_MODULE = "import sys; sys.modules['comanip.kernels._native'] = None\n"


@pytest.mark.parametrize("wanted", ["foo", "avx1024", "nativ"])
def test_a_choice_that_is_none_is_one_line_of_the_program_that_lists_them(wanted):
    for hidden in ("", NO_SUCH_MODULE):
        found = asked(
            f"{hidden}import sys; sys.argv = ['comanip', 'doctor']\nfrom comanip.cli import main; main()", COMANIP_KERNELS=wanted
        )
        assert found.returncode == 2
        assert found.stderr.startswith(f"error: COMANIP_KERNELS='{wanted}'")
        assert "allowed here: numpy" in found.stderr
        assert found.stderr.count("\n") == 1


def test_an_instruction_set_asked_for_where_nothing_was_compiled_is_not_silently_numpy():
    found = asked(NO_SUCH_MODULE + "import comanip.kernels", COMANIP_KERNELS="avx2")
    assert "COMANIP_KERNELS='avx2' asks for compiled kernels" in found.stderr
    assert "no C compiler" in found.stderr


def test_a_compiled_module_that_cannot_be_loaded_is_told_apart_from_none(tmp_path):
    shutil.copytree(CHECKOUT / "src" / "comanip", tmp_path / "comanip", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    (tmp_path / "comanip" / "kernels" / "_native.abi3.so").write_bytes(b"\x7fELF not for this machine")
    code = "from comanip import kernels; print(kernels.description)"
    found = asked(code, COMANIP_KERNELS="", PYTHONPATH=str(tmp_path))
    assert found.stdout.startswith("numpy: the compiled kernels are there and cannot be loaded here (")
    assert "compiler" not in found.stdout
    assert found.stdout.count("\n") == 1
    (tmp_path / "comanip" / "kernels" / "_native.abi3.so").unlink()
    assert asked(code, COMANIP_KERNELS="", PYTHONPATH=str(tmp_path)).stdout.strip() == kernels.ABSENT


def test_where_an_index_has_32_bits_the_plan_counts_in_those(monkeypatch):
    """numpy.repeat casts counts to the index's type, and only safely."""
    plan = importlib.import_module("comanip.kernels.plan")

    class Narrow:
        intp = np.int32

        def __getattr__(self, name):
            return getattr(np, name)

        @staticmethod
        def repeat(values, counts):
            return np.repeat(values, np.asarray(counts).astype(np.int32, casting="safe"))

    expected = plan.plan(np.array([9000, 40, 3000]), 4)
    monkeypatch.setattr(plan, "np", Narrow())
    for found, usual in zip(plan.plan(np.array([9000, 40, 3000]), 4), expected, strict=True):
        same(found, usual)


def built(where, *, free_threaded=False, **environment):
    """A wheel of a copy of the checkout, or what setuptools said."""
    copy = where / "a copy"
    shutil.copytree(
        CHECKOUT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "*.so", "__pycache__", "build", "docs", "tests")
    )
    claims = "import sysconfig; sysconfig.get_config_vars()['Py_GIL_DISABLED'] = 1\n" if free_threaded else ""
    code = (
        claims
        + "import sys, runpy; sys.argv = ['setup.py', '-q', 'bdist_wheel']; runpy.run_path('setup.py', run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=copy, env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-500:]
    return [path.name for path in (copy / "dist").iterdir()]


@pytest.mark.skipif(not (CHECKOUT / "setup.py").exists(), reason="comanip is installed, and its checkout is not here")
def test_a_wheel_without_a_binary_fits_every_platform_and_one_with_it_does_not(tmp_path):
    pytest.importorskip("setuptools.command.bdist_wheel", reason="needs setuptools >= 70.1")
    assert built(tmp_path / "without", CC="false") == [f"comanip-{comanip.__version__}-py3-none-any.whl"]


@pytest.mark.skipif(not (CHECKOUT / "setup.py").exists(), reason="comanip is installed, and its checkout is not here")
def test_an_interpreter_without_a_lock_gets_a_wheel_too(tmp_path):
    """It has no stable ABI: setuptools refuses py_limited_api there before anything is built."""
    pytest.importorskip("setuptools.command.bdist_wheel", reason="needs setuptools >= 70.1")
    (name,) = built(tmp_path, free_threaded=True, CC="false")
    assert "abi3" not in name
