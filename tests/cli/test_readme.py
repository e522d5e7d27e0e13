"""The README's commands and the ones that are checked are the same."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_ci_runs_the_readmes_second_command_word_for_word():
    command = (ROOT / ".ci" / "run").read_text(encoding="utf-8").rstrip().splitlines()[-1]
    assert command in (ROOT / "README.md").read_text(encoding="utf-8")
