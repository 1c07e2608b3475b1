"""The exported C on another processor: emulated aarch64, wasm32 in Node.js, and this one without a multiply-add.

A program of the C alone reads observations and writes commands; whoever asks compares them with what Python said.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..errors import ParameterError
from .c_file import Source
from .loaded import STRICT, cmd_type

INIT, REARM = 0, -1  # else so many observations follow
ZIG = (sys.executable, "-m", "ziglang", "cc")
# name -> what compiles, and what runs the result
WITNESSES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "aarch64": (("aarch64-linux-gnu-gcc", "-static"), ("qemu-aarch64",)),
    "aarch64-musl": ((*ZIG, "-target", "aarch64-linux-musl"), ("qemu-aarch64",)),
    "wasm32": ((*ZIG, "-target", "wasm32-wasi"), ("node", "--no-warnings", "run.mjs")),
    "x86-64-plain": ((*ZIG, "-target", "x86_64-linux-musl", "-mcpu=x86_64"), ()),
}
STREAM = """
#include <stdio.h>
#include "skill.h"
#define MOST 4096
static skill_state robot;
static skill_obs seen[MOST];
static skill_cmd does[MOST];
int main(void) {
    int n;
    while (fread(&n, sizeof n, 1, stdin) == 1) {
        if (n == 0) skill_init(&robot);
        else if (n < 0) {
            n = skill_rearm(&robot);
            fwrite(&n, sizeof n, 1, stdout);
        } else {
            if (n > MOST || fread(seen, sizeof *seen, (size_t)n, stdin) != (size_t)n) return 2;
            for (int i = 0; i < n; i++) skill_step(&robot, seen + i, does + i);
            fwrite(does, sizeof *does, (size_t)n, stdout);
        }
    }
    return 0;
}
"""
NODE = """
import { readFile } from "node:fs/promises";
import { WASI } from "node:wasi";
const wasi = new WASI({ version: "preview1", args: [], env: {} });
const module = await WebAssembly.compile(await readFile(process.argv[2]));
process.exit(wasi.start(await WebAssembly.instantiate(module, wasi.getImportObject())));
"""
MOST = 4096


def missing(name: str) -> str:
    """What this machine lacks for that witness; empty: nothing."""
    if name not in WITNESSES:
        return f"witness {name!r} is unknown; known: {', '.join(WITNESSES)}"
    compiles, runs = WITNESSES[name]
    if compiles[0] == sys.executable and find_spec("ziglang") is None:
        return "pip install ziglang"
    absent = [one for one in (compiles[0], *runs[:1]) if shutil.which(one) is None]
    return f"needs {', '.join(absent)}" if absent else ""


class Witness:
    """The C of `source`, compiled for another machine in `folder`. Raises ParameterError where that cannot be done."""

    def __init__(self, name: str, source: Source, folder: Path) -> None:
        if why := missing(name):
            raise ParameterError(f"witness {name}: {why}")
        compiles, runs = WITNESSES[name]
        folder = (folder / name).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for file, text in (("skill.h", source.h), ("skill.c", source.c), ("stream.c", STREAM), ("run.mjs", NODE)):
            (folder / file).write_text(text, encoding="utf-8")
        command = [*compiles, *STRICT, "-O2", "skill.c", "stream.c", "-o", "stream", "-lm"]
        made = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if made.returncode:
            raise ParameterError(f"witness {name}: {made.stderr.strip().splitlines()[0]}")
        self._folder, self._run = folder, [*runs, str(folder / "stream")]
        self._d = int(source.h.split("_AXES ")[1].split()[0])

    def answers(self, runs: Sequence[tuple[np.ndarray, Sequence[int]]]) -> list[tuple[np.ndarray, list[int]]]:
        """Of runs of observations, and the ticks after which it is re-armed: commands, and what each re-arming said."""
        sent, cuts = [], [_cuts(len(obs), rearmed) for obs, rearmed in runs]
        for (obs, rearmed), pieces in zip(runs, cuts, strict=True):
            sent.append(_number(INIT))
            for begin, end in pieces:
                sent += [_number(end - begin), obs[begin:end].tobytes(), _number(REARM) if end - 1 in rearmed else b""]
        done = subprocess.run(self._run, cwd=self._folder, input=b"".join(sent), capture_output=True)
        if done.returncode:
            raise ParameterError(f"the witness ended with {done.returncode}: {done.stderr.decode(errors='replace')[-200:]}")
        return self._read(done.stdout, runs, cuts)

    def _read(
        self, said: bytes, runs: Sequence[tuple[np.ndarray, Sequence[int]]], cuts: Sequence[list[tuple[int, int]]]
    ) -> list[tuple[np.ndarray, list[int]]]:
        kind, at, found = cmd_type(self._d), 0, []
        for (obs, rearmed), pieces in zip(runs, cuts, strict=True):
            out, answers = np.zeros(len(obs), kind), []
            for begin, end in pieces:
                out[begin:end] = np.frombuffer(said, kind, end - begin, at)
                at += (end - begin) * kind.itemsize
                if end - 1 in rearmed:
                    answers.append(int(np.frombuffer(said, np.int32, 1, at)[0]))
                    at += 4
            found.append((out, answers))
        return found


def _number(n: int) -> bytes:
    return np.int32(n).tobytes()


def _cuts(n: int, rearmed: Sequence[int]) -> list[tuple[int, int]]:
    """Pieces of n ticks that end where it is re-armed, none longer than the program reads at once."""
    ends = sorted({*(tick + 1 for tick in rearmed), *range(MOST, n, MOST), n})
    return list(zip([0, *ends[:-1]], ends, strict=True))
