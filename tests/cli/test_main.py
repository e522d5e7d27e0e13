"""The group: help, version, near matches, and conventions that every command keeps."""

from __future__ import annotations

import os
import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from enginediag_cli import __version__
from enginediag_cli.cli.main import COMMANDS, enginediag
from enginediag_cli.cli.options import HEADINGS, long_name

ROOT = Path(__file__).parents[2]

SCREEN = 50
"""Lines of a terminal window that is neither small nor large."""


def test_version_is_that_of_the_package(run):
    assert run("--version").stdout == f"enginediag {__version__}\n"


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_lists_every_command_with_its_line(run, option):
    ended = run(option)
    assert ended.exit_code == 0
    for name, entry in COMMANDS.items():
        assert f"  {name}" in ended.stdout
        assert entry.help.split()[0] in ended.stdout


def test_help_fits_80_columns(run):
    assert max(len(line) for line in run("--help").stdout.splitlines()) <= 100


def test_a_misspelt_command_gets_a_near_match(run):
    ended = run("detct")
    assert ended.exit_code == 2
    assert "no such command 'detct'; did you mean 'detect'?" in ended.stderr
    assert ended.stdout == ""


def test_a_misspelt_option_gets_a_near_match(run):
    ended = run("--verion")
    assert ended.exit_code == 2
    assert "--version" in ended.stderr


def test_no_command_shows_help_and_is_a_usage_error():
    assert CliRunner().invoke(enginediag, []).exit_code == 2


def test_shell_completion_offers_the_commands(shell):
    environment = {
        **os.environ,
        "_ENGINEDIAG_COMPLETE": "bash_complete",
        "COMP_WORDS": "enginediag de",
        "COMP_CWORD": "1",
    }
    ended = shell(env=environment)
    assert ended.exit_code == 0
    assert "plain,detect" in ended.stdout.splitlines()


@pytest.mark.parametrize("name", list(COMMANDS))
class TestEveryCommand:
    """Conventions that a new line in `COMMANDS` takes on."""

    @pytest.fixture
    def command(self, name) -> click.Command:
        command = enginediag.get_command(click.Context(enginediag), name)
        assert command is not None
        return command

    def test_has_help_with_an_example_and_its_exit_codes(self, name, command, run):
        help_text = run(name, "--help").stdout
        assert f"enginediag {name}" in help_text.split("\nInput:")[0].split("\nOperation:")[0].split("\n", 1)[1]
        assert "Exit codes:" in help_text
        assert command.help

    def test_describes_every_option(self, name, command):
        silent = [p.name for p in command.params if isinstance(p, click.Option) and not p.help]
        assert silent == []

    def test_groups_its_options_by_headings_that_fit_a_screen_each(self, name, command, run):
        text = run(name, "--help").stdout
        found = [line for line in text.splitlines() if line.rstrip(":") in HEADINGS and line.endswith(":")]
        assert found == [f"{heading}:" for heading in HEADINGS if f"\n{heading}:\n" in text]
        for part in re.split(rf"\n(?=(?:{'|'.join(HEADINGS)}):\n)", text)[1:]:
            assert part.count("\n") <= SCREEN
        assert {p.heading for p in command.params if isinstance(p, click.Option)} <= set(HEADINGS)

    def test_names_its_parameters_as_its_options(self, name, command):
        for option in (p for p in command.params if isinstance(p, click.Option)):
            assert option.name == long_name(option).replace("-", "_")

    def test_can_be_quiet_and_debugged(self, name, command):
        flags = {flag for parameter in command.params for flag in parameter.opts}
        assert {"--quiet", "--debug", "--color"} <= flags

    def test_is_mentioned_in_the_readme(self, name, command):
        assert f"enginediag {name}" in (ROOT / "README.md").read_text(encoding="utf-8")
