"""What locate, explain and refine share: an engine, recordings, and the options that a search has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.cli.intake_options import model_error_option, nominal_options, source_options
from enginediag_cli.cli.options import ConfigFile, probability_option, seed_option
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from enginediag_cli.api.inputs import Recordings
    from enginediag_cli.api.results import Result


@dataclass(frozen=True)
class Searched:
    """What is searched, as arguments of the library: an engine, recordings, and `arguments` by their names."""

    engine: str
    source: Recordings
    arguments: dict[str, Any]


def mismatch_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`ENGINE.yaml [FILE]...`, the options of recordings and nominal, and those of the search: as one `searched`."""

    @wraps(function)
    def with_searched(
        *args: Any,
        engine_path: str,
        source: Recordings,
        nominal: str | None,
        accept_changed_engine: bool,
        model_error: float | None,
        false_finding: float,
        drivers: tuple[str, ...],
        noise: str | None,
        seed: int,
        **others: Any,
    ) -> Any:
        arguments = {
            "nominal": nominal,
            "accept_changed_engine": accept_changed_engine,
            "model_error": model_error,
            "false_finding": false_finding,
            "drivers": drivers,
            "noise": noise,
            "seed": seed,
        }
        return function(*args, searched=Searched(engine_path, source, arguments), **others)

    nominal = nominal_options(
        help="Nominal engine, as written by identify, to start from, and its noise. Without it explain identifies the "
        "flights that it is given; locate and refine start from the engine file."
    )
    engine = click.argument("engine_path", metavar="ENGINE.yaml", type=ConfigFile())
    return engine(source_options(nominal(_search_options(with_searched))))


def _search_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--model-error`, `--false-finding`, `--driver`, `--noise` and `--seed`."""
    options = [
        model_error_option,
        probability_option("--false-finding", 0.05, "Probability of finding something where nothing is missing."),
        click.option(
            "--driver",
            "drivers",
            metavar="COLUMN",
            multiple=True,
            help="A further recorded column that what is missing may vary with, such as hours or a valve's state. May "
            "be given several times.",
        ),
        click.option(
            "--noise",
            type=click.Choice(["specified", "estimate"]),
            help="specified: the sensors' noise as stated; estimate: what nothing that is looked for explains, its "
            "correlation in time included. When not given, that of the engine file for locate and refine, of the "
            "flights for explain; estimate with a nominal whose noise is what its fit left.",
        ),
        seed_option,
    ]
    for option in reversed(options):
        function = option(function)
    return function


def without_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--without TERM` as `without: tuple[str, ...]`: effects that are not to be considered."""
    return click.option(
        "--without",
        metavar="TERM",
        multiple=True,
        shell_complete=complete_terms,
        help="Leave this effect, or effect@site, out of the search. May be given several times.",
    )(function)


def complete_terms(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Names of physics terms for the shell."""
    from click.shell_completion import CompletionItem

    from enginediag_cli.api.discrepancy import effect_names

    return [CompletionItem(name) for name in effect_names() if name.startswith(incomplete)]


def draw(messages: Messages, result: Result, path: str) -> None:
    """Write the picture of a result; a note says why there is none."""
    try:
        result.plot().save(path)
    except NoVerdictError as nothing:
        messages.note(f"{path}: not written, {nothing}")
