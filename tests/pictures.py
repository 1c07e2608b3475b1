"""What can be said of a picture without looking at it: its size, how much of it is ink, how many colours."""

from __future__ import annotations

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


def is_drawn(path: Path) -> bool:
    """A figure: large enough to read, with lines in more than two colours all over it."""
    p = picture(path)
    return p.width > 500 and p.height > 200 and 0.01 < p.ink < 0.9 and p.colours > 10 and p.spread > 0.5
