"""JSON files that say whether they are whole: a sha256 of everything else inside, and written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from errno import EISDIR
from pathlib import Path
from typing import Any


def digest(content: Mapping[str, Any]) -> str:
    """sha256 of everything but the field sha256, in canonical form."""
    rest = {k: v for k, v in content.items() if k != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes the file whole or not at all: a crash, Control-C or a full disk leaves the old one untouched. Makes the folder.

    A link is followed, so that what it leads to changes and not the link. Raises OSError that names `path`.
    """
    path = path.resolve()
    temporary = path.with_name(f".{path.name[:40]}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():  # a folder, or a device such as /dev/null, which must not become a file
            raise IsADirectoryError(EISDIR, "is a folder" if path.is_dir() else "is no ordinary file")
        _write(temporary, content.encode("utf-8") if isinstance(content, str) else content)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise type(error)(error.errno, error.strerror or str(error), str(path)) from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write(path: Path, content: bytes) -> None:
    with open(path, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
