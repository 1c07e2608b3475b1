"""Files altered at random: every reader must answer with recordings or with one line.

`python tests/fuzz_tables.py [count] [reader]` counts, for each reader, what is neither: another exception, an answer after more
than a second of work, 500 MB more memory than before. A reader that ends the process ends this one, too.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import re
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from comanip.errors import ComanipError
from comanip.formats import Columns, read, write
from comanip.formats.guessing import guess
from comanip.formats.listing import look
from comanip.lessons.demonstration import demonstrations
from lifts import lift

SLOWEST_S, MOST_MB = 1.0, 500
TOKENS = b'" , ; \n \t \0 nan 1e999 - 1,200 12:00:00 \xff\xfe # D 99999999999999999999999999 sep=;\n'.split(b" ")


def _table() -> np.ndarray:
    recording = lift(duration_s=1.5)
    signals = (recording[f"hand.{n}"].values for n in ("position", "velocity", "force"))
    return np.column_stack([recording["hand.force"].time, *signals])


def _csv(**options: str) -> bytes:
    out = io.StringIO()
    np.savetxt(out, _table(), fmt="%.6g", comments="", **{"delimiter": ",", "header": "t,z,vz,Fz", **options})
    return out.getvalue().encode()


def _rows(first: Callable[[str], str], last: str) -> str:
    rows = (line.split(",", 1) for line in _csv().decode().splitlines()[1:])
    return "\n".join(f"{first(time)},{rest}{last}" for time, rest in rows)


def _quoted() -> bytes:
    return ('t,z,vz,Fz,"a ""note"""\n' + _rows('"{}"'.format, ',"two\nlines"')).encode()


def _dated() -> bytes:
    return ("t,z,vz,Fz\n" + _rows(lambda t: f"2024-05-01 12:00:{float(t):06.3f}", "")).encode()


def _own(suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(lift(duration_s=1.5), path := Path(folder) / f"a{suffix}")
        return path.read_bytes()


def _npy(structured: bool) -> bytes:
    out, table = io.BytesIO(), _table()
    np.save(out, np.rec.fromarrays(table.T, names="t,z,vz,Fz") if structured else table)
    return out.getvalue()


def _npz(packed: bool) -> bytes:
    out, (t, z, vz, fz) = io.BytesIO(), _table().T
    (np.savez_compressed if packed else np.savez)(out, t=t, z=z, vz=vz, Fz=fz, config=np.array({"a": 1}, dtype=object))
    return out.getvalue()


def _mat(**options: object) -> bytes:
    from scipy.io import savemat

    out, (t, z, vz, fz) = io.BytesIO(), _table().T
    nested = {"log": {"a": [t, {"b": z}], "name": "lift"}, "cell": np.array([t, "x"], dtype=object)}
    more = {} if options.get("format") == "4" else nested
    savemat(out, {"t": t, "z": z, "vz": vz, "Fz": fz, **more}, **options)
    return out.getvalue()


def _mat73() -> bytes:
    import h5py

    with tempfile.TemporaryDirectory() as folder:
        with h5py.File(path := Path(folder) / "a.mat", "w", userblock_size=512) as file:
            for name, values in zip(("t", "z", "vz", "Fz"), _table().T, strict=True):
                file[name] = values[None]
        return b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:]


READERS: dict[str, tuple[str, Callable[[], bytes]]] = {  # reader -> (extension, an intact file)
    "csv": (".csv", _csv),
    "semicolons": (".csv", lambda: _csv(delimiter=";", header="t;z;vz;Fz").replace(b".", b",")),
    "blanks": (".txt", lambda: _csv(delimiter=" ", header="t z vz Fz")),
    "quoted": (".csv", _quoted),
    "dated": (".csv", _dated),
    "own csv": (".csv", lambda: _own(".csv")),
    "mcap": (".mcap", lambda: _own(".mcap")),
    "npy": (".npy", lambda: _npy(False)),
    "structured npy": (".npy", lambda: _npy(True)),
    "npz": (".npz", lambda: _npz(False)),
    "packed npz": (".npz", lambda: _npz(True)),
    "mat 4": (".mat", lambda: _mat(format="4")),
    "mat 5": (".mat", _mat),
    "mat 7": (".mat", lambda: _mat(do_compression=True)),
    "mat 7.3": (".mat", _mat73),
    "gzip": (".csv.gz", lambda: gzip.compress(_csv())),
    "bzip2": (".csv.bz2", lambda: bz2.compress(_csv())),
    "xz": (".csv.xz", lambda: lzma.compress(_csv())),
}


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bits, bytes, tokens or blocks changed, most near the beginning, where the lengths are."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(len(changed)) if rng.random() < 0.5 else rng.integers(min(600, len(changed))))
        kind = rng.integers(7)
        if kind == 0:
            changed[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            changed[at] = int(rng.integers(256))
        elif kind == 2:
            changed[at:at] = TOKENS[rng.integers(len(TOKENS))]
        elif kind == 3:
            del changed[at : at + int(rng.integers(1, 64))]
        elif kind == 4:
            changed[at : at + 4] = int(rng.choice([0, 1, 255, 2**16, 2**31 - 1, 2**32 - 1])).to_bytes(4, "little")
        elif kind == 5:
            changed[at:at] = changed[at : at + int(rng.integers(1, 200))]
        elif rng.random() < 0.2:
            del changed[at:]
        if not changed:
            break
    return bytes(changed)


def answer(path: Path, columns: Columns) -> str:
    """ "read" or "refused" for what a reader and the checks may say; everything else is raised."""
    try:
        guess(look(path), stamped=False)  # what `inspect` does with a file that nobody described
        demonstrations(read(path, columns))
    except ComanipError as error:
        if "\n" in str(error):
            raise AssertionError(f"an error of two lines: {error}") from None
        return "refused"
    return "read"


def peak_mb(*, afresh: bool = False) -> int:
    """The most memory this process held [MB]; `afresh`: counted from now on. The process of a test suite has a past."""
    with contextlib.suppress(OSError):  # where there is no such file, the peak of the process's whole life bounds the growth
        if afresh:
            Path("/proc/self/clear_refs").write_text("5")
        return int(re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())[1]) >> 10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10


def faults(reader: str, count: int, seed: int = 0, *, loud: bool = False) -> list[str]:
    """One line for each altered file that was not answered as it must be."""
    suffix, make = READERS[reader]
    intact, found, counts = make(), [], {"read": 0, "refused": 0}
    held_mb = peak_mb(afresh=True)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / f"a{suffix}"
        path.write_bytes(intact)
        columns = Columns(time="0", position="1", velocity="2", force="3") if reader == "npy" else Columns()
        if answer(path, columns) != "read":
            return [f"{reader}: the intact file is not read"]
        for k in range(count):
            path.write_bytes(altered(intact, np.random.default_rng([seed, k])))
            start = time.process_time()
            try:
                counts[answer(path, columns)] += 1
            except Exception as error:
                found.append(f"{reader}, seed ({seed}, {k}): {type(error).__name__}: {error}"[:300])
            if (taken := time.process_time() - start) > SLOWEST_S:
                found.append(f"{reader}, seed ({seed}, {k}): {taken:.1f} s")
            if loud and k % 500 == 0:
                print(f"{reader}: {k} of {count}, {counts}", file=sys.stderr, flush=True)
    if (more := peak_mb() - held_mb) > MOST_MB:
        found.append(f"{reader}: {more} MB more")
    return found


if __name__ == "__main__":
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    wrong = [line for reader in sys.argv[2:] or READERS for line in faults(reader, total, loud=True)]
    print("\n".join(wrong) or "every altered file was read or refused in one line")
    sys.exit(bool(wrong))
