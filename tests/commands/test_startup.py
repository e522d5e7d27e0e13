"""Start-up stays light: what a command line does not need is not imported."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from enginediag_cli.commands.main import COMMANDS

HEAVY = {"numpy", "scipy", "rich", "yaml", "importlib.metadata"}


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
    assert modules.isdisjoint(entry.module for entry in COMMANDS.values())


@pytest.mark.parametrize("name", list(COMMANDS))
def test_a_commands_module_imports_no_numerics_before_it_runs(name):
    module = COMMANDS[name].module
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not built")
    assert imported_by(f"import {module}").isdisjoint(HEAVY)
