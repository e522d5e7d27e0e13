"""What locate, explain and refine share: an engine, recordings, and the options that make a `Case` of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.intake_options import model_error_option, nominal_options, source_options
from enginediag_cli.commands.options import ConfigFile, probability_option, seed_option
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from enginediag_cli.intake.source import Source
    from enginediag_cli.mismatch.fit.load import Asked, Case, Loaded


def mismatch_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`ENGINE.yaml [FILE]...`, the options of recordings and nominal, and those of the search: as one `case: Case`."""

    @wraps(function)
    def with_case(
        *args: Any,
        engine_path: str,
        source: Source,
        nominal: str | None,
        accept_changed_engine: bool,
        asked: Asked,
        **others: Any,
    ) -> Any:
        from enginediag_cli.mismatch.fit.load import Case

        return function(*args, case=Case(engine_path, source, nominal, accept_changed_engine, asked), **others)

    nominal = nominal_options(
        help="Nominal engine, as written by identify, to start from, and its noise. Without it explain identifies the "
        "flights that it is given; locate and refine start from the engine file."
    )
    engine = click.argument("engine_path", metavar="ENGINE.yaml", type=ConfigFile())
    return engine(source_options(nominal(_search_options(with_case))))


def _search_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--model-error`, `--false-finding`, `--driver`, `--noise` and `--seed` as one `asked: Asked`."""

    @wraps(function)
    def with_asked(
        *args: Any,
        model_error: float | None,
        false_finding: float,
        drivers: tuple[str, ...],
        noise: str | None,
        seed: int,
        **others: Any,
    ) -> Any:
        from enginediag_cli.mismatch.fit.load import Asked

        return function(*args, asked=Asked(model_error, false_finding, drivers, noise, seed), **others)

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
        with_asked = option(with_asked)
    return with_asked


def without_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--without TERM` as `without: tuple[str, ...]`: effects that are not to be considered."""
    return click.option(
        "--without",
        metavar="TERM",
        multiple=True,
        callback=_known_terms,
        shell_complete=complete_terms,
        help="Leave this effect, or effect@site, out of the search. May be given several times.",
    )(function)


def complete_terms(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Names of physics terms for the shell."""
    from click.shell_completion import CompletionItem

    from enginediag_cli.physics.registry import term_names

    return [CompletionItem(name) for name in term_names() if name.startswith(incomplete)]


def _known_terms(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    if value:
        from enginediag_cli.config.hints import near
        from enginediag_cli.physics.registry import term_names

        for name in value:
            if name.partition("@")[0] not in term_names():
                hint = near(name.partition("@")[0], term_names())
                raise click.BadParameter(f"there is no physics term {name!r} ({hint})", context, parameter)
    return value


def provenance(command: str, case: Case, inherited: Sequence[str], **notes: str) -> tuple[str, ...]:
    """The `#` lines of a result: files, choices that differ from the default, and the recordings' own head."""
    from enginediag_cli.recordings.provenance import header_lines

    asked = case.asked
    told = {
        **case.source.notes,
        "model_error": "" if asked.model_error is None else f"{asked.model_error:g}",
        "false_finding": f"{asked.false_alarm:g}",
        "drivers": ", ".join(asked.drivers),
        "noise": asked.noise or "",
        **notes,
    }
    return header_lines(
        command,
        seed=asked.seed,
        configs=[p for p in (case.engine, case.nominal, *case.source.configs) if p],
        notes={name: text for name, text in told.items() if text},
        inherited=tuple(inherited),
    )


def tell_case(messages: Messages, case: Case, loaded: Loaded) -> None:
    """What should be known of the nominal state, and what was left out of the recordings, on stderr."""
    from enginediag_cli.presentation.baseline_doubts import tell_baseline
    from enginediag_cli.presentation.left_out import tell_left_out, tell_mismatches, tell_thinning

    if loaded.baseline is not None:
        tell_baseline(messages, loaded.baseline, case.source.engine_instance)
    tell_mismatches(messages, loaded.intake.mismatches)
    tell_thinning(messages, loaded.thinning)
    tell_left_out(messages, loaded.intake.left_out)
