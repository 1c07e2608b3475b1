"""page.wasm from page.c and the kernels' headers: `python -m comanip.page.build`; `--check` says whether it is still what ships.

The compiler is ziglang's clang, of the one version that is named here, so that the same sources give the same bytes everywhere.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).parent
SHIPPED = HERE / "page.wasm"
ZIGLANG = "0.17.1"
# nothing contracted: the numbers are those of the Python, to the bits that libm's functions leave
FLAGS = ("-target", "wasm32-wasi", "-O2", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-mexec-model=reactor", "-s")
WARNINGS = ("-Wall", "-Wextra", "-Wno-unused-function", "-Wno-unused-parameter")


def compiler_problem() -> str:
    """Why it cannot be built here; empty: it can."""
    try:
        found = version("ziglang")
    except PackageNotFoundError:
        return f"ziglang is not installed: pip install 'ziglang=={ZIGLANG}'"
    return "" if found == ZIGLANG else f"ziglang is {found}; the shipped file is made with {ZIGLANG}"


def built() -> bytes:
    """The WebAssembly of the sources as they are now."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "page.wasm"
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, *WARNINGS, "-o", str(target), "page.c"]
        subprocess.run(command, check=True, cwd=HERE)
        return target.read_bytes()


def main() -> int:
    if problem := compiler_problem():
        print(problem, file=sys.stderr)
        return 2
    new = built()
    if "--check" in sys.argv[1:]:
        same = SHIPPED.exists() and SHIPPED.read_bytes() == new
        print(
            "page.wasm is what its sources give" if same else "page.wasm differs from its sources: python -m comanip.page.build"
        )
        return 0 if same else 1
    SHIPPED.write_bytes(new)
    print(f"{SHIPPED}: {len(new)} bytes")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
