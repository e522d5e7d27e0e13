"""The group of commands. A command's module is imported only when that command runs or is asked for help.

To add a command: write it in a module of this folder and add its line to `COMMANDS`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

import click

from enginediag_cli import __version__
from enginediag_cli.cli.options import message_options
from enginediag_cli.errors import ExitCode

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


class CommandEntry(NamedTuple):
    """Module of a command in this folder, where a function has its name, and its line in `enginediag --help`."""

    module: str
    help: str


COMMANDS: dict[str, CommandEntry] = {
    "simulate": CommandEntry("model", "Simulate the recordings of an engine, healthy or faulty."),
    "identify": CommandEntry("model", "Identify the nominal engine and its sensor noise from healthy recordings."),
    "residual": CommandEntry("model", "Reduce recordings to sufficient statistics, or list residuals."),
    "detect": CommandEntry("diagnosis", "Detect when an engine departs from its nominal state."),
    "isolate": CommandEntry("diagnosis", "Isolate the parameters that changed, with sizes and probabilities."),
    "locate": CommandEntry("discrepancy", "Locate where model and recordings differ, and with which variable."),
    "explain": CommandEntry("discrepancy", "Explain which physics the model lacks."),
    "refine": CommandEntry("discrepancy", "Add a missing effect to the model, if unseen flights confirm it."),
    "study": CommandEntry("validation", "Measure how often diagnosis is right, on engines with known faults."),
    "trend": CommandEntry("over_time", "Follow engine health over flights: level, onset, rate and EGT margin."),
    "fleet": CommandEntry("over_time", "Judge and rank the engines of a fleet, and find what is common to them."),
    "prove": CommandEntry("validation", "Validate explain and isolate in blind trials."),
    "check": CommandEntry("files", "Check YAML files and recordings before they are used."),
    "recorder": CommandEntry("files", "Draft a recorder file from a foreign recording."),
    "schema": CommandEntry("files", "Print the JSON schema of a kind of YAML file, or of an output."),
    "physics": CommandEntry("files", "List the physical effects that a model may carry or lack."),
    "components": CommandEntry("files", "List the components of which an engine file is made."),
    "glossary": CommandEntry("files", "Explain the words of the field that the program uses."),
    "man": CommandEntry("files", "Print the manual page of the program or of a command."),
    "report": CommandEntry("over_time", "Write results as one page with charts that opens offline."),
    "demo": CommandEntry("validation", "Run the whole chain on simulated flights and explain each step."),
}


class LazyGroup(click.Group):
    """A click group that reads names and help lines from `COMMANDS` and imports nothing else."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse; without a command, print the help and end with the code of bad usage."""
        if not args and not ctx.resilient_parsing:
            click.echo(ctx.get_help(), err=True, color=ctx.color)
            ctx.exit(ExitCode.TROUBLE)  # which versions of click do by themselves with one code or another
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        command: click.Command = getattr(import_module(f"{__package__}.{entry.module}"), cmd_name)
        command.short_help = entry.help
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command; a misspelt one is an error with the nearest names."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            from difflib import get_close_matches

            near = get_close_matches(name, COMMANDS)
            hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
            raise click.UsageError(f"no such command {name!r}{hint}", ctx)
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete the name of a command."""
        from enginediag_cli.cli.options import completions

        known = {name: entry.help for name, entry in COMMANDS.items()}
        return completions(known, incomplete) + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in COMMANDS.items()])


@click.group(
    cls=LazyGroup,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="enginediag", message="%(prog)s %(version)s")
def enginediag() -> None:
    """Diagnose gas turbines from recorded flights with a physical model of the engine.

    \b
    enginediag demo
    enginediag simulate configs/turbofan.yaml --seed 1 -o healthy.csv
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag detect -n nominal.yaml flight.csv

    FILE may be - for standard input. Data go to standard output, everything else to standard error.

    \b
    Every option has a default in the environment, ENGINEDIAG_<COMMAND>_<OPTION>:
    export ENGINEDIAG_DETECT_FALSE_ALARM=0.001. Next comes enginediag.yaml in the working folder
    (kind: defaults). --print-config prints the values in use and their sources.
    Shell completion (also zsh, fish): eval "$(_ENGINEDIAG_COMPLETE=bash_source enginediag)"

    \b
    Exit codes: 0 done; 1 finding (only with --exit-code); 2 bad usage, configuration or data;
    3 no verdict; 70 internal error; 75 --lock is held; 130 interrupted.
    """


enginediag.params += message_options()
