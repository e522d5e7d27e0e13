"""Where the recordings of ground engines lie, and the program run on them as a user would."""

from __future__ import annotations

import csv
import io
import os
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main

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
    """Standard output and standard error of one run of the program, in this process, that ended well."""
    before = os.getcwd()
    os.chdir(REPOSITORY)
    try:
        with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as told:
            code = main([str(a) for a in arguments])
    finally:
        os.chdir(before)
    assert code == 0, told.getvalue()
    return out.getvalue(), told.getvalue()


def table(text):
    """Rows of a CSV that the program wrote, as dictionaries."""
    return list(csv.DictReader(line for line in io.StringIO(text) if not line.startswith("#")))
