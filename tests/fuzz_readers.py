"""Altered files against every reader: no traceback, no crash, no second of waiting, no half gigabyte.

python tests/fuzz_readers.py 20000 [FORMAT ...]     # each format in turn; prints the worst time and memory of each
"""

from __future__ import annotations

import resource
import shutil
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from comanip.errors import ComanipError
from comanip.formats import read, write
from comanip.formats.columns import Columns
from comanip.formats.guessing import guess
from comanip.formats.listing import listed, look
from lifts import lift

FORMATS = ("mcap", "foreign mcap", "db3", "bag", "parquet", "lerobot", "hdf5", "csv", "topics", "toml")
MAPPED = Columns(position="/ee_pose.pose.position.z", force="/ft.wrench.force.z", time="none", rate_hz=100)


def seed_file(kind: str, folder: Path) -> tuple[Path, Path]:
    """(what is read, the file in it that is altered)."""
    short = lift(duration_s=0.5)
    if kind in ("mcap", "parquet", "hdf5", "csv"):
        write(short, folder / f"a.{kind}")
        return folder / f"a.{kind}", folder / f"a.{kind}"
    if kind == "lerobot":
        write(short, folder / "a.lerobot")
        (folder / "a.lerobot/meta/comanip.json").unlink()
        return folder / "a.lerobot", folder / "a.lerobot/meta/info.json"
    if kind == "topics":
        (folder / "t").mkdir()
        (folder / "t/pose.csv").write_text(
            "Time,header.frame_id,pose.position.x,pose.position.z\n" + "".join(f"{i / 10},b,0,{i}\n" for i in range(40))
        )
        (folder / "t/ft.csv").write_text(
            "Time,header.frame_id,wrench.force.x,wrench.force.z\n" + "".join(f"{i / 20},b,0,{i}\n" for i in range(80))
        )
        return folder / "t", folder / "t/ft.csv"
    if kind == "toml":
        (folder / "a.toml").write_text('position = ["z"]\nforce = "-f"\nrate_hz = 100.0\n[frames]\nft = "hand"\n')
        return folder / "a.toml", folder / "a.toml"
    from bags import lifting, write_folder

    write_folder(folder / "bag", lifting(duration=0.2), "SQLITE3" if kind == "db3" else "MCAP")
    file = next((folder / "bag").glob("*.db3" if kind == "db3" else "*.mcap"))
    return (folder / "bag", folder / "bag/metadata.yaml") if kind == "bag" else (file, file)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four alterations: flips, numbers made extreme, pieces cut out, doubled, moved or filled, the end cut off."""
    found = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        if not found:
            break
        at, size = int(rng.integers(len(found))), int(rng.integers(1, 64))
        how = int(rng.integers(8))
        if how <= 1:
            found[at] ^= 1 << int(rng.integers(8))
        elif how == 2:
            found[at : at + 8] = rng.choice(
                [b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, b"\xff" * 7 + b"\x7f", b"\0" * 7 + b"\x40"]
            )
        elif how == 3:
            del found[at : at + size]
        elif how == 4:
            found[at:at] = found[at : at + size]
        elif how == 5:
            found[at : at + size] = rng.bytes(size)
        elif how == 6:
            found = found[:at]
        else:
            found[at : at + size] = rng.choice([b'"', b"\n", b",", b"[", b"nan", b"1e999", b"-", b"\\", b"\xc3\x28", b"%"]) * 3
    return bytes(found)


def fuzz(kind: str, count: int, seed: int = 0) -> tuple[float, int, int]:
    """(slowest read [s], most memory of this process and its children [MB], how many were refused). Raises what no user should
    see."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as place:
        target, file = seed_file(kind, Path(place))
        data, slowest, refused = file.read_bytes(), 0.0, 0
        others = sorted(target.glob("**/*.parquet")) if kind == "lerobot" else []
        contents = {f: f.read_bytes() for f in others}
        for number in range(count):
            hit = file if not others or number % 2 else others[number // 2 % len(others)]
            original = contents.get(hit, data)
            hit.write_bytes(altered(original, rng))
            slowest, refused = _one(kind, target, number, slowest, refused)
            hit.write_bytes(original)
        shutil.rmtree(target, ignore_errors=True)
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return slowest, peak >> 10, refused


def _one(kind: str, target: Path, number: int, slowest: float, refused: int) -> tuple[float, int]:
    columns = MAPPED if number % 2 and kind in ("foreign mcap", "db3", "bag") else None
    started = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if kind == "toml":
                from comanip.formats.mapping_file import mapping_file

                mapping_file(target)
            elif number % 4 == 2:
                seen = look(target)
                listed(seen)
                guess(seen, stamped=False)
            else:
                read(target, columns, recover=number % 4 == 3)
        except ComanipError as error:
            assert "\n" not in str(error), f"{kind} {number}: {error}"
            refused += 1
        except BaseException as error:
            raise AssertionError(f"{kind}, input {number}: {type(error).__name__}: {error}") from error
    return max(slowest, time.process_time() - started), refused


if __name__ == "__main__":
    for kind in sys.argv[2:] or FORMATS:
        slowest, peak, refused = fuzz(kind, int(sys.argv[1]))
        print(f"{kind}: {refused} of {sys.argv[1]} refused, slowest {slowest:.3f} s, peak {peak} MB", flush=True)
