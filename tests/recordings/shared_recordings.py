"""Where the public recordings lie: ENGINEDIAG_SHARED, or the folder `shared` beside the checkout."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
RECORDERS = REPOSITORY / "configs" / "recorders"


def shared_data(relative: str) -> Path:
    """Path of a public data file; skips the test with a message when it is not there."""
    root = Path(os.environ.get("ENGINEDIAG_SHARED") or REPOSITORY.parent / "shared")
    path = root / "data" / relative
    if not path.exists():
        pytest.skip(f"public recording data/{relative} is absent (ENGINEDIAG_SHARED: the folder of data/)")
    return path
