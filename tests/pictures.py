"""What can be said of a picture without looking at it: its size, how much of it is ink, how many colours."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np


class Picture(NamedTuple):
    width: int
    height: int
    ink: float  # share of pixels that are not the most common colour
    colours: int
    spread: float  # share of a 6 x 6 grid of fields with ink in them: half a picture is half empty


def picture(path: Path) -> Picture:
    from matplotlib.image import imread

    pixels = np.asarray(imread(path))[..., :3]
    steps = (pixels * (255.0 if pixels.dtype.kind == "f" else 1.0)).astype(np.int64) // 16
    codes = steps @ [1, 32, 1024]
    values, counts = np.unique(codes, return_counts=True)
    ink = codes != values[counts.argmax()]
    fields = [f.mean() for row in np.array_split(ink, 6) for f in np.array_split(row, 6, axis=1)]
    return Picture(codes.shape[1], codes.shape[0], float(ink.mean()), len(values), float(np.mean(np.array(fields) > 0.003)))


def strokes(path: Path) -> int:
    """How many pieces of line and curve a drawing in .svg or .pdf is made of."""
    data = path.read_bytes()
    if path.suffix == ".svg":
        return len(re.findall(rb"[\d.] ?\n?[LCQ] ", data))
    assert data.startswith(b"%PDF")
    assert data.rstrip().endswith(b"%%EOF")
    streams = re.findall(rb"/FlateDecode.*?stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    return sum(len(re.findall(rb"[\d.] [lc]\n", zlib.decompressobj().decompress(one))) for one in streams)


def is_drawn(path: Path) -> bool:
    """A figure: large enough to read, with lines in more than two colours all over it."""
    if path.suffix != ".png":
        return strokes(path) > 300
    p = picture(path)
    return p.width > 500 and p.height > 200 and 0.01 < p.ink < 0.9 and p.colours > 10 and p.spread > 0.5
