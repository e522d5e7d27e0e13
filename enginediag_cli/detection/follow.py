"""One engine's flight followed block by block: readings in, a row of evidence out.

What has no life is no evidence: a record whose readings repeat those before to the last digit brings no new noise, and
readings that scatter impossibly little were not measured. Nor does one sensor alone tell anything. Gross errors are
rejected before they count, which bounds what a reading adds to the evidence, and keeps the mean of E at most 1: a
Gaussian reading cut at ±c is sub-Gaussian.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.detection.change import Change, explain_change, posterior_change
from enginediag_cli.detection.lack_of_fit import LackOfFit
from enginediag_cli.detection.segments import Coordinates
from enginediag_cli.detection.sequential import EProcess
from enginediag_cli.detection.verdict import LEAST_SENSORS, lifeless, too_few, too_still
from enginediag_cli.intake.left_out import GrossCounts
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.admission import Elsewhere, judged_inputs
from enginediag_cli.residuals.distributions import chdtrc
from enginediag_cli.residuals.gross_gate import LiveGate, LiveRecords
from enginediag_cli.residuals.groups import Key, Timeline
from enginediag_cli.residuals.innovations import Innovations
from enginediag_cli.residuals.monitor import Monitor

JUMP_SIGMAS = 5.0
"""Size of a plausible jump of a sensor, in its noise, where the engine file has no prior for its bias."""
NEGLIGIBLE = 1e-6
"""Variances of nuisance combinations below this share of the largest are dropped; they are in prior units."""
NEVER_MOVED = "no reading has moved since the flight began"
"""Why a block tells nothing where a recorder stands still from the start: its one reading may be an old one."""


def coordinates_of(monitor: Monitor) -> Coordinates:
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
    bias = monitor.engine.parameters.get(f"sensor.{column.rsplit('_', 1)[0]}.bias")
    sigma = float(monitor.noise.sigma[j])
    return max(bias.prior_sigma, sigma) if bias is not None and bias.prior_sigma > 0 else JUMP_SIGMAS * sigma


@dataclass(frozen=True)
class BlockReport:
    """One block of a flight; one of no records judges those that waited for what followed.

    repeated: records whose readings are those of the record before, not judged; sensors: how
    many of `sensors_of` gave a reading that was judged; log10_e: evidence that something has changed, as a power of
    ten; alarm: E has reached 1/α, in this block or before; change: what it looks like, once there is an alarm; reason:
    why the block tells nothing, "" where it does; elsewhere: how many records training did not cover, by where they
    lie."""

    key: Key
    block: int
    first_line: int
    last_line: int
    start_s: float
    end_s: float
    records: int
    outside: int
    incomplete: int
    failed: int
    repeated: int
    judged: int
    sensors: int
    sensors_of: int
    log10_e: float
    alarm: bool
    change: Change | None
    reason: str = ""
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)
    gross: GrossCounts = field(default_factory=GrossCounts)


@dataclass
class FlightMonitor:
    """Follows one flight of one engine; `add` takes the records of the next block."""

    monitor: Monitor
    key: Key
    false_alarm: float
    process: EProcess = field(init=False)
    _innovations: Innovations = field(init=False)
    _gate: LiveGate | None = None
    _timeline: Timeline = field(default_factory=Timeline)
    _skipped: float = 0.0
    _clock: float = 0.0
    _timed: bool = False
    _before: np.ndarray | None = None
    _distinct: int = 0
    _copies: int = 0
    _blocks: int = 0

    def __post_init__(self) -> None:
        self.process = EProcess(coordinates_of(self.monitor), self.false_alarm)
        self._innovations = Innovations(self.monitor.noise)

    def add(self, part: Recording) -> BlockReport:
        """Judge the records of a block; those without inputs or outside the points identified are counted only."""
        monitor = self.monitor
        taken = judged_inputs(monitor, part, widening=False)
        inputs, y, incomplete, outside = taken.inputs, taken.y, taken.incomplete, taken.outside
        time = part.columns.get("time_s")
        _, lags = self._timeline.advance(len(part), time, False)
        repeated = self._repeated(y) & ~incomplete & ~outside
        kept = np.flatnonzero(~incomplete & ~outside & ~repeated)
        failed, judged, lags = 0, 0, self._thinned(lags, kept)
        sensors, sensors_of = int(np.isfinite(y[kept]).any(axis=0).sum()), y.shape[1]
        clock = time if time is not None else self._clock + np.arange(len(part), dtype=float)
        self._clock, self._timed = self._clock + len(part), time is not None
        self._blocks += 1
        self._distinct += kept.size
        self._copies += int(repeated.sum())
        reason = self._still
        gross = GrossCounts()
        if kept.size:
            e, J, predicted, ok = self._residuals({c: v[kept] for c, v in inputs.items()}, y[kept])
            failed = int(np.sum(~ok))
            if self._gate is None:
                self._gate = LiveGate(monitor, [c for c in inputs if c in part])
            new = LiveRecords(
                {c: v[kept] for c, v in inputs.items()}, e, J, predicted, lags, clock[kept], part.line[kept]
            )
            decided, gross = self._gate.add(new)
            judged, reason = self._judge(decided, sensors, reason)
        alarm = self.process.alarm_block is not None
        change = explain_change(self.process.past, self.process.coordinates) if alarm else None
        return BlockReport(
            self.key,
            self._blocks - 1,
            int(part.line[0]),
            int(part.line[-1]),
            float(time[0]) if time is not None else float("nan"),
            float(time[-1]) if time is not None else float("nan"),
            len(part),
            int(outside.sum()),
            int(incomplete.sum()),
            failed,
            int(repeated.sum()),
            judged,
            sensors,
            sensors_of,
            self.process.log_e / float(np.log(10)),
            alarm,
            change,
            reason,
            taken.elsewhere(slice(None)),
            gross,
        )

    @property
    def _still(self) -> str:
        """Why nothing can be judged of a flight in which nothing has moved; "" where something has."""
        return NEVER_MOVED if self._distinct == 1 and self._copies else ""

    def finish(self) -> BlockReport | None:
        """Judge the records that still waited for what follows them, if any; the flight has ended."""
        found = self._gate.finish() if self._gate is not None else None
        if found is None:
            return None
        decided, gross = found
        self._blocks += 1
        sensors = int(np.isfinite(decided.e).any(axis=0).sum())
        judged, reason = self._judge(decided, sensors, self._still)
        alarm = self.process.alarm_block is not None
        return BlockReport(
            self.key,
            self._blocks - 1,
            int(decided.line[0]),
            int(decided.line[-1]),
            *((float(decided.time[0]), float(decided.time[-1])) if self._timed else (float("nan"), float("nan"))),
            records=0,
            outside=0,
            incomplete=0,
            failed=0,
            repeated=0,
            judged=judged,
            sensors=sensors,
            sensors_of=decided.e.shape[1],
            log10_e=self.process.log_e / float(np.log(10)),
            alarm=alarm,
            change=explain_change(self.process.past, self.process.coordinates) if alarm else None,
            reason=reason,
            gross=gross,
        )

    def _judge(self, decided: LiveRecords, sensors: int, reason: str) -> tuple[int, str]:
        """Add decided records to the evidence; how many were judged, and why none of them says anything."""
        judged = int(np.sum(np.isfinite(decided.e).any(axis=1)))
        z, G = self._innovations.of(decided.e, decided.J, decided.lags)
        fit = self._scatter(z, G, int(np.isfinite(decided.e).sum()))
        if sensors < LEAST_SENSORS:
            return judged, too_few(sensors, decided.e.shape[1])
        if lifeless(fit):
            return judged, too_still(fit)
        if judged and not reason:
            self.process.add(z, G, float(decided.time[0]), float(np.mean(decided.time)))
        return judged, reason

    def _repeated(self, y: np.ndarray) -> np.ndarray:
        """Mask (N,) of the records whose readings y (N, m) are those of the record before, all of them."""
        before = np.full((1, y.shape[1]), np.nan) if self._before is None else self._before
        if len(y):
            self._before = y[-1:]
        above = np.concatenate([before, y[:-1]])
        return np.all((y == above) | (np.isnan(y) & np.isnan(above)), axis=1) & np.isfinite(y).any(axis=1)

    def _scatter(self, z: np.ndarray, G: np.ndarray, readings: int) -> LackOfFit:
        """What no change explains of the innovations z (n, m) of a block, of so many readings."""
        columns = G.reshape(-1, G.shape[2]) @ self.process.coordinates.basis
        _, _, rank, _ = found = np.linalg.lstsq(columns, z.ravel(), rcond=None)
        rest, dof = float(np.sum((z.ravel() - columns @ found[0]) ** 2)), readings - int(rank)
        if dof <= 0:
            return LackOfFit(rest, dof, float("nan"), float("nan"))
        return LackOfFit(rest, dof, float(chdtrc(dof, rest)), rest / dof)

    def _thinned(self, lags: np.ndarray, kept: np.ndarray) -> np.ndarray:
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
        shift[:a] = posterior_change(self.process.past, self.process.coordinates) * self.monitor.prior_sigma[:a]
        return np.clip(self.monitor.theta0 + shift, self.monitor.lower, self.monitor.upper) - self.monitor.theta0
