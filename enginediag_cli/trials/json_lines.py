"""Files of JSON objects, one a line, that are added to while work goes on and survive an interruption."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def parsed(line: str) -> dict[str, Any] | None:
    """The object of a line; None where it is none, as when it was cut short."""
    try:
        value = json.loads(line)
    except json.JSONDecodeError:
        return None
    return value if isinstance(value, dict) else None


def append(path: Path, *lines: str) -> None:
    """Add lines and see them on the disk. Raises OSError."""
    with open(path, "a", encoding="utf-8") as stream:
        stream.writelines(line + "\n" for line in lines)
        stream.flush()
        os.fsync(stream.fileno())


def rewrite(path: Path, lines: Iterable[str]) -> None:
    """Replace the file by these lines, completely or not at all. Raises OSError."""
    beside = path.with_name(path.name + ".part")
    beside.write_text("".join(line + "\n" for line in lines), encoding="utf-8")
    os.replace(beside, path)
