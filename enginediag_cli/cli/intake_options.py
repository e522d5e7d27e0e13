"""The options by which recordings, recorder and nominal state come in: declared here, once, for every command."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from enginediag_cli.cli.judging import Compared
from enginediag_cli.cli.options import ConfigFile, FiniteRange, recordings_argument

Function = TypeVar("Function", bound=Callable[..., Any])

LENGTH = re.compile(r"\s*\d+(\.\d+)?\s*(s|min|h|)\s*")
"""A number of records, or a time."""


def source_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`[FILE]...`, `--recorder`, `--engine-instance`, `--accept-mismatch`, given as one `source: Recordings`."""

    @wraps(function)
    def with_source(
        *args: Any,
        recordings: tuple[str, ...],
        recorder: str | None,
        engine_instance: str,
        accept_mismatch: bool,
        **others: Any,
    ) -> Any:
        from enginediag_cli.api.inputs import Recordings

        return function(*args, source=Recordings(recordings, recorder, engine_instance, accept_mismatch), **others)

    return recordings_argument(recorder_options(accept_mismatch_option(with_source)))


def accept_mismatch_option(function: Function) -> Function:
    """`--accept-mismatch` as `accept_mismatch: bool`."""
    return click.option(
        "--accept-mismatch",
        is_flag=True,
        help="Go on with recordings that cannot be of this engine or in these units.",
    )(function)


def recorder_options(function: Function) -> Function:
    """`--recorder` as `recorder: str | None`, and `--engine-instance` as `engine_instance: str`, "" for all."""
    recorder = click.option("--recorder", metavar="FILE", type=ConfigFile(), help="Recorder of foreign recordings.")
    instance = click.option(
        "--engine-instance", default="", metavar="NAME", help="Use only this engine of the recordings."
    )
    return recorder(instance(function))


def nominal_options(*, required: bool = False, help: str = "") -> Callable[[Function], Function]:
    """`-n/--nominal FILE` as `nominal: str | None`, and `--accept-changed-engine` as `accept_changed_engine: bool`."""

    def decorate(function: Function) -> Function:
        accept = click.option(
            "--accept-changed-engine",
            is_flag=True,
            help="Use the engine file as it is now, although it is no longer the one that was identified.",
        )
        nominal = click.option(
            "-n",
            "--nominal",
            required=required,
            metavar="FILE",
            type=click.Path(exists=True, dir_okay=False, readable=True),
            help=help or "Nominal engine, as written by identify.",
        )
        return nominal(accept(function))

    return decorate


def window_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--window`, `--step`, for commands that judge window by window; beside `judging_options`."""
    window = click.option(
        "--window",
        metavar="LENGTH",
        callback=check_length,
        help="Length of a window: records (60) or time (300s, 10min, 1h). Without it, each flight is one window.",
    )
    step = click.option(
        "--step",
        metavar="LENGTH",
        callback=check_length,
        help="From the start of a window to that of the next; as long as the window when not given.",
    )
    return window(step(function))


def model_error_option(function: Function) -> Function:
    """`--model-error`, which means the same wherever a model is held against recordings."""
    return click.option(
        "--model-error",
        metavar="SHARE",
        type=FiniteRange(0, 0.1),
        help="Relative accuracy of the component maps, such as 0.003: what could be an error of theirs is no finding. "
        "When not given, what the nominal state found, or else what the engine file states; 0 trusts the maps.",
    )(function)


def judging_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--linearise`, `--reference`, `--last`, `--model-error`, with `--window` and `--step` of `window_options` if the
    command has them: given to it as one `windows`, arguments of the library."""

    @wraps(function)
    def with_windows(
        *args: Any,
        linearise: str,
        reference: int,
        last: int,
        model_error: float | None,
        window: str | None = None,
        step: str | None = None,
        **others: Any,
    ) -> Any:
        _check_plan(window, step)
        windows = {
            "window": window,
            "step": step,
            "linearise": linearise,
            "reference": reference,
            "last": last,
            "model_error": model_error,
        }
        return function(*args, windows=windows, **others)

    options = [
        click.option(
            "--linearise",
            type=click.Choice(["estimate", "nominal"]),
            default="estimate",
            show_default=True,
            help="Where the model is linearised: at the estimate for each window, or at nominal, which holds for "
            "small changes only.",
        ),
        click.option(
            "--reference",
            metavar="N",
            type=click.IntRange(min=0),
            default=0,
            help="Judge each flight and engine against its own first N records, believed healthy, instead "
            "of against the nominal engine alone.",
        ),
        click.option(
            "--last",
            metavar="N",
            type=click.IntRange(min=0),
            default=0,
            help="Judge only the last N records of each flight and engine.",
        ),
        model_error_option,
    ]
    for option in reversed(options):
        with_windows = option(with_windows)
    return with_windows


def monitor_option(function: Function) -> Function:
    """`--monitor PATTERN` as `patterns: tuple[str, ...]`."""
    return click.option(
        "--monitor",
        "patterns",
        metavar="PATTERN",
        multiple=True,
        help="Parameters that may have changed, such as 'hpc.*' or sensor.T3.bias; those that the engine file "
        "monitors when not given. May be given several times.",
    )(function)


def check_length(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """A number of records or a time, or click's own message."""
    if value is not None and not LENGTH.fullmatch(value):
        raise click.BadParameter(f"{value!r} is not a number of records (60) or a time (300s, 10min, 1h)")
    return value


def _check_plan(window: str | None, step: str | None) -> None:
    """Click's own message when the options do not fit together."""
    from enginediag_cli.api.inputs import WindowOptions
    from enginediag_cli.errors import UsageError

    try:
        _ = WindowOptions(window, step).judging
    except UsageError as error:
        raise click.UsageError(str(error)) from None


def compared_options(*, required: bool = False, help: str = "") -> Callable[[Function], Callable[..., Any]]:
    """`-n/--nominal`, `--accept-changed-engine` and `--monitor` as one `compared: Compared`."""

    def decorate(function: Function) -> Callable[..., Any]:
        @wraps(function)
        def with_compared(
            *args: Any, nominal: str | None, accept_changed_engine: bool, patterns: tuple[str, ...], **others: Any
        ) -> Any:
            return function(*args, compared=Compared(nominal, patterns, accept_changed_engine), **others)

        return nominal_options(required=required, help=help)(monitor_option(with_compared))

    return decorate
