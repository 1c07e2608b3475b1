"""Which kernels run is a choice that can be seen and forced."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from comanip import kernels
from toys import lifts


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
