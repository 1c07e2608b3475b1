"""A short run of `fuzz_readers`: altered files end in one line, quickly. Long runs: python tests/fuzz_readers.py 20000."""

from __future__ import annotations

import pytest

import fuzz_readers

TABLES = ("csv", "topics")  # the reader of text tables has its own tests of altered files


@pytest.mark.parametrize("kind", [k for k in fuzz_readers.FORMATS if k not in TABLES])
def test_an_altered_file_is_read_or_refused_in_one_line(kind):
    if kind in ("parquet", "lerobot"):
        pytest.importorskip("pyarrow")
    if kind == "hdf5":
        pytest.importorskip("h5py")
    slowest, _, refused = fuzz_readers.fuzz(kind, 150, seed=1)
    assert slowest < 1.0 + (kind == "hdf5")  # the first file starts the process that reads
    assert refused > 40
