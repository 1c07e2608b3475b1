"""recover."""

from __future__ import annotations

from pathlib import Path

from ..formats import recover as recover_file
from .console import print_json


def recover(file: Path, out: Path | None, json: bool) -> None:
    target, recording = recover_file(file, out)
    frames = {name: len(channel.time) for name, channel in recording.channels.items()}
    if json:
        print_json(
            {
                "written": str(target),
                "said": recording.metadata["recovered"],
                "duration_s": recording.duration_s,
                "frames": frames,
            }
        )
        return
    print(f"{target}: {recording.duration_s:.2f} s, {max(frames.values(), default=0)} frames; {recording.metadata['recovered']}")
