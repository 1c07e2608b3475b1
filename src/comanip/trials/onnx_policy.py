"""A policy in an ONNX file, through onnxruntime: weights and operations, no code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ParameterError
from ..interfaces import Array
from .policies import Brain, history_of, kept
from .sight import Seen


def brain(file: str, n_axes: int, goal: bool) -> Brain:
    """The first input is what is seen, (n,) or (1, n); the first output what is said, (d,), (1, d), or a chunk (1, H, d).

    As many inputs as outputs beyond the first are the memory: zeros at first, and then what came out. Metadata of the file may
    state `action` ("velocity", "acceleration") and, where n is not fixed, `history`.
    """
    return _Session(kept(_session, file, Path(file).stat().st_mtime_ns), file, n_axes, goal)


def _session(file: str) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise ParameterError(f"{file}: .onnx needs onnxruntime ({error}): pip install 'comanip[onnx]'") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ParameterError(f"{file}: no ONNX model: {error}") from None


class _Session(Brain):
    """One run of it."""

    def __init__(self, session: Any, file: str, n_axes: int, goal: bool) -> None:
        inputs, outputs = session.get_inputs(), session.get_outputs()
        if len(inputs) != len(outputs):
            raise ParameterError(
                f"{file}: {len(inputs)} inputs and {len(outputs)} outputs; allowed: what is seen and said, and as many of memory"
            )
        stated = session.get_modelmeta().custom_metadata_map
        size, ranks = inputs[0].shape[-1] if inputs[0].shape else None, len(inputs[0].shape)
        if isinstance(size, int):
            history = history_of(size, n_axes, goal, file)
        else:
            history = int(stated.get("history", "1"))
        self.seen = Seen(n_axes, history, goal, stated.get("action", "velocity"))
        self._session, self._names, self._ranks = session, [one.name for one in inputs], ranks
        self._kinds = [np.float64 if "double" in one.type else np.float32 for one in inputs]
        self._zeros = [
            np.zeros([n if isinstance(n, int) else 1 for n in one.shape], kind)
            for one, kind in zip(inputs[1:], self._kinds[1:], strict=True)
        ]
        self.reset()

    def reset(self) -> None:
        self._memory = [zeros.copy() for zeros in self._zeros]

    def __call__(self, values: Array) -> Array:
        seen = values.astype(self._kinds[0]).reshape((1,) * (self._ranks - 1) + (-1,))
        said, *self._memory = self._session.run(None, dict(zip(self._names, [seen, *self._memory], strict=True)))
        return np.asarray(said[0] if said.ndim == 3 or (said.ndim == 2 and len(said) == 1) else said, dtype=float)
