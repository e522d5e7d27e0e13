"""A flight monitored while it is recorded: for each block of records the evidence of a change, its kind and its onset.

Evidence. A record whose readings repeat those before to the last digit brings no new noise, and
readings that scatter impossibly little were not measured. One sensor alone is no evidence either. Gross errors are
rejected, which bounds what a reading adds to the evidence, and keeps the mean of E at most 1: a Gaussian reading cut at
±c is sub-Gaussian. What has not yet lasted longer than a gross error may be one or may be a change: there is an alarm
only if E reaches ρ/α without the brief departures of any one channel, too, a sensor's or an input's. What several
channels show at once is seen as soon as ever; what one alone shows, when it has lasted.

Kind and onset. The flight so far is a history as that of an engine over flights, with an epoch for each piece, and is
judged by the same model (`judge_history`): what changed, how it goes in time, since when.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from enginediag_cli.detection.sequential import ChangeEquations, Coordinates, EProcess, Innovations, Segment
from enginediag_cli.detection.verdict import (
    LEAST_SENSORS,
    LackOfFit,
    is_lifeless,
    low_scatter_reason,
    one_channel_reason,
    too_few_sensors_reason,
)
from enginediag_cli.history.background import LEAST_INFORMATION, History, inner
from enginediag_cli.history.engines import CANNOT_TELL, EPOCHS, UNLIKELY, EngineTrend
from enginediag_cli.history.hypotheses import SLAB_WEIGHTS, SLABS, UNLISTED, list_suspects, size_posterior
from enginediag_cli.history.posterior import FEWEST_FLIGHTS, judge_history
from enginediag_cli.identification.gross_errors import FEWEST, UNRELATED, find_brief_departures
from enginediag_cli.intake.loader import ExcludedData, GrossCounts, RecordingLoader, follow_chunks
from enginediag_cli.parameters import Parameter
from enginediag_cli.probability import chdtrc, log_sum
from enginediag_cli.recordings.repeated import StuckRun
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.gross_gate import CleanBlocks, LiveGate, LiveRecords, input_effects
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.windows import Extrapolation, Key, Timeline, group_rows, select_inputs
from enginediag_cli.units import split_column

SURE = 0.9
"""Probability from which a kind of change is named."""
EACH_BLOCK, GROWTH = 8, 0.125
"""Blocks after an alarm of which each is explained anew, and the share by which a flight must have grown since then:
an explanation takes about a second, and one more block of a hundred changes little in it."""


@dataclass(frozen=True)
class DetectedChange:
    """What happened in a flight, at its most probable.

    kind: as `trend` has it (step, deterioration, comes and goes, intermittent, from start, irregular), or `cannot
    tell`; probability: of the likeliest kind, which `leading` names, None where no event is likelier than not;
    parameter: that which changed most probably; rivals: other suspects of the same change with their probabilities;
    onset_s, low_s, high_s: most probable onset and its 95 % interval as times."""

    kind: str = CANNOT_TELL
    leading: str | None = None
    probability: float | None = None
    parameter: str | None = None
    rivals: Mapping[str, float] = field(default_factory=dict)
    onset_s: float | None = None
    low_s: float | None = None
    high_s: float | None = None


@dataclass(frozen=True)
class FlightStory:
    """The account of a flight so far. trend: of its T epochs; begin (T + 1,): when these begin and the last ends."""

    trend: EngineTrend
    begin: tuple[float, ...]

    @staticmethod
    def from_pieces(pieces: Sequence[Segment], coordinates: Coordinates) -> FlightStory | None:
        """None of fewer pieces than a history needs epochs."""
        epochs = join_epochs(pieces)
        if len(epochs) < FEWEST_FLIGHTS:
            return None
        posterior = judge_history(flight_history(epochs, coordinates))
        records = np.cumsum([0, *(piece.records for piece in epochs)])
        last = 2 * epochs[-1].clock - epochs[-1].begin
        begin = (*(piece.begin for piece in epochs), max(last, epochs[-1].begin))
        return FlightStory(EngineTrend(posterior, tuple(map(int, records[:-1])), int(records[-1])), begin)

    def health_change(self, count: int) -> np.ndarray:
        """Change (count,) of the first parameters at the end of the flight so far, in their units."""
        return self.trend.posterior.level[-1, :count]

    def summarise(self) -> DetectedChange:
        """The most probable event."""
        event = next(iter(self.trend.posterior.events), None)
        if event is None:
            inclusion = self.trend.posterior.inclusion
            return DetectedChange(rivals={name: p for name, p in inclusion.items() if p >= UNLIKELY})
        families = self.trend.families(event)
        leading = max(families, key=lambda name: families[name])
        probability = event.probability * families[leading]
        owner = event.group[0]
        part = max(event.changes, key=lambda change: change.probability, default=None)
        # an epoch begins where it begins: a change may have come late in that before, or anywhere in its own
        first, last = event.onset_set[0], event.onset_set[-1]
        return DetectedChange(
            leading if probability >= SURE else CANNOT_TELL,
            leading,
            probability,
            part.name if part is not None and owner != UNLISTED else owner,
            {name: event.probability * p for name, p in event.suspects.items() if name != owner and p >= UNLIKELY},
            self.begin[event.onset],
            self.begin[max(first - 1, 0)],
            self.begin[last + 1],
        )


def join_epochs(pieces: Sequence[Segment]) -> list[Segment]:
    """Pieces that follow each other as epochs of about as many records each, `EPOCHS` at most."""
    if not pieces:
        return []
    longest = max(piece.records for piece in pieces)
    span = max(longest, -(-(pieces[-1].first + pieces[-1].records) // EPOCHS))
    epochs: dict[int, Segment] = {}
    for piece in pieces:
        k = piece.first // span
        epochs[k] = epochs[k] + piece if k in epochs else piece
    return list(epochs.values())


def flight_history(epochs: Sequence[Segment], coordinates: Coordinates) -> History:
    """The history of a flight, an epoch as a flight of an engine."""
    k, width = coordinates.nuisance, coordinates.basis.shape[1]
    order = np.r_[k:width, :k]
    score = np.stack([epoch.s[order] for epoch in epochs])
    information = np.stack([epoch.F[np.ix_(order, order)] for epoch in epochs])
    return History(coordinates.described, coordinates.unit, score, information)


class StepEvidence:
    """Marginal likelihood of a step, by the suspects and sizes of the model of change. Signs of wear count where a
    suspect has one: the orthant of a plane is no product of its sides, and E is to have mean 1 exactly."""

    def __init__(self, described: Sequence[Parameter]):
        suspects = list_suspects(described)
        self.suspects = [s if sum(map(abs, s.wear)) <= 1 else replace(s, wear=(0,) * len(s.wear)) for s in suspects]
        log = np.array([s.log_prior for s in suspects])
        self.log_prior = log - np.logaddexp.reduce(log)

    def __call__(self, found: ChangeEquations) -> np.ndarray:
        """log (J,) of the mean likelihood ratio of each onset."""
        parts = []
        for suspect, log_prior in zip(self.suspects, self.log_prior, strict=True):
            own = np.array(suspect.positions)
            sizes = size_posterior(found.r[:, own], found.S[:, own[:, None], own], suspect)
            parts.append(log_prior + log_sum(sizes.log, 1))
        return log_sum(np.array(parts), 0)

    def mean_overshoot(self, information: np.ndarray) -> float:
        """ρ by the information (n, c, c) that n records, one by one, have on the changes."""
        rng, total = np.random.default_rng(0), 0.0
        for suspect, log_prior in zip(self.suspects, self.log_prior, strict=True):
            own = np.array(suspect.positions)
            change = rng.standard_normal((DRAWS, len(own)))
            f = np.einsum("di,nij,dj->dn", change, information[:, own[:, None], own], change)
            x = np.multiply.outer(SLABS, np.sqrt(np.maximum(f, 0.0)))
            total += float(np.exp(log_prior) * (SLAB_WEIGHTS @ overshoot_factor(x).mean(axis=(1, 2))))
        return total


DRAWS = 200
"""Changes of each suspect over which the overshoot is averaged: to a hundredth, of a number that is a third or so."""


def overshoot_factor(x: np.ndarray) -> np.ndarray:
    """ν(x): mean of limit over likelihood ratio where that passes the limit, of records that are x ≥ 0 standard
    deviations apart under both hypotheses; to a hundredth.

    References
    ----------
    D. Siegmund and B. Yakir (2007) The Statistics of Gene Mapping, Springer, chapter 5.
    """
    h = np.maximum(x / 2, TINY)
    return np.asarray((ndtr(h) - 0.5) / (h * (h * ndtr(h) + np.exp(-(h**2) / 2) / np.sqrt(2 * np.pi))))


TINY = 1e-6
"""Keeps a division by nothing from failing."""
JUMP_SIGMAS = 5.0
"""Size of a plausible jump of a sensor, in its noise, where the engine file has no prior for its bias."""
SCATTER = 20
"""Records by the scatter of which those are judged that may not have been measured."""
NEGLIGIBLE = 1e-6
"""Variances of nuisance combinations below this share of the largest are dropped; they are in prior units."""
LONG_FLIGHT, POINTS = 10_000, 50
"""Records of a long flight, over which what is uncertain about nominal must show to matter; and operating points by
which that is judged, fewer of which do not show what matters at others."""
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
    root = _visible_columns(monitor, D[:, None] * vectors[:, kept] * np.sqrt(eigenvalues[kept]))
    k = root.shape[1]
    basis = np.zeros((p + m, k + a + m))
    basis[:p, :k] = root
    basis[range(a), range(k, k + a)] = D[:a]
    jumps = tuple(_sensor_jump(monitor, j) for j in range(m))
    basis[range(p, p + m), range(k + a, k + a + m)] = [jump.prior_sigma for jump in jumps]
    health = tuple(monitor.meaning[name] for name in monitor.monitored)
    return Coordinates(basis, k, health, jumps, np.array([*D[:a], *(jump.prior_sigma for jump in jumps)]))


def _visible_columns(monitor: Monitor, root: np.ndarray) -> np.ndarray:
    """Combinations (p, k) of the columns of root (p, q), which turn unit normals into what is uncertain about nominal,
    without those that a long flight over the points identified does not show."""
    points = np.empty((0, 0)) if monitor.envelope is None else monitor.envelope.points
    if len(points) < POINTS:
        return root
    inputs = {c: points[:, i] for i, c in enumerate(monitor.envelope.inputs)}
    _, J, ok, _ = monitor.predict(inputs, monitor.theta0)
    moved = (J[ok] / monitor.noise.sigma[:, None]) @ root
    value, vector = np.linalg.eigh(inner(moved, moved) * LONG_FLIGHT / max(len(moved), 1))
    return np.asarray(root @ vector[:, value > LEAST_INFORMATION])


def change_information(monitor: Monitor, coordinates: Coordinates) -> np.ndarray | None:
    """Information (n, c, c) of single records on the changes, at points identified; None where these are unknown. Of
    noise that is correlated, what a record adds while a change lasts."""
    points = np.empty((0, 0)) if monitor.envelope is None else monitor.envelope.points
    if len(points) < POINTS:
        return None
    at = np.unique(np.linspace(0, len(points) - 1, POINTS).astype(int))
    inputs = {c: points[at, i] for i, c in enumerate(monitor.envelope.inputs)}
    _, J, ok, _ = monitor.predict(inputs, monitor.theta0)
    noise, a, p = monitor.noise, len(coordinates.health), J.shape[2]
    k = coordinates.nuisance
    scale = np.sqrt((1 - noise.rho) / (1 + noise.rho)) / noise.sigma
    jumps = np.broadcast_to(np.diag(coordinates.unit[a:]), (int(ok.sum()), J.shape[1], J.shape[1]))
    G = np.concatenate([J[ok] @ coordinates.basis[:p, k : k + a], jumps], axis=2) * scale[:, None]
    return np.asarray(G.transpose(0, 2, 1) @ G)


def _sensor_jump(monitor: Monitor, j: int) -> Parameter:
    """The bias of a sensor, which an engine file may not have."""
    name, unit = split_column(monitor.sensors[j])
    sigma = float(monitor.noise.sigma[j])
    known = monitor.engine.parameters.get(f"sensor.{name}.bias")
    if known is not None and known.belongs_to_sensor and known.prior_sigma > 0:
        return replace(known, prior_sigma=max(known.prior_sigma, sigma))
    part = f"{name} sensor"
    return Parameter(
        f"sensor.{name}.bias",
        "sensor",
        0.0,
        -np.inf,
        np.inf,
        JUMP_SIGMAS * sigma,
        unit,
        component=f"sensor.{name}",
        quantity="bias",
        words=f"{part} bias",
        part=part,
    )


def mean_overshoot(monitor: Monitor, coordinates: Coordinates) -> float:
    """ρ of the changes that are looked for at the points identified; 1, its bound, where these are unknown."""
    information = change_information(monitor, coordinates)
    return 1.0 if information is None else StepEvidence(coordinates.described).mean_overshoot(information)


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
        Whether E has reached ρ/α, in this block or before.
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
    coordinates: Coordinates | None = None
    overshoot: float | None = None
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
    _story: FlightStory | None = None
    _explained: int = 0

    def __post_init__(self) -> None:
        coordinates, overshoot = self.coordinates or unit_coordinates(self.monitor), self.overshoot
        if overshoot is None:
            overshoot = mean_overshoot(self.monitor, coordinates)
        self.process = EProcess(coordinates, StepEvidence(coordinates.described), self.false_alarm, overshoot)
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
            change=self._explain() if alarm else None,
            instruments=self._clean.instruments,
            **counts,
        )

    def _explain(self) -> DetectedChange:
        """What happened, explained again where the flight has grown enough since the last time."""
        blocks, since = self._blocks, self._explained
        if not since or blocks - (self.process.alarm_block or 0) <= EACH_BLOCK or blocks >= (1 + GROWTH) * since:
            self._story = FlightStory.from_pieces(self.process.pieces, self.process.coordinates)
            self._explained = blocks
        return self._story.summarise() if self._story is not None else DetectedChange()

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
        recent = max(len(new), SCATTER)
        readings = np.isfinite(np.concatenate([block.e for block in clean.open])[-recent:])
        fit = self._scatter(z[-recent:], X[-recent:], int(readings.sum()))
        if sensors < LEAST_SENSORS:
            reason = too_few_sensors_reason(sensors, new.e.shape[1])
        elif is_lifeless(fit):
            reason = low_scatter_reason(fit)
        self._numbers = [*self._numbers[k:], None if reason else self._numbered]
        self._numbered += 0 if reason else len(new)
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
        if self._story is None:
            return shift
        a = len(self.monitor.monitored)
        shift[:a] = self._story.health_change(a)
        return np.clip(self.monitor.theta0 + shift, self.monitor.lower, self.monitor.upper) - self.monitor.theta0


BLOCK = 5
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
        coordinates = unit_coordinates(self.monitor)
        fixed = coordinates, mean_overshoot(self.monitor, coordinates)
        for chunk in follow_chunks(self.intake, self.block, self.idle_s):
            for key, rows in group_rows(chunk):
                flight = flights.pop(key, None) or FlightMonitor(self.monitor, key, self.false_alarm, *fixed)
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
