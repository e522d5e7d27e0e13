"""Where the recordings of ground engines lie, and the program run on them as a user would."""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIGS = REPOSITORY / "configs"


def public_data(name: str) -> Path:
    """Folder of a public data set; skips the test with a message where it is absent."""
    folder = Path(os.environ.get("ENGINEDIAG_SHARED") or REPOSITORY.parent / "shared") / "data" / name
    if not folder.is_dir():
        pytest.skip(
            f"public data '{name}' not found beside the checkout; put it in ../shared/data or set the "
            "environment variable ENGINEDIAG_SHARED"
        )
    return folder


def enginediag(*arguments):
    """Standard output and standard error of one run of the program that ended well."""
    done = subprocess.run(
        [sys.executable, "-m", "enginediag_cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=REPOSITORY,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def table(text):
    """Rows of a CSV that the program wrote, as dictionaries."""
    return list(csv.DictReader(line for line in io.StringIO(text) if not line.startswith("#")))
