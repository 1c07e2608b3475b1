"""A disk that is full: one line, nothing cut left behind, the old file as it was, and no process that ends."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from comanip.formats import read, write
from lifts import lift

pytest.importorskip("resource")

NEEDS = {".mcap": "mcap", ".csv": "numpy", ".hdf5": "h5py", ".parquet": "pyarrow", ".lerobot": "pyarrow"}
# in a process of its own: the bound holds for all that is written from then on, and a library that crashes ends it
CHILD = """
import resource, signal, sys
sys.path.insert(0, sys.argv[1])
from comanip.errors import ComanipError
from comanip.formats import write
from lifts import lift
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))
for name in sys.argv[2:]:
    try:
        write(lift(), name)
        print("written", name)
    except ComanipError as error:
        print("refused", str(error).count(chr(10)), name in str(error))
"""


def test_every_format_leaves_the_old_file_and_says_so(tmp_path):
    names = [str(tmp_path / f"a{suffix}") for suffix, module in NEEDS.items() if find_spec(module)]
    for name in names:
        write(lift(duration_s=0.2), name)
    old = {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()}
    tests = str(Path(__file__).parent.parent)
    done = subprocess.run([sys.executable, "-c", CHILD, tests, *names], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["refused 0 True"] * len(names)
    assert {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()} == old
    assert all(len(read(name)) == 1 for name in names)
