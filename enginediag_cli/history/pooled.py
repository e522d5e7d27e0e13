"""The last flights of each engine, judged as one window.

What each flight's instruments are off by is learnt from all flights of the engine, as its history learns it, and
marginalised flight by flight; what is uncertain about nominal is one draw for all flights, and marginalised in the sum:

    s̃_t ~ N(F̃_t (Δθ, ν), F̃_t),   offsets b_t ~ N(0, Q) counted as noise        s = Σ s̃_t,   F = Σ F̃_t

The change that such a window speaks of is the mean over its flights. Whether they agree is tested by

    Q = Σ_t s̃_tᵀ F̃_t⁻¹ s̃_t − sᵀ F⁻¹ s ~ χ²((n − 1) r)

over the r directions of the parameters that a flight on the average determines better than the prior does. Flights that
differ by little more than they should widen the answer by that much, s/k and F/k with k = Q/((n − 1) r); those that
differ by more have no answer in common.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.stats import chi2

from enginediag_cli.detection.series import FEWEST
from enginediag_cli.errors import DataError
from enginediag_cli.history.background import OffsetModel, learn_offsets
from enginediag_cli.history.engines import EngineSums
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.files import Window, WindowReader
from enginediag_cli.residuals.score import fisher_score, marginalise, marginalise_nuisance
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics, join_bookkeeping

DIFFER = 1e-3
"""Probability of flights that agree to differ so much that they count as changing: one engine in a thousand."""
FARTHEST = 2.0
"""Times the spread that they should have up to which flights have an answer in common, with wider intervals: what
changed among them is then no larger than what a single flight leaves open."""


@dataclass(frozen=True)
class FlightAgreement:
    """Of an engine whose flights were pooled: how many they are of how many, the first and the last; p: probability of
    flights that agree to differ so much, 1 of a single one; ratio: how much they differ, 1 where by as much as they
    should; learnt: whether offsets were learnt from the flights."""

    engine: str
    flights: int
    of: int
    first: str
    last: str
    p: float
    ratio: float
    learnt: bool

    @property
    def agree(self) -> bool:
        return self.p > DIFFER

    @property
    def widening(self) -> float:
        """Factor on the variance of the common answer, infinite where there is none."""
        return 1.0 if self.agree else self.ratio if self.ratio <= FARTHEST else float("inf")


@dataclass
class PooledWindows(WindowReader):
    """A reader whose windows are the last `pooled` flights of each engine, as one; agreement: engine → how they agree,
    as soon as its window is there."""

    pooled: int = 0
    agreement: dict[str, FlightAgreement] = field(default_factory=dict)

    @staticmethod
    def from_reader(files: WindowReader, pooled: int) -> PooledWindows:
        """The reader of the same files, each flight of which is a window that adds to others."""
        given = {f.name: getattr(files, f.name) for f in fields(WindowReader) if f.init}
        return PooledWindows(**{**given, "additive": True, "series": True}, pooled=pooled)

    def windows(self) -> Iterator[Window]:
        """One window for each engine, in the order in which these appear. Raises DataError, NoVerdictError."""
        kept: dict[str, deque[WindowStatistics]] = {}
        sums: dict[str, EngineSums] = {}
        unread: dict[str, Window] = {}
        known: dict[str, Parameter] = {}
        for window, meaning in super().windows():
            if window.statistics is None:
                unread[window.engine] = window, meaning
                continue
            if not window.statistics.additive:
                raise DataError(
                    f"{window.source}: flights whose statistics hold nothing of what is uncertain about nominal cannot "
                    "be pooled: give the recordings, or make the statistics anew without --reference"
                )
            known.update(meaning)
            first = window.statistics
            mine = sums.setdefault(window.engine, EngineSums(replace(first, rows=None, kurtosis=None, by_sensor=None)))
            try:
                mine.add(mine.flights, first)
            except ValueError as error:
                raise DataError(f"{window.source}: {error}") from None
            kept.setdefault(window.engine, deque(maxlen=self.pooled)).append(window)
        for engine, windows in kept.items():
            yield self._pool(engine, tuple(windows), sums[engine], known), known
        yield from (found for engine, found in unread.items() if engine not in kept)

    def _pool(
        self, engine: str, windows: Sequence[WindowStatistics], sums: EngineSums, known: Mapping[str, Parameter]
    ) -> WindowStatistics:
        history, _ = sums.history(known)
        # the flights of a joined epoch share theirs: a long history shows the offsets of its epochs alone
        offsets = learn_offsets(history) if FEWEST <= len(history) == sums.flights else None
        own = dict(zip((p.name for p in history.parameters), offsets.variance, strict=True)) if offsets else {}
        parts = [_marginalise_offsets(w.statistics, own, offsets) for w in windows if w.statistics is not None]
        total = parts[0]
        for part in parts[1:]:
            total = total + part
        first, last = windows[0], windows[-1]
        p, ratio = agreement(parts)
        found = FlightAgreement(
            engine, len(windows), sums.flights, first.flight, last.flight, p, ratio, offsets is not None
        )
        self.agreement[engine] = found
        common = None
        reason = "the flights differ from each other by too much for one answer: run trend, or pool fewer flights"
        if np.isfinite(found.widening):
            whole = _widen(total, found.widening)
            common = replace(marginalise_nuisance(replace(whole, additive=True, own=())), meaning=known)
            reason = ""
        silent = set.intersection(*(set(w.silent) for w in windows))
        return replace(
            join_bookkeeping(windows),
            source=first.source if first.source == last.source else f"{first.source} to {last.source}",
            flight=first.flight if len(windows) == 1 else f"{first.flight} to {last.flight}",
            statistics=common,
            reason=reason,
            silent=tuple(name for name in first.silent if name in silent),
            sensors=max(w.sensors for w in windows),
            conditions=_mean([w.conditions for w in windows]),
            readings=_mean([w.readings for w in windows]),
            checked=all(w.checked for w in windows),
            disagreement=next((w.disagreement for w in windows if w.disagreement is not None), None),
        )


def _marginalise_offsets(
    statistics: LocalStatistics | None, own: Mapping[str, float], offsets: OffsetModel | None
) -> LocalStatistics:
    """One flight with what its instruments are off by counted as noise: of the variance `own`, in squared prior
    standard deviations by parameter, as learnt, or of the size that identification found."""
    assert statistics is not None
    nuisance = set(statistics.own)
    keep = tuple(name for name in statistics.parameters if name not in nuisance)
    if offsets is None:
        variance = np.array([float(name in nuisance) for name in statistics.parameters])
        return marginalise(statistics, keep, np.diag(variance * statistics.prior_sigma**2))
    plain = statistics.drop_parameters(nuisance)
    variance = np.array([own.get(name, 0.0) for name in plain.parameters])
    found = marginalise(plain, keep, np.diag(variance * plain.prior_sigma**2))
    return _widen(found, offsets.inflation)


def _widen(statistics: LocalStatistics, k: float) -> LocalStatistics:
    """With k times the variance; what no parameter explains stays."""
    if k == 1.0:
        return statistics
    explained = fisher_score(statistics).glr
    F, V, s = statistics.F / k, statistics.V / k, statistics.s / k
    return replace(statistics, s=s, F=F, V=V, chi2=statistics.chi2 - explained * (1.0 - 1.0 / k))


def _mean(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Of the columns that all have."""
    shared = [c for c in values[0] if all(c in each for each in values)]
    return {c: float(np.mean([each[c] for each in values])) for c in shared}


def agreement(parts: Sequence[LocalStatistics]) -> tuple[float, float]:
    """Probability that flights which agree differ by as much as these do, and by how much of their spread they differ;
    1 of one."""
    if len(parts) < 2:
        return 1.0, 1.0
    D = parts[0].prior_sigma
    s = np.stack([D * x.s for x in parts])
    F = np.stack([D[:, None] * x.F * D for x in parts])
    value, vector = np.linalg.eigh(F.sum(axis=0))
    U = vector[:, value > len(parts)]
    if not U.shape[1]:
        return 1.0, 1.0
    s, F = s @ U, U.T @ F @ U

    def square(s: np.ndarray, F: np.ndarray) -> float:
        return float(s @ np.linalg.pinv(F, hermitian=True) @ s)

    spread = sum(square(a, b) for a, b in zip(s, F, strict=True)) - square(s.sum(axis=0), F.sum(axis=0))
    dof = (len(parts) - 1) * U.shape[1]
    return float(chi2.sf(max(spread, 0.0), dof)), max(spread, 0.0) / dof
