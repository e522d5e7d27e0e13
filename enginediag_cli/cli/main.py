"""The command group. A command's module is imported only when that command runs or is asked for help.

To add a command: write `commands/<name>.py` and add its line to `COMMANDS`.
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


class Entry(NamedTuple):
    """Where a command lives, and its line in `enginediag --help`."""

    module: str
    attribute: str
    help: str


COMMANDS: dict[str, Entry] = {
    "simulate": Entry(
        "enginediag_cli.cli.simulate",
        "simulate",
        "Fly an engine, healthy or faulty, and write what its sensors record.",
    ),
    "identify": Entry(
        "enginediag_cli.cli.identify",
        "identify",
        "Fit the nominal engine and its sensor noise to healthy recordings.",
    ),
    "residual": Entry(
        "enginediag_cli.cli.residual", "residual", "Condense recordings into local statistics, window by window."
    ),
    "detect": Entry("enginediag_cli.cli.detect", "detect", "Say when an engine departs from nominal."),
    "isolate": Entry(
        "enginediag_cli.cli.isolate", "isolate", "Say which parameters changed, by how much and how surely."
    ),
    "locate": Entry("enginediag_cli.cli.locate", "locate", "Say where model and recordings differ, and with what."),
    "explain": Entry("enginediag_cli.cli.explain", "explain", "Say what physics the model lacks."),
    "refine": Entry(
        "enginediag_cli.cli.refine", "refine", "Put a missing effect into the model, if unseen flights gain by it."
    ),
    "study": Entry(
        "enginediag_cli.cli.study",
        "study",
        "Count how often diagnosis is right, on simulated engines with known faults.",
    ),
    "trend": Entry(
        "enginediag_cli.cli.trend", "trend", "Follow health over flights: level, onset and rate of deterioration."
    ),
    "fleet": Entry(
        "enginediag_cli.cli.fleet", "fleet", "Judge the engines of a fleet, rank them, and say what is common."
    ),
    "prove": Entry(
        "enginediag_cli.cli.prove", "prove", "Prove on blind trials what the search for missing physics finds."
    ),
    "check": Entry("enginediag_cli.cli.check", "check", "Validate YAML files and recordings."),
    "recorder": Entry("enginediag_cli.cli.recorder", "recorder", "Draft a recorder YAML from a foreign file."),
    "schema": Entry(
        "enginediag_cli.cli.schema", "schema", "Print the JSON schema of a kind of YAML file, or of an output."
    ),
    "physics": Entry("enginediag_cli.cli.physics", "physics", "Say which physical effects a model may carry or lack."),
    "components": Entry(
        "enginediag_cli.cli.components", "components", "Say of which components an engine file is made."
    ),
    "man": Entry("enginediag_cli.cli.man", "man", "Print the manual page of the program or of a command."),
    "report": Entry("enginediag_cli.cli.report", "report", "Write results as one page with charts that opens offline."),
    "demo": Entry(
        "enginediag_cli.cli.demo", "demo", "Run the whole chain on simulated flights and explain it in words."
    ),
}


class LazyGroup(click.Group):
    """A click group that reads names and help lines from `COMMANDS` and imports nothing else."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args and not ctx.resilient_parsing:
            click.echo(ctx.get_help(), err=True, color=ctx.color)
            ctx.exit(ExitCode.TROUBLE)  # which versions of click do by themselves with one code or another
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        entry = COMMANDS.get(cmd_name)
        if entry is None:
            return None
        from enginediag_cli.cli.general import equip

        command: click.Command = getattr(import_module(entry.module), entry.attribute)
        return equip(command, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            from difflib import get_close_matches

            near = get_close_matches(name, COMMANDS)
            hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
            raise click.UsageError(f"no such command {name!r}{hint}", ctx)
        found, command, rest = super().resolve_command(ctx, args)
        if command is not None and found is not None:
            from enginediag_cli.cli.general import asks_for_config, print_config
            from enginediag_cli.cli.operation import prepare

            prepare(command, found, rest, ctx)
            if asks_for_config(rest):
                print_config(command, found, rest, ctx)
                ctx.exit()
        return found, command, rest

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        names = [name for name in COMMANDS if name.startswith(incomplete)]
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [CompletionItem(name, help=COMMANDS[name].help) for name in names] + options

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in COMMANDS.items()])


@click.group(
    cls=LazyGroup,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="enginediag", message="%(prog)s %(version)s")
@message_options
def enginediag() -> None:
    """Diagnose gas turbines from recorded flights with a physical model of the engine.

    \b
    enginediag demo
    enginediag simulate configs/turbofan.yaml --seed 1 -o healthy.csv
    enginediag identify configs/turbofan.yaml healthy.csv -o nominal.yaml
    enginediag detect -n nominal.yaml flight.csv

    FILE may be - for standard input. Data go to standard output, everything else to standard error.

    \b
    Any option of a command has a default in the environment, ENGINEDIAG_<COMMAND>_<OPTION>:
    export ENGINEDIAG_DETECT_FALSE_ALARM=0.001; after it comes enginediag.yaml in the working folder
    (kind: defaults); --print-config says what holds and why.
    Completion of commands, options, file kinds and effects; for zsh and fish alike:
    eval "$(_ENGINEDIAG_COMPLETE=bash_source enginediag)"

    \b
    Exit codes: 0 done; 1 finding (only with --exit-code); 2 bad usage, configuration or data;
    3 no verdict; 70 internal error; 75 --lock is held; 130 interrupted.
    """
