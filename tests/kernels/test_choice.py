"""Which kernels run is a choice that can be seen and forced."""

import json
import os
import subprocess
import sys

import pytest

from comanip import kernels


def asked(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )


def test_numpy_can_be_forced():
    found = asked("from comanip import kernels; print(kernels.native, kernels.description)", COMANIP_KERNELS="numpy")
    assert found.stdout.startswith("None numpy")


@pytest.mark.skipif(kernels.native is None, reason="nothing was compiled")
def test_an_instruction_set_can_be_forced():
    found = asked("from comanip import kernels; print(kernels.description)", COMANIP_KERNELS="plain")
    assert found.stdout == "native, plain\n"
    assert "allowed here: numpy, native" in asked("import comanip.kernels", COMANIP_KERNELS="mmx").stderr


def test_the_doctor_says_which_kernels_run():
    found = asked("from comanip.cli import main; main()", COMANIP_KERNELS="numpy")
    assert found.returncode == 0
    found = subprocess.run(
        [sys.executable, "-m", "comanip.cli", "doctor", "--json"], capture_output=True, text=True, check=True,
        env={**os.environ, "COMANIP_KERNELS": "numpy"},
    )  # fmt: skip
    assert json.loads(found.stdout)["kernels"].startswith("numpy")
    lines = subprocess.run([sys.executable, "-m", "comanip.cli", "doctor"], capture_output=True, text=True, check=True).stdout
    assert kernels.description in lines


def test_without_a_compiled_module_the_twins_run_and_the_doctor_says_why():
    hidden = "import sys; sys.modules['comanip.kernels._native'] = None\n"
    found = asked(hidden + "from comanip.commands.doctor import doctor; doctor(False)", COMANIP_KERNELS="")
    assert "compiled kernels are absent" in found.stdout
    assert found.stderr == ""
