"""Where the public verification data lie, and how a test says that they are absent."""

from __future__ import annotations

import os
from pathlib import Path

SHARED = Path(os.environ.get("ENGINEDIAG_SHARED", Path(__file__).resolve().parents[2].parent / "shared"))
DATA = SHARED / "data"


def available(folder: str) -> bool:
    return (DATA / folder).is_dir()


def reason(folder: str) -> str:
    return (
        f"public data '{folder}' not found beside the checkout; put it in ../shared/data or set the "
        "environment variable ENGINEDIAG_SHARED"
    )
