"""The histories of engines from their recordings, what is known of each, and their last flights as one window.

While windows are read for the series of flights, what they know of the nominal engine's uncertainty is summed here,
flight by flight:

    s_t = Σ s_w,   F_t = Σ F_w      over the windows w of flight t

Long histories are summed over neighbouring flights, so that memory has a limit: two epochs become one whenever an
engine has twice `EPOCHS` of them.

The last flights of each engine are judged as one window, too. What each flight's instruments are off by is learnt from
all flights of the engine, as its history learns it, and marginalised flight by flight; what is uncertain about nominal
is one draw for all flights, and marginalised in the sum:

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

from enginediag_cli.detection.series import FEWEST, Series, WindowSource
from enginediag_cli.detection.verdict import format_size
from enginediag_cli.errors import DataError
from enginediag_cli.history.background import (
    LEAST_INFORMATION,
    History,
    KnownShift,
    OffsetModel,
    StepVisibility,
    learn_offsets,
    marginalise_offsets,
    step_visibility,
)
from enginediag_cli.history.hypotheses import FROM_START, GROWING, PULSE, STEP, UNLISTED
from enginediag_cli.history.posterior import (
    EVENT,
    ChangeEvent,
    HistoryChange,
    HistoryPosterior,
    judge_history,
)
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.parallel import parallel_imap
from enginediag_cli.parameters import Parameter
from enginediag_cli.progress import each
from enginediag_cli.residuals.files import OWN_HEALTH, Window, WindowReader
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import drop_nuisance, fisher_score, marginalise, marginalise_nuisance
from enginediag_cli.residuals.statistics import LocalStatistics
from enginediag_cli.residuals.windows import WindowStatistics, join_bookkeeping

UNLIKELY = 0.01
"""Probability below which a suspect or a shape is not shown."""
EPOCHS = 200
"""Epochs of a history: an onset is then known to half a per cent of its length, and judging takes a few seconds."""
FRESH = 16
"""Epochs that are held whole before they are condensed: more would take memory, fewer the time of condensing."""
KEPT_INFORMATION = LEAST_INFORMATION / 25
"""Information of a direction of unit normals, in the flights so far, below which it is dropped: a history of several
hundred flights, condensed that often, loses less than what is left out of it afterwards."""
DETERIORATION, COMES_AND_GOES = "deterioration", "comes and goes"
"""Families of kinds, beside those that are one kind."""
CHANGED, STEADY, CANNOT_TELL = "changed", "steady", "cannot tell"
FROM_THE_FIRST = "differs from nominal from the first flight on"
STEP_EPOCHS, NEARLY_ALL = 5, 0.9
"""Epochs within which a step that falls into one epoch has come for the most part, by any shape that is looked at."""
TINY = 1e-300
"""Keeps a division by a width of zero from failing."""
SEEN = 1e-9
"""Share of the largest information below which a direction of the parameters is not seen at all."""
GROSS = 1e-4
"""Probability of one flight among all of a healthy history to count as one that differs from nominal for certain."""
NOT_LISTED = "something that is not among the suspects"
POSSIBLE = 0.05
"""Probability from which something that may have changed is listed, where nothing is named."""


@dataclass(frozen=True)
class EpochSums:
    """Sums of `flights` flights from number `first` on, counted from 0: s (m,) and F (m, m), in prior standard
    deviations, of the monitored parameters and then of unit normals."""

    first: int
    flights: int
    s: np.ndarray
    F: np.ndarray

    def __add__(self, other: EpochSums) -> EpochSums:
        return EpochSums(self.first, self.flights + other.flights, self.s + other.s, self.F + other.F)

    def transform(self, T: np.ndarray) -> EpochSums:
        """In other coordinates, x = T x' of T (m, m')."""
        return replace(self, s=self.s @ T, F=T.T @ self.F @ T)


@dataclass
class EngineSums:
    """Epochs of one engine in order; like: its first window, whose parameters all have.

    Most of the unit normals that are uncertain about nominal tell nothing in one engine's flights. Epochs, but for the
    last `fresh`, are along the `directions` (r, k) of the r normals that do, so that a fleet fits into memory.
    """

    like: LocalStatistics
    epochs: list[EpochSums] = field(default_factory=list)
    flights: int = 0
    fresh: int = 0
    directions: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        self._rows = self.like.indices([*self.like.monitored, *self.like.common])
        self._scale = self.like.prior_sigma[self._rows]
        if not len(self.directions):
            self.directions = np.zeros((len(self.like.common), 0))

    def add(self, number: int, statistics: LocalStatistics) -> None:
        """The window of flight `number`, counted from 0. ValueError for other parameters than before."""
        if statistics.parameters != self.like.parameters:
            raise ValueError("statistics of different parameters have no common history")
        D = self._scale
        F = D[:, None] * statistics.F[np.ix_(self._rows, self._rows)] * D
        window = EpochSums(number, 1, D * statistics.s[self._rows], F)
        if number < self.flights:
            k = int(np.searchsorted([e.first for e in self.epochs], number, side="right")) - 1
            if k < len(self.epochs) - self.fresh:
                window = window.transform(self._coordinates(self.directions))
            self.epochs[k] = replace(self.epochs[k] + window, flights=self.epochs[k].flights)
            return
        self.flights, self.fresh = number + 1, self.fresh + 1
        self.epochs.append(window)
        if self.fresh >= FRESH:
            self._condense()
        if len(self.epochs) >= 2 * EPOCHS:
            self._condense()
            self.epochs = self._joined(2)

    def _coordinates(self, directions: np.ndarray) -> np.ndarray:
        """T (m, m') of the monitored parameters as they are, and of unit normals along `directions`."""
        p, (r, k) = len(self.like.monitored), directions.shape
        T = np.zeros((p + r, p + k))
        T[:p, :p], T[p:, p:] = np.eye(p), directions
        return T

    def _condense(self) -> None:
        """All epochs along the directions that tell something in any of them."""
        p, old, begin = len(self.like.monitored), self.directions, len(self.epochs) - self.fresh
        known = sum((e.F[p:, p:] for e in self.epochs[:begin]), np.zeros((old.shape[1],) * 2))
        total = sum((e.F[p:, p:] for e in self.epochs[begin:]), old @ known @ old.T)
        value, vector = np.linalg.eigh(total)
        self.directions = vector[:, value > KEPT_INFORMATION]
        T, moved = self._coordinates(self.directions), self._coordinates(old.T @ self.directions)
        self.epochs = [e.transform(T if k >= begin else moved) for k, e in enumerate(self.epochs)]
        self.fresh = 0

    def _joined(self, most: int) -> list[EpochSums]:
        """Neighbours joined, `most` epochs to one."""
        found = []
        for k in range(0, len(self.epochs), most):
            total = self.epochs[k]
            for other in self.epochs[k + 1 : k + most]:
                total = total + other
            found.append(total)
        return found

    def since(self, number: int) -> EngineSums:
        """Of the flights from `number` on, counted from 0, which is then flight 0; an epoch that holds some of both is
        left out."""
        self._condense()
        later = [replace(e, first=e.first - number) for e in self.epochs if e.first >= number]
        return EngineSums(self.like, later, self.flights - number, directions=self.directions)

    def history(self, meaning: Mapping[str, Parameter]) -> tuple[History, tuple[int, ...]]:
        """The history, and the number of each epoch's first flight, from 0. Offsets that each flight has anew are
        learnt from the history, so that theirs are left out."""
        self._condense()
        epochs = self.epochs if len(self.epochs) <= EPOCHS else self._joined(2)
        described = tuple(meaning[name] for name in self.like.monitored)
        score, information = np.stack([e.s for e in epochs]), np.stack([e.F for e in epochs])
        labels = tuple(str(e.first + 1) for e in epochs)
        unit = self._scale[: len(described)]
        return History(described, unit, score, information, labels), tuple(e.first for e in epochs)


@dataclass
class HistoryWindows:
    """The windows of `files` without what is uncertain beside the monitored parameters, which is summed by engine."""

    files: WindowSource
    engines: dict[str, EngineSums] = field(default_factory=dict)

    @property
    def monitor(self) -> Monitor | None:
        """That of the files."""
        return self.files.monitor

    @property
    def summed(self) -> bool:
        """Whether the windows of a flight are added."""
        return self.files.summed

    def windows(self) -> Iterator[Window]:
        """Each window, its statistics of the monitored parameters alone. Raises DataError."""
        place: dict[tuple[str, str, str], int] = {}
        for window, known in self.files.windows():
            statistics = window.statistics
            if statistics is None:
                yield window, known
                continue
            if window.engine not in self.engines:
                self.engines[window.engine] = EngineSums(statistics)
            key = (window.engine, window.source, window.flight)
            if not window.flight or key not in place or not self.summed:
                place[key] = self.engines[window.engine].flights
            try:
                self.engines[window.engine].add(place[key], statistics)
            except ValueError as error:
                name = f"engine {window.engine}: " if window.engine else ""
                raise DataError(f"{name}{error}") from None
            own = set(statistics.monitored)
            meaning = {n: p for n, p in known.items() if n in own}
            yield replace(window, statistics=replace(drop_nuisance(statistics), meaning=meaning)), known


@dataclass(frozen=True)
class EngineTrend:
    """What is known of one engine's history. posterior: of its epochs; first: number of each epoch's first flight, from
    0; flights: how many there are; departures: numbers, from 1, of flights that differ from nominal for certain;
    baseline: first flights that say what the engine is like; visible: steps after these that would have been seen;
    impossible: what a change of a listed suspect would have to be, where none can do it."""

    posterior: HistoryPosterior
    first: tuple[int, ...]
    flights: int
    departures: tuple[int, ...] = ()
    baseline: int = 0
    visible: StepVisibility | None = None
    impossible: str = ""

    @property
    def events(self) -> tuple[ChangeEvent, ...]:
        """What happened and has a suspect, most probable first."""
        return tuple(event for event in self.posterior.events if event.group[0] != UNLISTED)

    @property
    def changes(self) -> tuple[ChangeEvent, ...]:
        """Of these, what came while the engine flew."""
        return tuple(event for event in self.events if event.kind != FROM_START)

    @property
    def probability(self) -> float:
        """That the engine changed while it flew: of no event alone, where none was there from the start."""
        posterior = self.posterior
        if not posterior.events:
            return posterior.probability
        same = [1 - event.probability * (1 - event.shapes.get(FROM_START, 0.0)) for event in posterior.events]
        return 1 - float(np.prod(same))

    @property
    def differs_from_start(self) -> bool:
        """Whether the engine, or what was recorded of it, was off nominal before anything could change."""
        started = any(event.kind == FROM_START for event in self.events)
        return started or (not self.events and 1 in self.departures and 2 * len(self.departures) > self.flights)

    @property
    def verdict(self) -> str:
        """Of the history as a whole; never "steady" where flights differ from nominal for certain, or where they could
        not have shown a change."""
        if self.changes:
            return CHANGED
        if self.differs_from_start:
            return FROM_THE_FIRST
        return CANNOT_TELL if self.posterior.changed or self.departures or not self.powerful else STEADY

    @property
    def powerful(self) -> bool:
        """Whether a plausible change would have been seen."""
        return self.visible is None or self.visible.enough

    @property
    def undecided(self) -> bool:
        """Whether it is not known that anything changed, nor that nothing did."""
        return self.verdict == CANNOT_TELL and not self.posterior.changed

    @property
    def reason(self) -> str:
        """Why it is not known what changed, or whether anything did; "" where that is known."""
        if self.verdict != CANNOT_TELL:
            return self.impossible and f"cannot tell what else changed: {self.impossible}"
        if self.posterior.changed:
            chances = {**self.posterior.inclusion, NOT_LISTED: self.posterior.unlisted}
            likely = sorted((item for item in chances.items() if item[1] >= POSSIBLE), key=lambda item: -item[1])
            what = self.impossible or " or ".join(f"{name} ({p:.2g})" for name, p in likely) or NOT_LISTED
            return f"cannot tell what changed: {what}"
        if self.departures:
            words = f"{len(self.departures)} of its {self.flights} flights differ from the others for certain"
            return f"{words}, number {self.departures[0]} first, and no change explains them"
        assert self.visible is not None
        after, beside = self.flights - self.baseline, f" beside a baseline of {self.baseline}" if self.baseline else ""
        flights = f"{after} flight{'' if after == 1 else 's'}{beside} cannot show a change"
        return f"{flights}: {self.visible.words}"

    def calm_kind(self, name: str) -> str:
        """Of a parameter that takes part in no event: steady, unless it is not known that it is."""
        unseen = self.visible is not None and name in self.visible.unseen
        return CANNOT_TELL if unseen or self.verdict == CANNOT_TELL else STEADY

    def parameter_probability(self, name: str, owner: str) -> float:
        """That a parameter of a component or instrument changed: where that is named, or one of an ambiguity group,
        each of its parameters has its own; else that of the component as a whole."""
        named = False
        for event in self.events:
            for part in (*event.changes, *event.rivals):
                if part.name == name:
                    return event.probability * event.suspects[owner] * part.probability
            named |= owner in event.group
        return 0.0 if named else self.posterior.inclusion.get(owner, 0.0)

    def family(self, event: ChangeEvent) -> str:
        """The likeliest kind of an event as a reader knows it."""
        total = self.families(event)
        return max(total, key=lambda name: total[name])

    def families(self, event: ChangeEvent) -> dict[str, float]:
        """Probability of each kind of an event as a reader knows it: all that grows is deterioration, whether it
        saturates, ends or not. Where an epoch holds several flights, a step within one looks like growth over a few
        epochs, and is a step at this resolution."""
        total: dict[str, float] = {}
        for shape, p in event.shapes.items():
            family = DETERIORATION if shape in GROWING else COMES_AND_GOES if shape == PULSE else shape
            total[family] = total.get(family, 0.0) + p
        found = max(total, key=lambda name: total[name])
        epochs = len(self.first)
        long = epochs < self.flights and epochs - event.onset > 2 * STEP_EPOCHS  # else all has come within the few
        if found == DETERIORATION and long and event.end < 0 and event.changes:
            largest = max(event.changes, key=lambda x: abs(x.largest) / max(x.largest_high - x.largest_low, TINY))
            level = np.abs(self.posterior.level[:, self.posterior.parameters.index(largest.name)])
            soon = level[event.onset : event.onset + STEP_EPOCHS].max()
            if soon >= NEARLY_ALL * level.max():
                total[STEP] = total.get(STEP, 0.0) + total.pop(DETERIORATION)
        return total

    @property
    def epochs(self) -> np.ndarray:
        """Epoch (n,), from 0, of each flight."""
        return np.searchsorted(self.first, np.arange(self.flights), side="right") - 1

    def flight_levels(self, number: int) -> dict[str, tuple[float, float]]:
        """Smooth estimate of each parameter in a flight, counted from 1, with its standard deviation, in its unit."""
        epoch = int(np.searchsorted(self.first, number - 1, side="right")) - 1
        found = self.posterior
        values = zip(found.level[epoch].tolist(), found.deviation[epoch].tolist(), strict=True)
        return dict(zip(found.parameters, values, strict=True))

    def flight_number(self, epoch: int) -> int:
        """Number, from 1, of the first flight of an epoch."""
        return self.first[epoch] + 1

    def last_number(self, epoch: int) -> int:
        """Number, from 1, of the last flight of an epoch."""
        return self.first[epoch + 1] if epoch + 1 < len(self.first) else self.flights

    def onset_numbers(self, event: ChangeEvent) -> tuple[int, int, int]:
        """Number, from 1, of the first flight with an effect of an event: most probable, and the 95 % interval."""
        first, last = event.onset_set[0], event.onset_set[-1]
        return self.flight_number(event.onset), self.flight_number(first), self.last_number(last)


def add_engine_level(history: History) -> History:
    """The history of an engine that differs from nominal before anything happens: by manufacture and initial wear,

        θ_t = … + c,   c ~ N(0, diag σ²),   the same in all flights

    σ: `OWN_HEALTH` of a plausible change of components, `OWN_LEVEL` of a plausible error of instruments."""
    share = [OWN_LEVEL if p.belongs_to_instrument else OWN_HEALTH for p in history.parameters]
    return add_shifts(history, np.ones(len(history)), dict(enumerate(share)))


def add_shifts(history: History, course: np.ndarray, sizes: Mapping[int, float]) -> History:
    """The history with monitored parameters that may have moved along a course (T,) for a reason that is known and no
    change: position → standard deviation, in prior ones."""
    T, m = history.score.shape
    at, size = np.array(list(sizes), int), np.array(list(sizes.values()))
    F, s = history.information, history.score
    columns = course[:, None, None] * F[:, :, at] * size  # (T, m, c)
    own = course[:, None, None] * size[:, None] * columns[:, at]
    information = np.empty((T, m + len(at), m + len(at)))
    information[:, :m, :m], information[:, m:, m:] = F, own
    information[:, :m, m:], information[:, m:, :m] = columns, columns.transpose(0, 2, 1)
    return replace(
        history,
        information=information,
        score=np.concatenate([s, course[:, None] * s[:, at] * size], axis=1),
        shifts=(*history.shifts, KnownShift(m - history.width, at, size, course)),
    )


OWN_LEVEL = 1.0
"""How far an engine's readings plausibly differ from those of its type, as a share of a plausible error of the
instrument: the errors of its instruments are its own."""


def departing_epochs(calm: History) -> tuple[int, ...]:
    """Epochs, from 0, that differ from nominal for certain, each by itself, of a history without offsets:

    s_t ~ N(0, F̃_aa + F̃_aν F̃_νa)      (a: monitored parameters; ν ~ N(0, I): uncertain about nominal)
    """
    p = calm.width
    F, cross, s = calm.information[:, :p, :p], calm.information[:, :p, p:], calm.score[:, :p]
    value, vector = np.linalg.eigh(F)
    seen = value > SEEN * value[:, -1:]
    scale = np.where(seen, np.maximum(value, 0.0), np.inf) ** -0.5
    whitened = np.einsum("tij,ti->tj", vector, s) * scale
    loose = np.einsum("tij,tir->tjr", vector, cross) * scale[:, :, None]
    V = np.eye(p) + loose @ loose.transpose(0, 2, 1)
    statistic = np.einsum("ti,ti->t", whitened, np.linalg.solve(V, whitened[:, :, None])[:, :, 0])
    limit = chi2.isf(GROSS / len(calm), np.maximum(seen.sum(axis=1), 1))
    return tuple(int(t) for t in np.flatnonzero(statistic > limit))


@dataclass(frozen=True)
class HistoryOptions:
    """How one engine is judged. baseline: its first flights, believed healthy, which say what it is like; 0 where
    nominal says that; sensors: instruments may have changed; maintenance: number, from 1, of each first flight after
    it; shifts: number of a first flight → parameter → by how much, in prior standard deviations, something that is
    known may have moved it since; health: the path of health is computed, which margins need; believed: nothing begins
    in the baseline, as a user says."""

    baseline: int = 0
    sensors: bool = True
    maintenance: Sequence[int] = ()
    shifts: Sequence[tuple[int, Mapping[str, float]]] = ()
    health: bool = False
    believed: bool = False


def judge_engine_history(sums: EngineSums, meaning: Mapping[str, Parameter], options: HistoryOptions) -> EngineTrend:
    """What is known of one engine of `FEWEST` flights at least; meaning: what its parameters are."""
    history, first = sums.history(meaning)
    begins = np.searchsorted(first, [n - 1 for n in options.maintenance])
    history = replace(history, maintenance=tuple(sorted({int(t) for t in begins if 0 < t < len(first)})))
    if options.baseline:
        history = add_engine_level(history)
    place = {p.name: i for i, p in enumerate(history.parameters)}
    for number, moved in options.shifts:
        since = (np.array(first) >= number - 1).astype(float)
        history = add_shifts(history, since, {place[name]: size for name, size in moved.items() if name in place})
    begins_at = min(int(np.searchsorted(first, options.baseline)), len(first) - 1)
    if options.believed:
        history = replace(history, baseline=begins_at)
    offsets = learn_offsets(history)
    found = judge_history(history, sensors=options.sensors, health=options.health, offsets=offsets)
    found, impossible = exclude_impossible(found, history)
    calm = marginalise_offsets(history, offsets)
    departures = tuple(first[t] + 1 for t in departing_epochs(calm))
    visible = step_visibility(calm, begins_at)
    return EngineTrend(found, first, sums.flights, departures, options.baseline, visible, impossible)


def exclude_impossible(found: HistoryPosterior, history: History) -> tuple[HistoryPosterior, str]:
    """What is known without the events whose likeliest suspect would have to do more than it can: these happened, and
    are nothing that is listed; what they would take, in words."""
    low, high = SetPrior().bounds(history.parameters)
    place = {p.name: i for i, p in enumerate(history.parameters)}
    events, inclusion, words = [], dict(found.inclusion), ""
    for event in found.events:
        beyond = None
        for part in likeliest_form(event):
            i = place[part.name]
            if part.probability >= EVENT and not low[i] <= part.largest / history.unit[i] <= high[i]:
                beyond = history.parameters[i], part.largest
        if beyond is None:
            events.append(event)
            continue
        parameter, size = beyond
        what = "an instrument" if parameter.belongs_to_instrument else "a component"
        change = f"{parameter.words or parameter.name} by {format_size(parameter, size)}".replace("-", "−")
        words = f"it would take a change of {change}, outside what {what} can do: check units and engine file"
        inclusion.pop(event.group[0], None)
        nothing = np.zeros((0, 0))
        events.append(replace(event, suspects={UNLISTED: 1.0}, changes=(), rivals=(), covariance=nothing))
    if not words:
        return found, ""
    unlisted = max(e.probability * e.suspects.get(UNLISTED, 0.0) for e in events)
    return replace(found, events=tuple(events), inclusion=inclusion, unlisted=unlisted), words


def likeliest_form(event: ChangeEvent) -> tuple[HistoryChange, ...]:
    """The parts of an event; of an instrument the likeliest of its forms of error, which exclude each other."""
    return (max(event.changes, key=lambda x: x.probability),) if event.instrument and event.changes else event.changes


def judge_engines(
    sums: Mapping[str, EngineSums],
    series: Series,
    *,
    reference: int = 0,
    sensors: bool = True,
    maintenance: Mapping[str, Sequence[int]] | None = None,
    health: bool = False,
) -> Iterator[tuple[str, EngineTrend]]:
    """Engine and what is known of it, of those that have flights enough, in their order.

    reference: records of an engine in the first of which nothing began, 0 where nominal is the reference; sensors:
    instruments may have changed; maintenance: of each engine the numbers, from 1, of first flights after it;
    health: the path of health is computed, which margins need.
    """
    engines = [engine for engine, stretches in series.stretches.items() if len(stretches) >= FEWEST]

    def judged(k: int) -> EngineTrend:
        engine = engines[k]
        baseline = max(series.healthy(engine, reference), 1) if reference else 0
        options = HistoryOptions(baseline, sensors, (maintenance or {}).get(engine, ()), health=health, believed=True)
        return judge_engine_history(sums[engine], series.parameters, options)

    stories = zip(engines, parallel_imap(judged, len(engines)), strict=True)
    return each(stories, "engines judged", len(engines))


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
            if window.engine not in sums:
                sums[window.engine] = EngineSums(replace(first, rows=None, kurtosis=None, by_sensor=None))
            mine = sums[window.engine]
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
        names = tuple(p.name for p in history.parameters)
        parts = [_marginalise_offsets(w.statistics, names, offsets) for w in windows if w.statistics is not None]
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
    statistics: LocalStatistics | None, names: Sequence[str], offsets: OffsetModel | None
) -> LocalStatistics:
    """One flight with what its instruments are off by counted as noise: as learnt, of the parameters `names`, or of the
    size that identification found."""
    assert statistics is not None
    nuisance = set(statistics.own)
    keep = tuple(name for name in statistics.parameters if name not in nuisance)
    if offsets is None:
        variance = np.array([float(name in nuisance) for name in statistics.parameters])
        return marginalise(statistics, keep, np.diag(variance * statistics.prior_sigma**2))
    plain = statistics.drop_parameters(nuisance)
    at = np.array([plain.parameters.index(name) for name in names])
    covariance = np.zeros((len(plain.parameters),) * 2)
    covariance[np.ix_(at, at)] = plain.prior_sigma[at, None] * offsets.covariance * plain.prior_sigma[at]
    found = marginalise(plain, keep, covariance)
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
