"""One digit, or one bit, of a file of ours changed: it is refused, said, or changes nothing. Never another number in silence.

python tests/fuzz_digits.py 3000 [SUFFIX ...]
"""

from __future__ import annotations

import json
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from comanip.errors import ComanipError
from comanip.formats import read, write
from comanip.learned.file import load, save, to_json
from fuzz_settings import _skill
from lifts import lift

SUFFIXES = (".csv", ".mcap", ".parquet", ".hdf5", ".lerobot", ".skill.json")  # those that carry a checksum
DIGITS = b"0123456789"


def _made(suffix: str, folder: Path) -> Path:
    path = folder / f"a{suffix}"
    if suffix == ".skill.json":
        path.write_text(json.dumps(_skill(), indent=1))
        save(load(path), path)
    else:
        write(lift(), path)
    return path


def changed(data: bytes, rng: np.random.Generator) -> bytes:
    """Another digit for one digit, or in a file without many, one bit of one byte."""
    found, digits = bytearray(data), np.flatnonzero(np.isin(np.frombuffer(data, np.uint8), list(DIGITS)))
    if len(digits) > len(data) // 3:
        at = int(rng.choice(digits))
        found[at] = DIGITS[(DIGITS.index(found[at]) + int(rng.integers(1, 10))) % 10]
    else:
        found[int(rng.integers(len(found)))] ^= 1 << int(rng.integers(8))
    return bytes(found)


def _content(path: Path) -> Any:
    """All that a reader gives, as text; what it noted about damage is said and not silent."""
    if path.name.endswith(".skill.json"):
        return to_json(load(path))
    (one,) = read(path)
    return {
        **{n: (c.time.tolist(), c.values.tolist(), c.unit, c.frame, c.axes) for n, c in one.channels.items()},
        "": one.metadata,
    }


def silent(suffix: str, count: int, seed: int = 0) -> tuple[int, int, list[str]]:
    """(refused or said, without any effect, changes that nobody said)."""
    refused, same, wrong = 0, 0, []
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        path = _made(suffix, Path(place))
        files = [path] if path.is_file() else sorted(f for f in path.rglob("*") if f.is_file())
        whole, contents = repr(_content(path)), [f.read_bytes() for f in files]
        sizes = np.array([len(c) for c in contents], dtype=float)
        warnings.simplefilter("error")
        for n in range(count):
            rng = np.random.default_rng([seed, n])
            which = int(rng.choice(len(files), p=sizes / sizes.sum()))
            files[which].write_bytes(changed(contents[which], rng))
            try:
                if repr(_content(path)) == whole:
                    same += 1
                else:
                    wrong.append(f"{suffix} ({seed}, {n}): {files[which].name}")
            except (ComanipError, UserWarning):
                refused += 1
            except Exception as error:
                wrong.append(f"{suffix} ({seed}, {n}): {files[which].name}: {type(error).__name__}: {error}"[:200])
            files[which].write_bytes(contents[which])
    return refused, same, wrong


if __name__ == "__main__":
    for suffix in sys.argv[2:] or SUFFIXES:
        refused, same, wrong = silent(suffix, int(sys.argv[1]))
        print(f"{suffix}: {refused} refused or said, {same} without effect, {len(wrong)} in silence", flush=True)
        print("\n".join(wrong[:20]), flush=True)
