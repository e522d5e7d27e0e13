"""`residual`, `detect` and `follow`: recordings compared with a nominal engine, window by window."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from enginediag_cli.api.inputs import (
    SENTENCES,
    Comparison,
    NominalLike,
    RecordingsLike,
    compare,
    open_intake,
    report_exclusions,
    resolve_recordings,
)
from enginediag_cli.api.results import Picture, Result, Row
from enginediag_cli.errors import UsageError
from enginediag_cli.report.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import RequiredPower
    from enginediag_cli.intake.selection import RecordingSource
    from enginediag_cli.methods.base import FittedMethod, Method, WindowVerdict
    from enginediag_cli.residuals.files import WindowReader

__all__ = [
    "DetectionResult",
    "FollowResult",
    "MethodResult",
    "ResidualResult",
    "detect",
    "detect_by_method",
    "follow",
    "residual",
]


class HasVerdict(Protocol):
    """What was judged: `verdict` is healthy, fault or no verdict."""

    @property
    def verdict(self) -> str: ...


Judged = TypeVar("Judged", bound=HasVerdict)


class ResidualResult(Result):
    """Sufficient statistics of windows, or residuals of records; see `residual`."""

    def __init__(self, comparison: Comparison, what: str, sensors: bool):
        from enginediag_cli.report.tables.detection import RECORDS, RESIDUAL
        from enginediag_cli.residuals.flat import CHECKSUM, ORIGIN_COLUMNS, flat_columns

        monitor = comparison.monitor(sensors=sensors, drifts=sensors)
        if monitor is None:
            raise UsageError("residual needs a nominal engine")
        self._monitor, self._what = monitor, what
        self._files = files = comparison.files(monitor)
        records = what == "records"
        files.additive = not records
        at_nominal = records or comparison.judging.linearise == "nominal"
        notes = {"linearised": "at nominal" if at_nominal else "at each estimate"}
        table = RECORDS if records else RESIDUAL
        super().__init__(
            table=table,
            head=comparison.head("residual", table, files.intake, notes),
            columns=None if records else (*flat_columns(monitor.monitored, files.nuisance), *ORIGIN_COLUMNS, CHECKSUM),
            # residuals go by the engine's own sensors, in their order
            messages=comparison.messages,
        )
        self.unread = files.intake.unread

    def _compute(self) -> Iterator[Row]:
        yield from self._records() if self._what == "records" else self._statistics()
        report_exclusions(self.messages, self._files)

    def _statistics(self) -> Iterator[Row]:
        from enginediag_cli.residuals.files import describe_origin
        from enginediag_cli.residuals.flat import add_checksum, flat_row

        made = describe_origin(self._files, self._monitor)
        for window, _ in self._files.windows():
            self.judged = self._files.counts["statistics"]
            yield add_checksum(flat_row(window), made)

    def _records(self) -> Iterator[Row]:
        from enginediag_cli.residuals.files import record_residuals

        for chunk in self._files.intake.chunks():
            for row in record_residuals(self._monitor, chunk):
                self.judged += any(value == value for name, value in row.items() if name.endswith(":residual"))
                yield row


def residual(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    what: str = "statistics",
    sensors: bool = False,
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> ResidualResult:
    """Reduce recordings to sufficient statistics of windows, or list residuals record by record.

    Parameters
    ----------
    nominal : str, Path, Baseline or IdentificationResult
        Nominal engine.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    what : {"statistics", "records"}
        One row of statistics (s, F, V) per window, which add, or one row of residuals per record.
    sensors : bool
        Statistics of the error of every sensor, too, for `isolate`.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read, in bounded memory.
    **windows
        Attributes of `WindowOptions`: ``window="10min"``, ``monitor=("hpc.*",)`` and so on.

    Returns
    -------
    ResidualResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError

    References
    ----------
    Local approach: s = Σ JᵀR⁻¹e, F = Σ JᵀR⁻¹J; see `enginediag_cli.residuals`.
    """
    return ResidualResult(compare(nominal, recordings, windows, messages), what, sensors).complete(stream)


class VerdictResult(Result):
    """A verdict for every window; `found` counts faults, `judged` the windows with a verdict."""

    _files: WindowReader

    def _verdicts(self, windows: Iterable[Judged]) -> Iterator[tuple[int, Judged]]:
        """Count the windows, numbered from 1; report the counts after the last."""
        tally: Counter[str] = Counter()
        for window in windows:
            tally[window.verdict] += 1
            self.findings, self.judged = tally["fault"], tally.total() - tally["no verdict"]
            yield tally.total(), window
        report_exclusions(self.messages, self._files)
        counted = ", ".join(f"{n} {what}" for what, n in sorted(tally.items())) or "no window"
        self.messages.note(counted, counts=dict(tally))


class DetectionResult(VerdictResult):
    """A verdict for every window; see `detect`."""

    def __init__(self, comparison: Comparison, false_alarm: float, required: RequiredPower, detectable: bool):
        from enginediag_cli.report.tables.detection import DETECT
        from enginediag_cli.residuals.reduced import MonitorCache

        self._comparison, self._false_alarm = comparison, false_alarm
        self._required, self._detectable = required, detectable
        self._monitor = monitor = comparison.monitor()
        self._files = files = comparison.files(monitor)
        # whether anything has changed does not depend on what wrong slopes of maps would make of the change
        files.economy = MonitorCache(replace(monitor, slopes=None)) if monitor else None
        if monitor is not None:
            required.check(monitor.monitored)
        head = comparison.head("detect", DETECT, files.intake, {"false_alarm": str(false_alarm)})
        super().__init__(table=DETECT, head=head, messages=comparison.messages)
        self.unread = files.intake.unread

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.detection.verdict import judge
        from enginediag_cli.report.tables.detection import DETECT, DETECTABLE, report_window

        monitor = None if self._comparison.judging.reference else self._monitor
        windows = self._files.windows()
        verdicts = (judge(window, self._false_alarm, self._required, monitor) for window, _ in windows)
        for number, verdict in self._verdicts(verdicts):
            report_window(self.messages, verdict, in_words=number <= SENTENCES)
            yield DETECT.row(verdict, DETECTABLE if self._detectable else ())

    def plot(self) -> Picture:
        """Draw the statistic of every window over its threshold. Raises NoVerdictError where nothing was judged."""
        from enginediag_cli.report.plotting.models import chart_svg, detection_chart

        return Picture(chart_svg(detection_chart(self.rows)))


def detect(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    false_alarm: float = 0.01,
    detectable: bool = True,
    power: float = 0.9,
    must_show: Sequence[tuple[str, float]] | str = (),
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> DetectionResult:
    """Test whether monitored parameters have changed: healthy, fault or no verdict for every window.

    Parameters
    ----------
    nominal : str, Path, Baseline, IdentificationResult or None
        Nominal engine; None where the recordings are statistics that `residual` made.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    false_alarm : float
        Probability of a false alarm of the test [1].
    detectable : bool
        Add the smallest change of each parameter that a window would have shown, in the parameter's unit.
    power : float
        Probability with which a change counts as shown [1].
    must_show : sequence of (str, float), or "none"
        Healthy is only a window that would have shown such a change, (pattern, size in the parameter's unit).
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read, in bounded memory.
    **windows
        Attributes of `WindowOptions`.

    Returns
    -------
    DetectionResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError

    References
    ----------
    Generalised likelihood ratio test of the local approach; see `enginediag_cli.detection.verdict`.
    """
    from enginediag_cli.detection.verdict import RequiredPower

    if detectable and power <= false_alarm:
        raise UsageError("--power must be larger than --false-alarm")
    if isinstance(must_show, str) and must_show != "none":
        raise UsageError(f"--must-show: {must_show!r} is neither (pattern, size) nor none")
    sizes = (("*", inf),) if isinstance(must_show, str) else tuple(must_show)
    required = RequiredPower(sizes, power)
    comparison = compare(nominal, recordings, windows, messages)
    return DetectionResult(comparison, false_alarm, required, detectable).complete(stream)


class FollowResult(Result):
    """A row for every block of a flight as it comes; see `follow`. `found` counts flights with an alarm."""

    def __init__(self, comparison: Comparison, false_alarm: float, block: int | None, idle_s: float):
        from enginediag_cli.history.follow import BLOCK, FlightFollower
        from enginediag_cli.report.tables.detection import FOLLOW
        from enginediag_cli.residuals.files import WindowSettings
        from enginediag_cli.residuals.reduced import add_sensor_lags

        monitor = comparison.monitor()
        if monitor is None:
            raise UsageError("--follow needs --nominal")
        size = block or BLOCK
        self._intake = open_intake(comparison.source, monitor)
        self._following = FlightFollower(self._intake, add_sensor_lags(monitor), false_alarm, size, idle_s)
        notes = {"follow": f"{size} records", "false_alarm": str(false_alarm)}
        head = comparison.head("detect", FOLLOW, self._intake, notes, judging=WindowSettings())
        super().__init__(table=FOLLOW, head=head, messages=comparison.messages)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.detection import FOLLOW, report_new_instruments
        from enginediag_cli.report.tables.recordings import report_excluded, report_mismatches

        alarms: dict[tuple[str, str, str], bool] = {}
        wrong: dict[tuple[str, str, str], set[str]] = {}
        following, intake = self._following, self._intake
        for report in following.reports():
            alarms[report.key] = report.alarm
            report_new_instruments(self.messages, report, wrong.setdefault(report.key, set()))
            self.findings = sum(alarms.values()) + sum(map(bool, wrong.values()))
            self.judged += 0 if report.reason else report.judged
            yield FOLLOW.row(report)
        report_mismatches(self.messages, intake.mismatches)
        report_excluded(self.messages, intake.excluded, following.counts, following.extrapolation)
        counts = {"flights": len(alarms), "alarms": sum(alarms.values()), "instruments": sum(map(bool, wrong.values()))}
        beside = f", {counts['instruments']} with an instrument that is stuck or scatters" * bool(counts["instruments"])
        self.messages.note(f"{counts['alarms']} of {len(alarms)} flights with an alarm{beside}", counts=counts)


def follow(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    false_alarm: float = 0.01,
    block: int | None = None,
    idle_s: float = 60.0,
    messages: Messages | None = None,
    stream: bool = True,
    **windows: Any,
) -> FollowResult:
    """Judge records as they come, from standard input or a growing file: a sequential test of each flight.

    Parameters
    ----------
    nominal : str, Path, Baseline or IdentificationResult
        Nominal engine.
    recordings
        One path, ``"-"`` for standard input.
    false_alarm : float
        Probability of a false alarm for the whole of each flight [1].
    block : int, optional
        Records of a block.
    idle_s : float
        A file to which nothing is added for so long has ended [s].
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    stream : bool
        Rows come as the flight does; without it, when it has ended.
    **windows
        ``monitor``, ``model_error`` and ``accept_changed_engine`` of `WindowOptions`.

    Returns
    -------
    FollowResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    return FollowResult(compare(nominal, recordings, windows, messages), false_alarm, block, idle_s).complete(stream)


class MethodResult(VerdictResult):
    """The verdicts of another method on each window; see `detect_by_method`."""

    def __init__(self, comparison: Comparison, name: str, healthy: Sequence[str], false_alarm: float):
        from enginediag_cli.report.tables.detection import METHOD
        from enginediag_cli.residuals.files import WindowSettings

        self._comparison, self._false_alarm = comparison, false_alarm
        monitor = comparison.monitor()
        if monitor is None:
            raise UsageError(f"--method {name} needs --nominal")
        self._monitor = monitor
        self._method = chosen_method(name, comparison.judging.linearise)
        self._files = files = comparison.files(monitor)
        self._fitted = self._learnt(resolve_recordings(tuple(healthy)) if self._method.learns else None)
        notes = {"method": self._method.name, "false_alarm": str(false_alarm)}
        head = comparison.head("detect", METHOD, files.intake, notes, configs=tuple(healthy), judging=WindowSettings())
        super().__init__(table=METHOD, head=head, messages=comparison.messages)
        self.unread = files.intake.unread

    def _learnt(self, healthy: RecordingSource | None) -> FittedMethod:
        from enginediag_cli.methods.base import training_windows
        from enginediag_cli.report.tables.recordings import report_excluded
        from enginediag_cli.residuals.gross_gate import GrossErrorGate

        if healthy is None:
            return self._method.train(self._monitor, None)
        source = replace(self._comparison.source, files=healthy.files)
        learnt = open_intake(source, self._monitor)
        gate = GrossErrorGate(self._monitor)
        windows = training_windows(self._monitor, gate.clean(learnt.chunks()), self._comparison.judging.plan)
        gate.report(learnt.excluded)
        report_excluded(self._comparison.messages, learnt.excluded)
        return self._method.train(self._monitor, windows)

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.methods.base import judge_windows, recorded_windows
        from enginediag_cli.report.tables.detection import METHOD, MethodRow
        from enginediag_cli.residuals.gross_gate import GrossErrorGate

        gate, files = GrossErrorGate(self._monitor), self._files

        def judged() -> Iterator[WindowVerdict]:
            windows = recorded_windows(self._monitor, gate.clean(files.intake.chunks()), self._comparison.judging.plan)
            yield from judge_windows(self._fitted, windows, self._false_alarm)
            gate.report(files.intake.excluded)

        for _, found in self._verdicts(judged()):
            place = found.window.place
            files.counts.update(outside=place.outside, incomplete=place.incomplete)
            files.extrapolation.update(place.extrapolation)
            yield METHOD.row(MethodRow(found, self._method))


def detect_by_method(
    nominal: NominalLike,
    recordings: RecordingsLike,
    method: str,
    *,
    healthy: Sequence[str] = (),
    false_alarm: float = 0.01,
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> MethodResult:
    """Judge each window by another method than the tool's own, as a study compares them.

    Parameters
    ----------
    nominal : str, Path, Baseline or IdentificationResult
        Nominal engine.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    method : str
        Such as ``"parity"``, ``"extended_kalman"``, ``"pca_raw"`` or ``"incremental"``.
    healthy : sequence of str
        Recordings believed healthy, for a method that learns.
    false_alarm : float
        Probability of a false alarm of the method [1].
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read, in bounded memory.
    **windows
        Attributes of `WindowOptions`.

    Returns
    -------
    MethodResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    comparison = compare(nominal, recordings, windows, messages)
    return MethodResult(comparison, method, healthy, false_alarm).complete(stream)


def method_names() -> Mapping[str, str]:
    """Return the names of the methods of `detect_by_method`, each with its help."""
    from enginediag_cli.methods.registry import METHODS

    return {name: method.help for name, method in METHODS.items()}


def chosen_method(name: str, linearise: str = "estimate") -> Method:
    """Find a method by name. Raises UsageError, with the nearest name."""
    from enginediag_cli.methods.registry import METHODS

    if name not in METHODS:
        from enginediag_cli.config.fields import near

        raise UsageError(f"there is no method {name!r} ({near(name, METHODS)})")
    return METHODS[name].configure({"linearise": linearise})
