"""A flight monitored while it is recorded: for each block of records the evidence of a change, its kind and its onset.

Evidence. A record whose readings repeat those before to the last digit brings no new noise, and
readings that scatter impossibly little were not measured. One sensor alone is no evidence either. Gross errors are
rejected, which bounds what a reading adds to the evidence, and keeps the mean of E at most 1: a Gaussian reading cut at
±c is sub-Gaussian. What has not yet lasted longer than a gross error may be one or may be a change: there is an alarm
only if E reaches 1/α without the brief departures of any one channel, too, a sensor's or an input's. What several
channels show at once is seen as soon as ever; what one alone shows, when it has lasted.

Kind and onset. Explanations of a flight are compared by their marginal likelihood:

    sudden fault              step of one or two health parameters, or of all together
    gradual deterioration     the same, growing linearly from its onset to now
    sensor jump, sensor drift step or ramp of one sensor's reading

Every kind has the same probability beforehand, and within a kind every onset. A change that was there when the flight
began has no onset in it and no law of growth: `present from the start`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from enginediag_cli.detection.sequential import (
    LAWS,
    ChangeEquations,
    Coordinates,
    EProcess,
    Innovations,
    Segment,
    eliminate_nuisance,
    log_full,
    log_mean_exp,
    log_single,
    onset_sums,
)
from enginediag_cli.detection.verdict import (
    LEAST_SENSORS,
    LackOfFit,
    is_lifeless,
    low_scatter_reason,
    one_channel_reason,
    too_few_sensors_reason,
)
from enginediag_cli.intake.loader import ExcludedData, GrossCounts, RecordingLoader, follow_chunks
from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.gross_errors import FEWEST, UNRELATED, find_brief_departures
from enginediag_cli.residuals.gross_gate import CleanBlocks, LiveGate, LiveRecords, input_effects
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import chdtrc
from enginediag_cli.residuals.windows import Extrapolation, Key, Timeline, group_rows, select_inputs
from enginediag_cli.units import split_column

KINDS = {
    ("health", "step"): "sudden fault",
    ("health", "ramp"): "gradual deterioration",
    ("sensor", "step"): "sensor jump",
    ("sensor", "ramp"): "sensor drift",
}
FAMILY = {kind: family for (family, _), kind in KINDS.items()}
FROM_START = "present from the start"
CANNOT_TELL = "cannot tell"
SURE = 0.9
"""Probability from which a kind of change is named."""
MIXED = 0.95
"""Probability of the interval of the onset."""


@dataclass(frozen=True)
class DetectedChange:
    """kind: one of KINDS, `present from the start` or `cannot tell`; probability of the most probable kind, which
    `leading` names. parameter: the most probable single parameter or sensor. onset, low, high: block number, most
    probable and 95 % interval; onset_s, low_s, high_s: the same as times."""

    kind: str
    leading: str
    probability: float
    parameter: str
    onset: int
    low: int
    high: int
    onset_s: float
    low_s: float
    high_s: float


def log_health(found: ChangeEquations, count: int) -> np.ndarray:
    """log likelihood ratios (J,) of a fault: one health parameter, two, or all, a third each."""
    single = log_mean_exp(log_single(found)[:, :count], axis=1)
    parts = [single, log_full(found, count)]
    if count > 1:
        i, k = np.array(list(combinations(range(count), 2))).T
        a, d, b = 1 + found.S[:, i, i], 1 + found.S[:, k, k], found.S[:, i, k]
        determinant = np.maximum(a * d - b**2, 1.0)
        x, y = found.r[:, i], found.r[:, k]
        quadratic = (d * x**2 - 2 * b * x * y + a * y**2) / determinant
        parts.append(log_mean_exp(-0.5 * np.log(determinant) + 0.5 * quadratic, axis=1))
    return log_mean_exp(np.stack(parts), axis=0)


def explain_change(past: list[Segment], coordinates: Coordinates) -> DetectedChange:
    """The most probable kind, parameter and onset of the change that an alarm has found."""
    a = len(coordinates.health)
    evidence: dict[str, np.ndarray] = {}
    singles: dict[str, np.ndarray] = {}
    for law in LAWS:
        found = eliminate_nuisance(onset_sums(past, law), coordinates.nuisance)
        for family, chosen in (("health", slice(0, a)), ("sensor", slice(a, None))):
            alone = log_single(found)[:, chosen]
            if not alone.shape[1]:
                continue
            kind = KINDS[family, law]
            evidence[kind] = log_health(found, a) if family == "health" else log_mean_exp(alone, axis=1)
            singles[kind] = alone
    kinds = list(evidence)
    table = np.stack([evidence[kind] for kind in kinds])  # (kinds, onsets)
    weights = np.exp(table - table.max())
    # a ramp over a single piece, or from the start, is no ramp
    weights[[kind in (KINDS["health", "ramp"], KINDS["sensor", "ramp"]) for kind in kinds], 0] = 0.0
    weights = weights / weights.sum()
    onset = int(np.argmax(weights.sum(axis=0)))
    low, high = _interval(weights.sum(axis=0))
    probabilities = {kind: float(weights[i, 1:].sum()) for i, kind in enumerate(kinds)}
    probabilities[FROM_START] = float(weights[:, 0].sum())
    leading = max(probabilities, key=lambda kind: probabilities[kind])
    likely = leading if leading in singles else kinds[int(np.argmax(weights[:, 0]))]
    names = coordinates.sensors if FAMILY[likely] == "sensor" else coordinates.health
    parameter = names[int(np.argmax(singles[likely][onset]))]
    kind = leading if probabilities[leading] >= SURE else CANNOT_TELL
    begin = [piece.begin for piece in past]
    first = [piece.first for piece in past]
    # pieces begin where they begin: a change may have come anywhere in the piece before or after the best beginning
    low, high = max(low - 1, 0), min(high + 1, len(past) - 1)
    return DetectedChange(
        kind,
        leading,
        probabilities[leading],
        parameter,
        first[onset],
        first[low],
        first[high],
        begin[onset],
        begin[low],
        begin[high],
    )


def posterior_change(past: list[Segment], coordinates: Coordinates) -> np.ndarray:
    """Posterior mean (a,) of the health parameters, in prior standard deviations, after a step at the best onset.

    Zero when the most probable explanation is a sensor's.
    """
    a = len(coordinates.health)
    found = eliminate_nuisance(onset_sums(past), coordinates.nuisance)
    health = log_health(found, a)
    alone = log_single(found)[:, a:]
    if alone.size and alone.max() > health.max():
        return np.zeros(a)
    j = int(np.argmax(health))
    return np.asarray(np.linalg.solve(np.eye(a) + found.S[j, :a, :a], found.r[j, :a]))


def _interval(weights: np.ndarray) -> tuple[int, int]:
    """First and last onset of the smallest set that holds MIXED of the probability (J,)."""
    order = np.argsort(-weights, kind="stable")
    held = np.cumsum(weights[order])
    chosen = order[: int(np.searchsorted(held, MIXED)) + 1]
    return int(chosen.min()), int(chosen.max())


JUMP_SIGMAS = 5.0
"""Size of a plausible jump of a sensor, in its noise, where the engine file has no prior for its bias."""
NEGLIGIBLE = 1e-6
"""Variances of nuisance combinations below this share of the largest are dropped; they are in prior units."""
NEVER_MOVED = "no reading has moved since the flight began"
"""Why a block is no evidence where a recorder stands still from the start: its one reading may be an old one."""


def unit_coordinates(monitor: Monitor) -> Coordinates:
    """Unit-normal coordinates of the uncertainty of nominal, of changes of health, and of sensor jumps.

    Parameters of the columns are those of the monitor, then a bias of each sensor.
    """
    p, m, a = len(monitor.names), len(monitor.sensors), len(monitor.monitored)
    D = monitor.prior_sigma
    eigenvalues, vectors = np.linalg.eigh(monitor.uncertainty / D / D[:, None])
    kept = eigenvalues > NEGLIGIBLE * max(eigenvalues.max(initial=0.0), 1e-300)
    root = D[:, None] * vectors[:, kept] * np.sqrt(eigenvalues[kept])
    k = root.shape[1]
    basis = np.zeros((p + m, k + a + m))
    basis[:p, :k] = root
    basis[range(a), range(k, k + a)] = D[:a]
    basis[range(p, p + m), range(k + a, k + a + m)] = [_jump(monitor, j) for j in range(m)]
    return Coordinates(basis, k, monitor.monitored, tuple(f"{c} reading" for c in monitor.sensors))


def _jump(monitor: Monitor, j: int) -> float:
    column = monitor.sensors[j]
    bias = monitor.engine.parameters.get(f"sensor.{split_column(column)[0]}.bias")
    sigma = float(monitor.noise.sigma[j])
    return max(bias.prior_sigma, sigma) if bias is not None and bias.prior_sigma > 0 else JUMP_SIGMAS * sigma


def _unit(S: np.ndarray) -> np.ndarray:
    """S (n, m, q) with columns of length 1 in every record, or 0."""
    size = np.linalg.norm(S, axis=1, keepdims=True)
    return np.asarray(S / np.where(size > 0, size, 1.0))


@dataclass(frozen=True)
class BlockReport:
    """Evidence after one block of a flight; a block of no records judges those that waited for what followed.

    Attributes
    ----------
    judged, outside, incomplete, failed, repeated : int
        Records that were judged, and those that were not, by reason; `repeated` records have the readings of the record
        before.
    sensors, sensors_of : int
        Sensors that gave a reading that was judged, and all sensors.
    log10_e : float
        Evidence of a change, log₁₀ E.
    alarm : bool
        Whether E has reached 1/α, in this block or before.
    change : DetectedChange or None
        Kind and onset of the change, once there is an alarm.
    reason : str
        Why the block is no evidence; "" where it is.
    extrapolation : Counter of Extrapolation
        Records outside the identified envelope.
    gross : GrossCounts
        Gross errors that were rejected.
    instruments : sequence of InstrumentFault
        Instruments that are stuck or scatter, as far as the flight has come.
    """

    key: Key
    block: int
    first_line: int
    last_line: int
    start_s: float
    end_s: float
    records: int
    judged: int
    sensors: int
    sensors_of: int
    log10_e: float
    alarm: bool
    change: DetectedChange | None
    outside: int = 0
    incomplete: int = 0
    failed: int = 0
    repeated: int = 0
    reason: str = ""
    extrapolation: Counter[Extrapolation] = field(default_factory=Counter)
    gross: GrossCounts = field(default_factory=GrossCounts)
    instruments: Sequence[InstrumentFault] = ()


@dataclass
class FlightMonitor:
    """Follows one flight of one engine; `add` takes the records of the next block. gross: what was rejected of the
    records that are decided for good, of all when the flight has ended."""

    monitor: Monitor
    key: Key
    false_alarm: float
    process: EProcess = field(init=False)
    gross: GrossCounts = field(default_factory=GrossCounts)
    _innovations: Innovations = field(init=False)
    _gate: LiveGate | None = None
    _clean: CleanBlocks = field(default_factory=CleanBlocks)
    _numbers: list[int | None] = field(default_factory=list)
    _numbered: int = 0
    _waiting: int = 0
    _timeline: Timeline = field(default_factory=Timeline)
    _skipped: float = 0.0
    _clock: float = 0.0
    _timed: bool = False
    _last_readings: np.ndarray | None = None
    _distinct: int = 0
    _copies: int = 0
    _blocks: int = 0

    def __post_init__(self) -> None:
        self.process = EProcess(unit_coordinates(self.monitor), self.false_alarm)
        self._innovations = Innovations(self.monitor.noise)

    def add(self, part: Recording, masked: Sequence[StuckRun] = ()) -> BlockReport:
        """Judge the records of a block; those without inputs or outside the points identified are counted only.
        masked: runs of readings of the file that were stuck by themselves."""
        monitor = self.monitor
        taken = select_inputs(monitor, part, widening=False)
        inputs, y, incomplete, outside = taken.inputs, taken.y, taken.incomplete, taken.outside
        time = part.columns.get("time_s")
        _, lags = self._timeline.advance(len(part), time, False)
        repeated = self._find_repeated(y) & ~incomplete & ~outside
        kept = np.flatnonzero(~incomplete & ~outside & ~repeated)
        failed, judged, lags = 0, 0, self._thin_lags(lags, kept)
        sensors = int(np.isfinite(y[kept]).any(axis=0).sum())
        clock = time if time is not None else self._clock + np.arange(len(part), dtype=float)
        self._clock, self._timed = self._clock + len(part), time is not None
        self._blocks += 1
        self._distinct += kept.size
        self._copies += int(repeated.sum())
        reason, gross = self._frozen_reason, GrossCounts()
        if kept.size:
            e, J, predicted, ok = self._residuals({c: v[kept] for c, v in inputs.items()}, y[kept])
            failed = int(np.sum(~ok))
            if self._gate is None:
                self._gate = LiveGate(monitor, [c for c in inputs if c in part])
            self._gate.masked = masked
            mine = {c: v[kept] for c, v in inputs.items()}
            new = LiveRecords(mine, y[kept], e, J, predicted, lags, clock[kept], part.line[kept])
            self._clean = self._gate.add(new)
            gross = self._clean.rejected[-1]
            judged, reason = self._judge(sensors, reason)
        return self._report(
            part.line,
            time,
            len(part),
            outside=int(outside.sum()),
            incomplete=int(incomplete.sum()),
            failed=failed,
            repeated=int(repeated.sum()),
            judged=judged,
            sensors=sensors,
            reason=reason,
            extrapolation=taken.count_extrapolation(slice(None)),
            gross=gross,
        )

    def _report(
        self, line: np.ndarray, time: np.ndarray | None, records: int, *, judged: int, sensors: int, **counts: Any
    ) -> BlockReport:
        """The row of a block on these lines (n,), at these times (n,) in s; counts: other fields of the row."""
        alarm = self.process.alarm_block is not None
        return BlockReport(
            self.key,
            self._blocks - 1,
            int(line[0]),
            int(line[-1]),
            *((float(time[0]), float(time[-1])) if time is not None else (float("nan"), float("nan"))),
            records=records,
            judged=judged,
            sensors=sensors,
            sensors_of=len(self.monitor.sensors),
            log10_e=self.process.log_e / float(np.log(10)),
            alarm=alarm,
            change=explain_change(self.process.pieces, self.process.coordinates) if alarm else None,
            instruments=self._clean.instruments,
            **counts,
        )

    @property
    def _frozen_reason(self) -> str:
        """Why nothing can be judged of a flight in which nothing has moved; "" where something has."""
        return NEVER_MOVED if self._distinct == 1 and self._copies else ""

    def finish(self) -> BlockReport | None:
        """The flight has ended: a row where it has so few records that they waited for more."""
        blocks = self._clean.open
        self.gross = sum(self._clean.rejected[len(self._clean.closed) :], self.gross)
        if not blocks or self._distinct >= FEWEST:
            return None
        self._update_evidence([], *self._compute_innovations(blocks, self._innovations))
        records = LiveRecords.join(blocks)
        self._blocks += 1
        sensors = int(np.isfinite(records.e).any(axis=0).sum())
        time = records.time if self._timed else None
        reason = self._frozen_reason or self._one_channel_reason
        return self._report(records.line, time, 0, judged=self._waiting, sensors=sensors, reason=reason)

    def _judge(self, sensors: int, reason: str) -> tuple[int, str]:
        """Take the new block, the last of those that are known, into the evidence, and the others as they look now; how
        many records were judged, and why the new block is no evidence."""
        clean, new, k = self._clean, self._clean.open[-1], len(self._clean.closed)
        self.gross = sum(clean.rejected[:k], self.gross)
        closed: list[Segment] = []
        if k:
            closed = self._segments(
                clean.closed, self._numbers[:k], *self._compute_innovations(clean.closed, self._innovations)
            )
        z, X = self._compute_innovations(clean.open, self._innovations.fork())
        fit = self._scatter(z[-len(new) :], X[-len(new) :], int(np.isfinite(new.e).sum()))
        if sensors < LEAST_SENSORS:
            reason = too_few_sensors_reason(sensors, new.e.shape[1])
        elif is_lifeless(fit):
            reason = low_scatter_reason(fit)
        self._numbers = [*self._numbers[k:], None if reason else self._numbered]
        self._numbered += not reason
        self._waiting += int(np.sum(np.isfinite(new.e).any(axis=1)))
        if self._distinct < FEWEST:
            return 0, reason
        self._update_evidence(closed, z, X)
        judged, self._waiting = self._waiting, 0
        return judged, reason or self._one_channel_reason

    def _compute_innovations(self, blocks: Sequence[LiveRecords], past: Innovations) -> tuple[np.ndarray, np.ndarray]:
        """z (n, m) of the records of blocks after the `past`, and X (n, m, d), how they depend on the coordinates."""
        records = LiveRecords.join(blocks)
        z, G = past.compute(records.e, records.J, records.lags)
        return z, G @ self.process.coordinates.basis

    def _segments(
        self, blocks: Sequence[LiveRecords], numbers: Sequence[int | None], z: np.ndarray, X: np.ndarray
    ) -> list[Segment]:
        """Sums of those blocks that have a number, for they are evidence."""
        found, stop = [], 0
        for block, number in zip(blocks, numbers, strict=True):
            rows = slice(stop, stop := stop + len(block))
            if number is not None:
                times = float(block.time[0]), float(np.mean(block.time))
                found.append(self.process.segment(number, X[rows], z[rows], *times))
        return found

    def _update_evidence(self, closed: Sequence[Segment], z: np.ndarray, X: np.ndarray) -> None:
        """The evidence with z (n, m) and X (n, m, d) of the open blocks."""
        blocks, numbers = self._clean.open, self._numbers

        def disturbed() -> Iterator[tuple[str, list[Segment]]]:
            for channel, V in self._disturbances():
                t = np.sum(V * z, axis=1)
                h = np.einsum("km,kmd->kd", V, X)
                yield channel, self._segments(blocks, numbers, z - V * t[:, None], X - V[:, :, None] * h[:, None])

        self.process.add(closed, self._segments(blocks, numbers, z, X), disturbed)

    @property
    def _one_channel_reason(self) -> str:
        """Why there is no alarm yet where one channel alone speaks for a change; "" elsewhere."""
        return one_channel_reason(self.process.decisive_cause) if self.process.decisive_cause else ""

    def _disturbances(self) -> Iterator[tuple[str, np.ndarray]]:
        """Each channel, a sensor's or a recorded input's, and in which direction V (n, m), unit or zero, it would move
        the innovations of the open blocks where it may have been wrong for so short a time as a gross error is."""
        records, monitor = LiveRecords.join(self._clean.open), self.monitor
        n, m = records.e.shape
        sigma = monitor.noise.sigma
        inputs = self._gate.recorded if self._gate else ()
        effects = np.concatenate(
            [np.broadcast_to(np.eye(m), (n, m, m)), input_effects(monitor, records.inputs, np.arange(n), inputs)],
            axis=2,
        )
        S = np.where(np.isfinite(records.e)[:, :, None], np.nan_to_num(effects), 0.0)
        _, moved = Innovations(monitor.noise).compute(records.e, S * sigma[:, None], records.lags)
        t = np.einsum("km,kmc->kc", np.nan_to_num(records.e / sigma), _unit(S))
        clock = np.cumsum(np.where(np.isfinite(records.lags), records.lags, UNRELATED))
        time = records.time if self._timed else np.full(n, np.nan)
        brief = find_brief_departures(np.where(S.any(axis=1), t, np.nan), time, clock)
        directions = _unit(moved) * brief[:, None]
        for c, channel in enumerate((*monitor.sensors, *inputs)):
            yield channel, directions[:, :, c]

    def _find_repeated(self, y: np.ndarray) -> np.ndarray:
        """Mask (N,) of the records whose readings y (N, m) are those of the record before, all of them."""
        before = np.full((1, y.shape[1]), np.nan) if self._last_readings is None else self._last_readings
        if len(y):
            self._last_readings = y[-1:]
        above = np.concatenate([before, y[:-1]])
        return np.all((y == above) | (np.isnan(y) & np.isnan(above)), axis=1) & np.isfinite(y).any(axis=1)

    def _scatter(self, z: np.ndarray, X: np.ndarray, readings: int) -> LackOfFit:
        """What no change explains of the innovations z (n, m) of a block, of so many readings; X (n, m, d)."""
        columns = X.reshape(-1, X.shape[2])
        _, _, rank, _ = found = np.linalg.lstsq(columns, z.ravel(), rcond=None)
        rest, dof = float(np.sum((z.ravel() - columns @ found[0]) ** 2)), readings - int(rank)
        if dof <= 0:
            return LackOfFit(rest, dof, float("nan"), float("nan"))
        return LackOfFit(rest, dof, float(chdtrc(dof, rest)), rest / dof)

    def _thin_lags(self, lags: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Lags between the records that are judged: those skipped lengthen the lag of the next one."""
        elapsed = np.cumsum(np.where(np.isfinite(lags), lags, 1e9))
        total = float(elapsed[-1]) if len(elapsed) else 0.0
        if not kept.size:
            self._skipped += total
            return lags[:0]
        found = np.diff(elapsed[kept], prepend=-self._skipped)
        self._skipped = total - float(elapsed[kept[-1]])
        return found

    def _residuals(
        self, inputs: dict[str, np.ndarray], y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """e (n, m) about nominal, J (n, m, p + m) with a column per sensor bias, predicted (n, m), ok (n,).

        Up to an alarm the model is linearised at nominal, as the bound on false alarms wants; after it, at the
        change estimated so far, and carried back: e = y − Φ(θ̂) + J(θ̂)(θ̂ − θ0).
        """
        monitor = self.monitor
        shift = self._estimate()
        predicted, J, ok, _ = monitor.predict(inputs, np.clip(monitor.theta0 + shift, monitor.lower, monitor.upper))
        e = np.where(ok[:, None], y - predicted + J @ shift, np.nan)
        bias = np.broadcast_to(np.eye(y.shape[1]), (*y.shape, y.shape[1]))
        return e, np.concatenate([J, bias], axis=2), np.where(ok[:, None], predicted, 0.0), ok

    def _estimate(self) -> np.ndarray:
        """Change (p,) of the health parameters at which the next block is linearised; zero without an alarm."""
        shift = np.zeros(len(self.monitor.names))
        if self.process.alarm_block is None:
            return shift
        a = len(self.monitor.monitored)
        shift[:a] = posterior_change(self.process.pieces, self.process.coordinates) * self.monitor.prior_sigma[:a]
        return np.clip(self.monitor.theta0 + shift, self.monitor.lower, self.monitor.upper) - self.monitor.theta0


BLOCK = 20
"""Records of a block where nobody says: an alarm is at most so many records late, and a row is informative."""
OPEN_FLIGHTS = 16
"""Flights that may be open at once; the one that has been silent longest is closed for the next."""


@dataclass
class FlightFollower:
    """The recordings of an intake followed in blocks.

    Attributes
    ----------
    intake : RecordingLoader
        Recordings; a file that does not grow for `idle_s` seconds has ended.
    monitor : Monitor
        The engine and its nominal state.
    false_alarm : float
        Probability of an alarm in the whole of a healthy flight.
    block : int
        Most records of a block.
    idle_s : float
        Seconds.
    counts : Counter of str
        Records that were not judged, by reason.
    extrapolation : Counter of Extrapolation
        Records outside the identified envelope.
    """

    intake: RecordingLoader
    monitor: Monitor
    false_alarm: float
    block: int = BLOCK
    idle_s: float = 60.0
    counts: Counter[str] = field(default_factory=Counter)
    extrapolation: Counter[Extrapolation] = field(default_factory=Counter)

    def reports(self) -> Iterator[BlockReport]:
        """One report per block of each flight, as soon as its records are there."""
        flights: dict[Key, FlightMonitor] = {}
        for chunk in follow_chunks(self.intake, self.block, self.idle_s):
            for key, rows in group_rows(chunk):
                flight = flights.pop(key, None) or FlightMonitor(self.monitor, key, self.false_alarm)
                flights[key] = flight  # the latest is the last
                while len(flights) > OPEN_FLIGHTS:
                    yield from self._finish_flight(flights.pop(next(iter(flights))))
                report = flight.add(chunk.select(rows), self._excluded_data(key).stuck)
                self.counts.update(
                    outside=report.outside,
                    incomplete=report.incomplete,
                    failed=report.failed,
                    repeating=report.repeated,
                )
                self.extrapolation.update(report.extrapolation)
                yield report
        for flight in flights.values():
            yield from self._finish_flight(flight)

    def _excluded_data(self, key: Key) -> ExcludedData:
        """Data excluded from the file of a flight."""
        of_file = [left for left in self.intake.excluded if left.file == key[0]]
        return (of_file or self.intake.excluded)[-1]

    def _finish_flight(self, flight: FlightMonitor) -> Iterator[BlockReport]:
        """The end of a flight. What was rejected is counted where it is reported: files come in turn, each with one
        engine."""
        report = flight.finish()
        left = self._excluded_data(flight.key)
        left.gross = left.gross + flight.gross
        if report is not None:
            yield report
