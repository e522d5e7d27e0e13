"""Dynamic effects (with memory): what the past of a recording adds to the prediction of a record.

A `Memory` is a filter of one signal. A `Tape` is one whole recording, excluded records too. The input column MOMENT of
a record names its tape and its place there. So predictions may take records in blocks, in any order or a few of them,
and each record still finds its own past.

There are two kinds of memory. A filter of an input (a set point, an input column) is one pass along the tape. A filter
of the solution (a gas temperature) needs sweeps (`TapeIteration`): the quasi-steady network is solved for all records
at once, its signals are filtered along time, and both are repeated until nothing changes. The feedback from a memory to
its signal is small, a few per cent of the gas's power, and is known from the first sweep. Each further sweep gains two
to four digits. Derivatives go the same way. With the signals s(θ, m) and m = F(s, c),

    dm/dθ = F'(∂s/∂θ + ∂s/∂m dm/dθ) + ∂F/∂c dc/dθ

is repeated until it converges, without any solve. The memories are then further leaves of the prediction:
dy/dθ = ∂y/∂θ + ∂y/∂m dm/dθ.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.filters import Filter, FilterClock

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.strategy import Prediction


MOMENT = "moment"
"""Input column that says which record of which tape a record is; −1: its past is not known, it is taken as steady."""
NO_MOMENT = -1.0
"""Of a record whose past is not known."""
UNKNOWN_PAST: Mapping[str, float] = MappingProxyType({MOMENT: NO_MOMENT})
"""What terms with memory read beside the engine's own inputs."""
RECORDS = 2**26
"""Records that a tape may have: two years at 1 Hz. MOMENT is the tape's number times this, plus the record's."""
SHORTEST_STEP_S = 1e-6
"""What two records of one time lie apart: a step between them, not a quantity with two values."""
START_READINGS = 6
"""Readings at the beginning of a stretch whose median is the start value of a memory, where one shows it; a stretch of
fewer begins in equilibrium, else these would be told by themselves: of hourly records, each a stretch of its own, any
misfit would be a lag. Judgement: of an even number those of a meter that alternates between two values cancel."""
GAP_S = 900.0
"""A longer step of time begins a new stretch, at its steady state: an engine may have been shut down and started
meanwhile. Over a shorter one columns are taken to run straight. Judgement."""


@dataclass(frozen=True)
class Tape:
    """One recording: `time` (N,) s and columns (N,) by name, all finite; `first` (N,): where a stretch begins. Records
    are in the order of time within a stretch; `place` (N,): of each record as it was read among these."""

    time: Array
    columns: Mapping[str, Array]
    first: Array
    place: Array

    def __len__(self) -> int:
        return len(self.time)

    def clock(self, shown_by: str = "") -> FilterClock:
        """The clock of filters; `shown_by`: column that shows their output, from which it is known at the beginnings of
        stretches: the median of the first START readings of each that has as many."""
        if shown_by not in self.columns:
            return FilterClock(self.time, self.first)
        start, x = np.full(len(self), np.nan), self.columns[shown_by]
        for k, stop in pairwise([*np.flatnonzero(self.first).tolist(), len(self)]):
            if stop - k >= START_READINGS:
                start[k] = np.median(x[k : k + START_READINGS])
        return FilterClock(self.time, self.first, start)

    def has_column(self, column: str) -> bool:
        """Whether the recording has readings of a column."""
        return column in self.columns


def make_tape(columns: Mapping[str, Array], names: Sequence[str]) -> Tape | None:
    """The tape of a recording with `time_s` and those columns of `names` that it has; None where it has no time.

    A recording that was written backwards is turned round. Where time goes back once, or stands still for lack of a
    reading, what follows is another stretch; gaps in a column are bridged by straight lines, at the ends by the
    nearest reading.
    """
    time = np.asarray(columns.get("time_s", ()), float)
    if len(time) < 2 or not np.isfinite(time).any():
        return None
    N = len(time)
    time = bridge_gaps(time)
    steps = np.diff(time)
    order = np.arange(N)
    if np.count_nonzero(steps < 0.0) > np.count_nonzero(steps > 0.0):
        order = order[::-1]
    time = time[order].copy()
    steps = np.diff(time)
    first = np.append(True, (steps < 0.0) | (steps > GAP_S))
    for k in np.flatnonzero(steps == 0.0).tolist():  # one after the other, however little
        time[k + 1] = max(time[k + 1], time[k] + SHORTEST_STEP_S)
    kept = {}
    for name in names:
        x = np.asarray(columns.get(name, ()), float)
        if len(x) == N and np.isfinite(x).any():
            kept[name] = bridge_gaps(x)[order]
    place = np.empty(N, int)
    place[order] = np.arange(N)
    return Tape(time, kept, first, place)


@dataclass
class Tapes:
    """All tapes of an engine, shared by its copies. `names`: columns that are kept, where a recording has them."""

    names: tuple[str, ...]
    tapes: list[Tape] = field(default_factory=list)
    parts: dict[Hashable, tuple[int, list[Mapping[str, Array]]]] = field(default_factory=dict)

    def add(self, columns: Mapping[str, Array]) -> Array:
        """Add a recording (N records); returns its MOMENT (N,)."""
        return self._moments(columns, None, 0)

    def extend(self, key: Hashable, columns: Mapping[str, Array]) -> Array:
        """Add further records (N) of the recording `key`; their MOMENT (N,). What was known of earlier records
        stays as it is: only filters that look ahead would know more."""
        number, parts = self.parts.setdefault(key, (len(self.tapes), []))
        before = sum(len(p["time_s"]) for p in parts)
        kept = {c: np.asarray(v, float) for c, v in columns.items() if c in self.names or c == "time_s"}
        parts.append(kept)
        whole = {c: np.concatenate([p.get(c, np.full(len(p["time_s"]), np.nan)) for p in parts]) for c in kept}
        return self._moments(whole, number, before)

    def _moments(self, columns: Mapping[str, Array], number: int | None, since: int) -> Array:
        tape = make_tape(columns, self.names)
        N = len(np.asarray(next(iter(columns.values()), ())))
        if tape is None:
            return np.full(N - since, NO_MOMENT)
        if number is None or number == len(self.tapes):
            number = len(self.tapes)
            self.tapes.append(tape)
        else:
            self.tapes[number] = tape
        return number * float(RECORDS) + tape.place[since:]

    def locate(self, moment: Array) -> tuple[Array, Array]:
        """Number of the tape of each record (N,), −1 where it is on none, and its place there (N,)."""
        moment = np.asarray(moment, float)
        known = np.isfinite(moment) & (moment >= 0.0) & (moment < len(self.tapes) * float(RECORDS))
        number = np.where(known, np.floor_divide(np.where(known, moment, 0.0), RECORDS), -1).astype(int)
        place = np.where(known, moment - number * float(RECORDS), 0.0).astype(int)
        sizes = np.array([*map(len, self.tapes), 0])
        return np.where(place < sizes[number], number, -1), place


@dataclass(frozen=True)
class Memory:
    """A filter of one signal. What it makes is the leaf `name`: 0 in equilibrium, so that a steady record, or an
    effect that is absent, changes no digit.

    `coefficients`: parameters that the filter takes, in its order; `absent`: the parameters that are sought, with the
    values at which nothing is remembered. `column`: input column whose value it changes before the network reads it,
    which then is its signal; else the signal is what an evaluation leaves in `Evaluation.signals`. `recorded`: column
    from which `measured` makes the signal where the recording has it. `sensor`: column of the reading that shows the
    signal, if it is one. `shown_by`: column of the
    recordings that shows what the filter makes, if there is one: it tells where it begins. `tried`: names of
    directions along which the effect is tried at one size each, with the values of `coefficients`. `turns`: the shaft
    of which the first coefficient is the inertia, where the effect is that; simulations have its speed as a state.
    `multiplied`: the size of the effect is none of the coefficients but multiplies what is remembered, which is there
    before the effect is.
    """

    name: str
    filter: Filter
    coefficients: tuple[str, ...]
    absent: Mapping[str, float]
    column: str = ""
    recorded: str = ""
    sensor: str = ""
    sensor_column: str = ""
    measured: Callable[[Array], Array] = np.asarray
    trial_sizes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    rotor_shaft: str = ""
    multiplied: bool = False


SWEEPS = 30
"""Solves of a tape at most. A memory that gives back a tenth of its signal needs nine; heat soak that takes a quarter,
half of what its range allows, more than twelve on a real flight."""
STAGNATION_SWEEPS = 8
"""Sweeps over which what changes must halve: what does not cannot settle within SWEEPS, as a switch that turns itself
off does not at all."""
CONVERGED_CHANGE = 1e-9
"""Of the largest value of a memory: a sweep that changes less was the last."""
CACHE_SIZE = 20_000_000
"""Numbers that are kept of what was remembered last, 160 MB: a fit in blocks asks for the same tapes again."""


@dataclass(frozen=True)
class KnownLeaf:
    """Values (N,) of a leaf that is known before the network is solved, and their derivatives (N,) by name."""

    value: Array
    slopes: Mapping[str, Array]


@dataclass
class TapeMemories:
    """What memories hold at all records of a tape: by name values (N,) and derivatives (N,). `settled`: whether the
    last sweep changed nothing any more."""

    values: dict[str, Array]
    slopes: dict[str, dict[str, Array]]
    converged: bool = True

    @property
    def size(self) -> int:
        return sum(v.size for v in self.values.values()) + sum(
            s.size for of in self.slopes.values() for s in of.values()
        )


@dataclass
class MemoryStore:
    """Memories of one engine, and of its copies at other parameters, with the starts of their sweeps."""

    tapes: Tapes
    _cache: OrderedDict[tuple[Any, ...], TapeMemories] = field(default_factory=OrderedDict)
    _starts: dict[tuple[int, int], Array] = field(default_factory=dict)

    def initial_unknowns(self, points: Mapping[str, Any], size: int) -> Array | None:
        """Unknowns (nx, size) of the last sweep in the records asked for, NaN where there was none; None without any:
        from there the answer is near."""
        if not self._starts or MOMENT not in points:
            return None
        number, place = self.tapes.locate(np.broadcast_to(points[MOMENT], (size,)))
        start = np.full((len(next(iter(self._starts.values()))), size), np.nan)
        for (k, _), x in self._starts.items():
            rows = np.flatnonzero((number == k) & (place < x.shape[1]))
            start[:, rows] = x[:, place[rows]]
        return start if np.isfinite(start).any() else None

    @property
    def contents(self) -> tuple[OrderedDict[tuple[Any, ...], TapeMemories], dict[tuple[int, int], Array]]:
        """All that is remembered, for another process."""
        return self._cache, self._starts

    def restore(self, kept: tuple[OrderedDict[tuple[Any, ...], TapeMemories], dict[tuple[int, int], Array]]) -> None:
        """Go on where another process has ended."""
        self._cache, self._starts = kept

    def forget(self) -> None:
        self._cache.clear()
        self._starts.clear()

    def known_leaves(
        self, engine: Engine, points: Mapping[str, Any], theta: Mapping[str, Any], wrt: Sequence[str], size: int
    ) -> tuple[dict[str, KnownLeaf], Array]:
        """Leaves that follow from set points and from the past of `size` records, and the records (N,) of a tape whose
        memories did not settle."""
        network = engine.network
        found: dict[str, KnownLeaf] = {}
        unsettled = np.zeros(size, dtype=bool)
        if network.demand is not None:
            found[network.power_setting] = demanded_power(engine, points, theta, wrt, size)
        memories = [m for m in network.memories if is_active(m, theta, wrt)]
        if not memories:
            return found, unsettled
        # a reading error of an input acts on the requested records: their past is what the tape shows
        tried = {n for m in memories for n in m.trial_sizes}
        wrt = tuple(n for n in wrt if n in theta or n in tried)
        number, place = self.tapes.locate(np.broadcast_to(points[MOMENT], (size,)))
        for m in memories:
            base = found.get(m.column) if m.column else None
            if base is None:
                start = np.broadcast_to(np.asarray(points[m.column], float), (size,)) if m.column else np.zeros(size)
                base = KnownLeaf(start, {})
            found[m.column or m.name] = KnownLeaf(base.value.copy(), {n: s.copy() for n, s in base.slopes.items()})
        for k in np.unique(number[number >= 0]).tolist():
            rows = np.flatnonzero(number == k)
            at = place[rows]
            recalled = self._recalled(engine, k, theta, wrt, memories, (rows, at))
            unsettled[rows] = not recalled.converged
            for m in memories:
                leaf = found[m.column or m.name]
                leaf.value[rows] += recalled.values[m.name][at]
                slopes: dict[str, Array] = dict(leaf.slopes)
                for n, s in recalled.slopes[m.name].items():
                    slopes.setdefault(n, np.zeros(size))[rows] += s[at]
                found[m.column or m.name] = KnownLeaf(leaf.value, slopes)
        return found, unsettled

    def _recalled(
        self,
        engine: Engine,
        k: int,
        theta: Mapping[str, Any],
        wrt: Sequence[str],
        memories: Sequence[Memory],
        requested: tuple[Array, Array],
    ) -> TapeMemories:
        """Memories along tape k; from the cache where nothing has changed."""
        tape = self.tapes.tapes[k]
        states = [m for m in memories if not m.column]
        demand = engine.network.demand.names if engine.network.demand is not None else ()
        names = list(theta) if states else [*demand, *(c for m in memories for c in m.coefficients)]
        numbers = tuple(theta[n].tobytes() if np.ndim(theta[n]) else theta[n] for n in names)
        rows = requested[1].tobytes() if any(np.ndim(theta[n]) for n in names) else b""
        key = (k, len(tape), tuple(m.name for m in memories), tuple(wrt), numbers, rows)
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        on_tape = {n: _tape_values(x, requested, len(tape)) if np.ndim(x) else x for n, x in theta.items()}
        recalled, leaves = self._input_memories(engine, tape, on_tape, wrt, [m for m in memories if m.column])
        if states:
            points = self._tape_points(engine, tape, on_tape, recalled)
            iteration = TapeIteration(engine, tape, on_tape, states, points, self._starts.get((k, len(tape))))
            iteration.run()
            if iteration.unknowns is not None:
                self._starts[k, len(tape)] = iteration.unknowns
            recalled.values |= iteration.values
            recalled.slopes |= iteration.slopes(wrt, {n: leaf.slopes for n, leaf in leaves.items()})
            recalled.converged = iteration.converged
        self._cache[key] = recalled
        while len(self._cache) > 1 and sum(r.size for r in self._cache.values()) > CACHE_SIZE:
            self._cache.popitem(last=False)
        return recalled

    def _input_memories(
        self, engine: Engine, tape: Tape, theta: Mapping[str, Any], wrt: Sequence[str], memories: Sequence[Memory]
    ) -> tuple[TapeMemories, dict[str, KnownLeaf]]:
        """Memories of inputs, one behind the other where they are of one column, and the inputs that they change."""
        recalled = TapeMemories({}, {})
        leaves: dict[str, KnownLeaf] = {}
        if engine.network.demand is not None:
            leaves[engine.network.power_setting] = demanded_power(engine, tape.columns, theta, wrt, len(tape))
        zero = np.zeros(len(tape))
        for m in memories:
            signal = leaves.get(m.column, KnownLeaf(tape.columns.get(m.column, zero), {}))
            value, slopes = filter_signal(m, tape, signal, theta, wrt)
            recalled.values[m.name], recalled.slopes[m.name] = value, slopes
            names = dict.fromkeys((*signal.slopes, *slopes))
            sums = {n: signal.slopes.get(n, zero) + slopes.get(n, zero) for n in names}
            leaves[m.column] = KnownLeaf(signal.value + value, sums)
        return recalled, leaves

    def _tape_points(
        self, engine: Engine, tape: Tape, theta: Mapping[str, Any], recalled: TapeMemories
    ) -> dict[str, Any]:
        """Inputs of the network along a tape, after the set point and the memories of inputs."""
        points = engine.tape_points(tape)
        if engine.network.demand is not None:
            setting = engine.network.power_setting
            points[setting] = demanded_power(engine, tape.columns, theta, (), len(tape)).value
        for m in engine.network.memories:
            if m.name in recalled.values:
                points[m.column] = points[m.column] + recalled.values[m.name]
        return points


@dataclass
class TapeIteration:
    """Fixed-point iteration for K memories `states` of the solution along one tape of N records.

    `points`: inputs of the network there. `unknowns` (nx, N): where to begin, then those of the last sweep. Its results
    are `values` (N,) by name of the memory, `converged`, and `slopes`.
    """

    engine: Engine
    tape: Tape
    theta: Mapping[str, Any]
    states: Sequence[Memory]
    points: Mapping[str, Any]
    unknowns: Array | None
    values: dict[str, Array] = field(default_factory=dict)
    converged: bool = False
    _signals: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        N = len(self.tape)
        self.names = tuple(m.name for m in self.states)
        self.values = {n: np.zeros(N) for n in self.names}
        self.measured = [bool(m.recorded and self.tape.has_column(m.recorded)) for m in self.states]
        self.present = any(is_present(m, self.theta) for m in self.states)

    def run(self) -> None:
        """Solve and filter until nothing changes, or until it is clear that this takes too long."""
        if all(self.measured):  # no signal comes from the solution: nothing has to be solved
            nothing = np.full(len(self.tape), np.nan)
            self._signals = np.stack([_signal(m, self.tape, nothing) for m in self.states], axis=1)
            self.values = {m.name: self._filter(i, {}, ())[0] for i, m in enumerate(self.states)}
            self.converged = True
            return
        changes: list[float] = []
        feedback = np.zeros((len(self.tape), len(self.states), len(self.states)))
        while len(changes) < SWEEPS:
            first = not changes
            # a point that no way has led to is tried again from its neighbours, not in every way in each sweep
            p = self._solve(self.names if self.present and first else (), walk=first)
            self.unknowns = np.where(np.isfinite(p.x), p.x, np.nan)
            self._signals = np.stack([_signal(m, self.tape, p.y[:, i]) for i, m in enumerate(self.states)], axis=1)
            if not self.present:  # nothing is passed on, whatever the signals are
                self.converged = True
                return
            if first:
                feedback = np.nan_to_num(p.jacobian) * ~np.array(self.measured)[:, None]
            new = consistent_values(self.states, self.tape, self.theta, self._signals, feedback, self.values)
            changes.append(max(relative_change(new[n], self.values[n]) for n in self.names))
            self.values = new
            if changes[-1] < CONVERGED_CHANGE:
                self.converged = True
                return
            if len(changes) > STAGNATION_SWEEPS and changes[-1] > 0.5 * changes[-1 - STAGNATION_SWEEPS]:
                return

    def slopes(
        self, wrt: Sequence[str], input_slopes: Mapping[str, Mapping[str, Array]]
    ) -> dict[str, dict[str, Array]]:
        """Derivatives (N,) of each memory by name, along `wrt`; `input_slopes`: those of the inputs of the network."""
        if not wrt:
            return {n: {} for n in self.names}
        if not self.present or all(self.measured):
            return {m.name: self._filter(i, {}, wrt)[1] for i, m in enumerate(self.states)}
        leaves = tuple(dict.fromkeys((*input_slopes, *self.names)))
        p = self._solve((*wrt, *(n for n in leaves if n not in wrt)), walk=False)
        J = {n: p.jacobian[:, :, j] for j, n in enumerate(p.wrt)}  # (N, K) along each direction
        direct = {n: J[n].copy() for n in wrt}
        for leaf, own in input_slopes.items():
            for n, slope in own.items():
                direct[n] = direct[n] + J[leaf] * slope[:, None]
        slopes: dict[str, dict[str, Array]] = {n: {} for n in self.names}
        for _ in range(SWEEPS):
            new = self._slopes_once(direct, J, slopes, wrt)
            zero = np.zeros(len(self.tape))
            changes = [
                relative_change(d, slopes[name].get(n, zero)) for name, own in new.items() for n, d in own.items()
            ]
            slopes = new
            if max(changes, default=0.0) < CONVERGED_CHANGE:
                break
        return slopes

    def _slopes_once(
        self,
        direct: Mapping[str, Array],
        J: Mapping[str, Array],
        slopes: Mapping[str, Mapping[str, Array]],
        wrt: Sequence[str],
    ) -> dict[str, dict[str, Array]]:
        """F'(∂s/∂θ + ∂s/∂m dm/dθ) + ∂F/∂c dc/dθ with these dm/dθ; `direct`: ∂s/∂θ (N, K) by name."""
        total = dict(direct)
        for n in wrt:
            for name in self.names:
                if n in slopes[name]:
                    total[n] = total[n] + J[name] * slopes[name][n][:, None]
        new = {}
        for i, m in enumerate(self.states):
            own = {} if self.measured[i] else {n: bridge_gaps(x[:, i]) for n, x in total.items()}
            new[m.name] = self._filter(i, own, wrt)[1]
        return new

    def _solve(self, wrt: Sequence[str], walk: bool) -> Prediction:
        """The signals of the memories at all records, with what is remembered now."""
        points = {**self.points, **self.values}
        return self.engine.solved(points, self.theta, len(self.tape), self.names, wrt, self.unknowns, walk=walk)

    def _filter(self, i: int, slopes: Mapping[str, Array], wrt: Sequence[str]) -> tuple[Array, dict[str, Array]]:
        """What memory i makes of its signal, whose derivatives (N,) are `slopes`."""
        return filter_signal(self.states[i], self.tape, KnownLeaf(self._signals[:, i], slopes), self.theta, wrt)


def consistent_values(
    states: Sequence[Memory],
    tape: Tape,
    theta: Mapping[str, Any],
    s: Array,
    back: Array,
    at: Mapping[str, Array],
) -> dict[str, Array]:
    """What is remembered of signals (N, K) that follow it by `back` (N, K, K) from where they were solved, `at`:
    without a further solve, which then has little left to correct."""
    m_now = dict(at)
    for _ in range(SWEEPS):
        moved = np.stack([m_now[m.name] - at[m.name] for m in states], axis=1)
        here = s + np.einsum("nij,nj->ni", back, moved)
        new = {m.name: filter_signal(m, tape, KnownLeaf(here[:, i], {}), theta, ())[0] for i, m in enumerate(states)}
        change = max(relative_change(new[m.name], m_now[m.name]) for m in states)
        m_now = new
        if change < CONVERGED_CHANGE / 10.0:
            break
    return m_now


def is_active(m: Memory, theta: Mapping[str, Any], wrt: Sequence[str]) -> bool:
    """Whether anything is remembered, or sought."""
    sought = any(n in wrt for n in (*m.absent, *m.trial_sizes))
    return sought or any(bool(np.any(theta[n] != absent)) for n, absent in m.absent.items())


def is_present(m: Memory, theta: Mapping[str, Any]) -> bool:
    """Whether the memory changes anything: an absent one does not, unless its size multiplies the memory."""
    return m.multiplied or any(float(np.mean(theta[n])) != absent for n, absent in m.absent.items())


def demanded_power(
    engine: Engine, points: Mapping[str, Any], theta: Mapping[str, Any], wrt: Sequence[str], size: int
) -> KnownLeaf:
    """The power setting that belongs to recorded set points."""
    demand = engine.network.demand
    assert demand is not None
    x = np.broadcast_to(np.asarray(points[demand.column], float), (size,))
    value, slopes, own = demand(x, theta)
    kept = {n: s for n, s in slopes.items() if n in wrt}
    if demand.column in wrt:
        kept[demand.column] = own
    return KnownLeaf(value, kept)


def filter_signal(
    m: Memory, tape: Tape, signal: KnownLeaf, theta: Mapping[str, Any], wrt: Sequence[str]
) -> tuple[Array, dict[str, Array]]:
    """What a memory makes of its signal: values (N,) and derivatives (N,) by name, of its trials as well."""
    names = list(signal.slopes) if is_present(m, theta) else []
    rows = np.stack([signal.slopes[n] for n in names]) if names else np.zeros((0, len(tape)))
    coefficients = [float(np.mean(theta[c])) for c in m.coefficients]
    clock = tape.clock(m.sensor_column)
    one = m.filter(clock, signal.value, rows, coefficients)
    slopes = {n: row for n, row in zip(names, one.input_slopes, strict=True) if row.any()}
    for c, row in zip(m.coefficients, one.coefficient_slopes, strict=True):
        if c in wrt:
            slopes[c] = slopes[c] + row if c in slopes else row
    for name, values in m.trial_sizes.items():
        if name in wrt:
            slopes[name] = m.filter(clock, signal.value, np.zeros((0, len(tape))), values).value - one.value
    return one.value, slopes


def _tape_values(values: Array, asked: tuple[Array, Array], N: int) -> Array:
    """A parameter that varies from record to record, at all records of a tape: straight between the requested ones."""
    rows, at = asked
    order = np.argsort(at, kind="stable")
    return np.interp(np.arange(N), at[order], np.asarray(values, float)[rows][order])


def _signal(m: Memory, tape: Tape, solved: Array) -> Array:
    if m.recorded and tape.has_column(m.recorded):
        return m.measured(tape.columns[m.recorded])
    return bridge_gaps(solved)


def bridge_gaps(x: Array) -> Array:
    """x (N,) with straight lines in the place of what is not finite, the nearest at the ends, 0 where nothing is."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return np.where(good, x, 0.0)
    return np.interp(np.arange(len(x)), np.flatnonzero(good), x[good])


def relative_change(new: Array, old: Array) -> float:
    """Largest change, of the largest value there is; 0 where both are 0."""
    size = max(float(np.abs(new).max(initial=0.0)), 1e-300)
    return float(np.abs(new - old).max(initial=0.0)) / size
