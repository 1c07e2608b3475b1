"""A short run of `fuzz_readers`: altered files end in one line, quickly. Long runs: python tests/fuzz_readers.py 20000."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

import fuzz_digits
import fuzz_readers
import fuzz_settings
from comanip.errors import ComanipError, RecordingError
from comanip.formats import csv_file, hdf5_file, lerobot, mcap_file, parquet_file, read, write
from lifts import lift

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


OURS = {".csv": csv_file, ".mcap": mcap_file, ".parquet": parquet_file, ".hdf5": hdf5_file, ".lerobot": lerobot}


@pytest.mark.parametrize("suffix", OURS)
def test_a_header_of_ours_with_anything_in_it_is_one_line(tmp_path, monkeypatch, suffix):
    """Its JSON may be sound and its values of any kind: `"version": 1e999` ended in an OverflowError in four of five formats."""
    module, rng = OURS[suffix], np.random.default_rng(3)
    write(lift(), path := tmp_path / f"a{suffix}")
    spoils = SimpleNamespace(**{**vars(json), "loads": lambda text: fuzz_settings.spoilt(json.loads(text), rng)})
    monkeypatch.setattr(module, "json", spoils)
    monkeypatch.setattr(mcap_file, "_digest", lambda texts: texts["sha256"])
    refused = 0
    for _ in range(150):
        try:
            read(path)
        except ComanipError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 50


def test_a_parquet_file_whose_header_lost_its_name_is_not_anybodys(tmp_path):
    """One bit in the name, and role, frames and checksum were gone; the values were read as a plain table."""
    pytest.importorskip("pyarrow")
    write(lift(), path := tmp_path / "a.parquet")
    whole = path.read_bytes()
    at = whole.rindex(b"\x07comanip\x18") + 1
    path.write_bytes(whole[:at] + b"k" + whole[at + 1 :])
    with pytest.raises(RecordingError, match="damaged: it is one of comanip's, and its header is not found"):
        read(path)


@pytest.mark.parametrize("suffix", fuzz_digits.SUFFIXES)
def test_no_digit_changes_in_silence(suffix):
    pytest.importorskip("pyarrow")
    pytest.importorskip("h5py")
    refused, _, wrong = fuzz_digits.silent(suffix, 60, seed=1)
    assert wrong == []
    assert refused > 30
