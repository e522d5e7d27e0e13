"""What residual, detect and isolate share: the options of windows, and recordings opened as windows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.origin import Origin, of_engine
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.errors import ExitCode
    from enginediag_cli.parameters import Parameter
    from enginediag_cli.recordings.table import Recording
    from enginediag_cli.residuals.monitor import Monitor
    from enginediag_cli.residuals.pipeline import WindowStatistics
    from enginediag_cli.residuals.windows import WindowPlan

Window = tuple["WindowStatistics", "dict[str, Parameter]"]
"""Statistics of a window, and what its parameters are, by name."""


CHUNK = 3000
"""Records read at once: rows appear while a long recording is being read, engine calls stay few."""


def window_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--window`, `--step`, `--linearise`, `--monitor`."""
    options = [
        click.option(
            "--window",
            metavar="LENGTH",
            callback=_check_length,
            help="Length of a window: records (60) or time (300s, 10min, 1h). Without it, each flight is one window.",
        ),
        click.option(
            "--step",
            metavar="LENGTH",
            callback=_check_length,
            help="From the start of a window to that of the next; as long as the window when not given.",
        ),
    ]
    function = model_options(function)
    for option in reversed(options):
        function = option(function)
    return function


def model_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--linearise`, `--monitor`: what residuals are compared with."""
    options = [
        click.option(
            "--linearise",
            type=click.Choice(["estimate", "nominal"]),
            default="estimate",
            show_default=True,
            help="Where the model is linearised: at the estimate for each window, or "
            "at nominal, which holds for small changes only.",
        ),
        click.option(
            "--monitor",
            "patterns",
            metavar="PATTERN",
            multiple=True,
            help="Parameters that may have changed, such as 'hpc.*' or sensor.T3.bias; those that the "
            "engine file monitors when not given. May be given several times.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def statistics_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """`-n/--nominal FILE`, not needed when the input holds statistics that `residual` wrote."""
    return click.option(
        "-n",
        "--nominal",
        metavar="FILE",
        type=click.Path(exists=True, dir_okay=False, readable=True),
        help="Nominal engine, as written by identify; not needed for what residual has written.",
    )(function)


def false_alarm_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--false-alarm P`, the probability of an alarm in a window without change."""
    return click.option(
        "--false-alarm",
        metavar="P",
        type=click.FloatRange(0, 1, min_open=True, max_open=True),
        default=0.01,
        show_default=True,
        help="Probability that a test cries wolf.",
    )(function)


def _check_length(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    if value is not None:
        import re

        if not re.fullmatch(r"\s*\d+(\.\d+)?\s*(s|min|h|)\s*", value):
            raise click.BadParameter(f"{value!r} is not a number of records (60) or a time (300s, 10min, 1h)")
    return value


def planned(window: str | None, step: str | None) -> WindowPlan:
    """The plan of windows, with click's own message when the options do not fit together."""
    from enginediag_cli.residuals.windows import plan_windows

    try:
        return plan_windows(window, step)
    except ValueError as error:
        raise click.UsageError(f"--window, --step: {error}") from None


def load_monitor(messages: Messages, nominal_path: str, patterns: tuple[str, ...], *, sensors: bool = False) -> Monitor:
    """Engine and nominal state, to compare recordings with; sensors: the bias of every sensor in use may have changed,
    too. Warns when the engine file has changed."""
    from enginediag_cli.identification.nominal_file import engine_change_warning, engine_file, read_nominal
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.residuals.monitor import monitor_from_nominal

    nominal = read_nominal(nominal_path)
    path = engine_file(nominal, nominal_path)
    engine = load_engine(path)
    other = [c for c in nominal.inputs if c not in engine.inputs]
    if len(other) == 1:  # identified with another power setting than the engine file's
        engine = load_engine(path, power_setting=other[0])
    warning = engine_change_warning(nominal, path)
    if warning:
        messages.warning(warning)
    monitor = monitor_from_nominal(engine, nominal, patterns)
    if not sensors:
        return monitor
    known = [p for column in monitor.sensors for p in engine.sensors[column].parameters()]
    biases = [p.name for p in known if p.quantity == "bias" and p.name not in monitor.monitored]
    return monitor_from_nominal(engine, nominal, (*monitor.monitored, *biases))


@dataclass
class Intake:
    """Input files as windows, and counts of what was met on the way, for stderr."""

    messages: Messages
    monitor: Monitor | None
    plan: WindowPlan
    linearise: str
    origin: Origin = field(default_factory=Origin)
    provenance: list[str] = field(default_factory=list)
    masked: dict[str, Counter[str]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def windows(self, files: Iterable[str]) -> Iterator[Window]:
        """Windows of all files in turn: recordings are condensed, statistics of `residual` are read back."""
        from enginediag_cli.recordings.read import read
        from enginediag_cli.residuals.flat import is_flat

        for file in files:
            if self.origin.recorder:
                for window, known in self._condensed(self._mapped(file)):
                    self._count(window)
                    yield window, known
                continue
            chunks = read(file, declared=self.declared(), chunk_records=CHUNK)
            first = next(chunks)
            self.remember(first)
            every = chain([first], chunks)
            found = self._flat(every) if is_flat(first.order) else self._condensed(map(self.clean, every))
            for window, known in found:
                self._count(window)
                yield window, known

    def recordings(self, files: Iterable[str]) -> Iterator[Recording]:
        """Chunks of the files with gross errors masked and counted."""
        from enginediag_cli.recordings.read import read

        for file in files:
            if self.origin.recorder:
                yield from self._mapped(file)
                continue
            for number, chunk in enumerate(read(file, declared=self.declared(), chunk_records=CHUNK)):
                if number == 0:
                    self.remember(chunk)
                yield self.clean(chunk)

    def report(self) -> None:
        """What was left out, on stderr."""
        from enginediag_cli.presentation.sentences import count, masked

        for column, reasons in self.masked.items():
            self.messages.note(masked(column, dict(reasons)))
        for number, what in (
            (self.counts["incomplete"], "without an input or any reading"),
            (self.counts["outside"], "outside the operating points identified, not judged"),
            (self.counts["failed"], "not computed by the engine"),
        ):
            if number:
                self.messages.note(f"{count(number, 'record')} {what}")

    def declared(self) -> tuple[str, ...]:
        if self.monitor is None:
            return ()
        engine = self.monitor.engine
        return (*engine.inputs, *engine.optional_inputs, *self.monitor.sensors, "time_s")

    def remember(self, chunk: Recording) -> None:
        self.provenance += [line for line in chunk.provenance if line not in self.provenance]

    def _mapped(self, file: str) -> Iterator[Recording]:
        for number, recording in enumerate(self.origin.mapped(self.messages, file)):
            if number == 0:
                self.remember(recording)
            yield recording

    def _condensed(self, chunks: Iterable[Recording]) -> Iterator[Window]:
        from enginediag_cli.residuals.reference import windows_against_reference

        if self.monitor is None:
            raise click.UsageError("a recording needs --nominal; only what residual has written does without")
        known = dict(self.monitor.meaning)
        origin = self.origin
        for window in windows_against_reference(
            self.monitor,
            chunks,
            self.plan,
            origin.reference,
            last=origin.last,
            linearise=self.linearise,
            model_error=origin.model_error,
        ):
            yield window, known

    def _flat(self, chunks: Iterable[Recording]) -> Iterator[Window]:
        from enginediag_cli.residuals.flat import read_flat

        for chunk in chunks:
            numbers = {c: [repr(x) for x in values.tolist()] for c, values in chunk.columns.items()}
            cells = {**chunk.text, **{c: ["" if x == "nan" else x for x in v] for c, v in numbers.items()}}
            rows = (dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True))
            yield from read_flat(rows, chunk.source, chunk.line.tolist())

    def clean(self, chunk: Recording, *, search: bool = True) -> Recording:
        from enginediag_cli.recordings.quality import mask_gross
        from enginediag_cli.residuals.admission import check_inputs

        if self.origin.engine_instance:
            chunk = of_engine(chunk, self.origin.engine_instance)
        if self.monitor is None or not len(chunk):
            return chunk
        check_inputs(self.monitor, chunk)
        columns = [c for c in self.declared() if c in chunk.columns and c != "time_s"]
        clean, report = mask_gross(chunk, columns=columns, search=search)
        for column, reasons in report.counts.items():
            found = {reason: n for reason, n in reasons.items() if n}
            if found:
                self.masked.setdefault(column, Counter()).update(found)
        return clean

    def _count(self, window: WindowStatistics) -> None:
        self.counts.update(
            windows=1,
            records=window.records,
            outside=window.outside,
            incomplete=window.incomplete,
            failed=window.failed,
        )


def ending(found: int, judged: int, windows: int, exit_code: bool) -> ExitCode:
    """Exit code: a finding only on request; no verdict when not one window could be judged."""
    from enginediag_cli.errors import ExitCode

    if found and exit_code:
        return ExitCode.FINDING
    return ExitCode.DONE if judged or not windows else ExitCode.NO_VERDICT
