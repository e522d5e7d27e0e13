"""Start-up stays light: what a command line does not need is not imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.cli.main import COMMANDS

TOP = Path(__file__).parents[2]
HEAVY = {"numpy", "scipy", "rich", "yaml", "importlib.metadata"}
NOT_FOR_FEW_RECORDS = {
    "scipy",
    "rich",
    "numpy.random",
    "tempfile",
    "multiprocessing",
    "asyncio",
    "enginediag_cli.recordings.recorder",
}
"""What `detect` of two records of its own format has no use for."""


def imported_by(code: str) -> set[str]:
    """Names in sys.modules after `code` ran in a fresh interpreter."""
    script = f"import sys\n{code}\nprint('\\n'.join(sys.modules), file=sys.stderr)"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return set(done.stderr.split())


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["detct"]])
def test_version_help_and_a_misspelt_command_import_no_numerics_and_no_command(arguments):
    modules = imported_by(f"from enginediag_cli.__main__ import main\nmain({arguments!r})")
    assert modules.isdisjoint(HEAVY)
    assert modules.isdisjoint(f"enginediag_cli.cli.{entry.module}" for entry in COMMANDS.values())


def test_version_imports_little_more_than_click():
    ours = imported_by("from enginediag_cli.__main__ import main\nmain(['--version'])") - imported_by("import click")
    assert len([name for name in ours if name.startswith("enginediag_cli")]) <= 9
    # makes classes by inspecting and compiling, which takes as long as a fifth of click
    assert ours.isdisjoint({"dataclasses", "pathlib", "json"})


@pytest.mark.parametrize("name", list(COMMANDS))
def test_a_commands_module_imports_no_numerics_before_it_runs(name):
    assert imported_by(f"import enginediag_cli.cli.{COMMANDS[name].module}").isdisjoint(HEAVY)


def test_detect_of_few_records_imports_only_what_it_uses(tmp_path):
    nominal, healthy, two = tmp_path / "nominal.yaml", tmp_path / "healthy.csv", tmp_path / "two.csv"
    engine = str(TOP / "configs" / "turbojet.yaml")
    assert main(["simulate", engine, "--records", "300", "--seed", "1", "-q", "-o", str(healthy)]) == 0
    assert main(["identify", engine, str(healthy), "--no-cross-validation", "-q", "-o", str(nominal)]) == 0
    lines = healthy.read_text(encoding="utf-8").splitlines(keepends=True)
    two.write_text("".join([line for line in lines if not line.startswith("#")][:3]), encoding="utf-8")
    words = ["detect", "-q", "-n", str(nominal), str(two)]
    # NumPy before version 2 imports its random numbers itself
    modules = imported_by(f"from enginediag_cli.__main__ import main\nassert main({words!r}) == 0") - imported_by(
        "import numpy"
    )
    assert modules.isdisjoint(NOT_FOR_FEW_RECORDS), modules & NOT_FOR_FEW_RECORDS
