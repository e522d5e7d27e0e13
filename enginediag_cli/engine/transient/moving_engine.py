"""`MovingEngine`: an engine with states, flown along records and then read like any other.

An error-controlled integration chooses the steps; collocation over the whole run then makes the states exact. Where
states are given, all points of all runs are one batch of quasi-steady solves, with the derivatives of the states'
rates, f(x, t) and ∂f/∂x. So Newton's method for a whole run takes a few such batches. With nodes c and weights A of the
method, in every step

    x_i = x_0 + h Σ_j A_ij f(x_j, t_0 + c_j h),   the last node being the end of the step.

The method is Radau IIA of fifth order, stiffly accurate and L-stable. The error of the steps of third order, of the
order of their tolerance, is gone after one or two sweeps.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, ch. IV.5 and IV.8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, value
from enginediag_cli.engine.engine import NOT_CONVERGED, Engine, Prediction
from enginediag_cli.engine.recall import MOMENT, NO_MOMENT
from enginediag_cli.engine.transient.integrate import (
    RADAU,
    TOLERANCE,
    Track,
    integrate,
    interpolate,
    linear_solve,
    quartic,
    slope,
    state_slopes,
)
from enginediag_cli.engine.transient.states import (
    ELAPSED,
    FixedStateNetwork,
    InputCourse,
    MovingNetwork,
    RotorState,
    TransientInputs,
    TransientState,
    make_course,
    network_inputs,
    remembered,
    transient_states,
)

WEIGHTS = (RADAU[:, None] ** np.arange(1, 4) / np.arange(1, 4)) @ np.linalg.inv(RADAU[:, None] ** np.arange(3))
"""A: integrals of the polynomials that are 1 at one node and 0 at the others; the last row are those of the step."""
SWEEPS = 8
"""At most. Without a kink one gains as many digits as there were; each kink that moves costs another."""
SETTLED = 1e-6
"""Of the size of a state: of a sweep that moves less nothing is left that is not proportional to it."""
ROUNDS = 4
"""In which steps are divided, at most."""
BALANCE = 1e-9
"""Of the size of a state: what a step may leave between what a state does and what its rate adds up to. A run has a
hundred steps that err either way, and 1e-8 of its energy is required."""
SMOOTH, KINK = 5.0, 2.0
"""Powers of its length with which the error of a step goes: of six, less one for those that it becomes, and where a
limit takes over within it."""
MOST_PARTS = 24
"""Of a step at once: a kink that lies in it is left 500 times smaller."""
BESIDE = np.array([0.4, 0.83])
"""Shares of a step at which its rates are looked at again, between the nodes."""
SHARE_OF_BESIDE = np.linalg.solve(
    np.concatenate([[0.0], RADAU, BESIDE]) ** np.arange(6)[:, None], 1.0 / np.arange(1, 7)
)[-2:]
"""Weights of a deviation there in its integral over the step, since it is nothing at the other nodes."""
SHORTEST_S = 1e-5
"""No step is divided into shorter ones."""
FARTHEST = 1e-3
"""Of the size of a state: what moves further was no solution of the steps."""


@dataclass
class _Steps:
    """All steps of the runs that are going, one after the other (M,): their run, length, whether they are the first of
    their run, inputs of the network at both ends (M, 2), and unknowns (nx, M, 2) to start from there."""

    run: Array
    h: Array
    first: Array
    inputs: dict[str, Array]
    start: Array


@dataclass
class _StepSolution:
    """Of M steps: states where they begin (M, ns) and at their nodes (M, s, ns), those that follow last, as they stood
    where the step began; `now` (M, s, ns): how fast states change there, or, of those that follow, what they are, and
    its derivatives `J` (M, s, ns, ns); `new` (M,): steps of which these are not known yet."""

    begin: Array
    x: Array
    now: Array
    J: Array
    new: Array

    def select(self, rows: Array) -> _StepSolution:
        """The same of some steps."""
        return _StepSolution(self.begin[rows], self.x[rows], self.now[rows], self.J[rows], self.new[rows])


def made_exact(
    given: Engine, network: MovingNetwork, course: InputCourse, theta: Mapping[str, Any], tracks: Sequence[Track]
) -> None:
    """Moves the states of tracks onto the solution, with their slopes and energies, and adds those within the steps;
    steps that do not keep the balance of a state are divided. `given`: the engine with its states given. A run that
    does not settle stays as it was, and is not `exact`."""
    states = sorted(network.states, key=lambda state: state.follows)
    order = [network.states.index(state) for state in states]
    nf = sum(not state.follows for state in states)
    going = [r for r, track in enumerate(tracks) if len(track.time) > 1]
    names = [u.name for u in network.unknowns()]
    kept = [names.index(u.name) for u in given.unknowns]
    before: dict[int, Track] = {}
    known: dict[int, tuple[_StepSolution, Array]] = {}
    for number in range(ROUNDS if nf else 0):
        if not going:
            return
        steps, at = _make_steps(kept, course, tracks, going), _initial_solution(tracks, going, order, nf, known)
        of = _Run(given, states, steps, theta, nf)
        new = at.new.copy()
        settled = _collocate(of, at, len(tracks))
        for r in going:
            if settled[r]:
                tracks[r].exact = True
                _write(tracks[r], network, order, nf, at, np.flatnonzero(steps.run == r))
            elif r in before:  # as it was with longer steps
                vars(tracks[r]).update(vars(before[r]))
        if number == ROUNDS - 1:
            return
        # across a kink a step errs with the square of its length: what is left of those that were divided as if smooth
        looked_at = np.flatnonzero(new & settled[steps.run])
        parts = np.ones(len(steps.h), dtype=int)
        parts[looked_at] = _parts(of, at, looked_at, KINK if number else SMOOTH)
        stood = _divided_states(of, at, parts)
        going = [r for r in going if (parts[steps.run == r] > 1).any()]
        for r in going:
            before[r] = copy(tracks[r])
            rows = np.flatnonzero(steps.run == r)
            known[r] = at.select(rows), parts[rows]
            _divide(tracks[r], parts[rows], [stood.get(k) for k in rows.tolist()], order[nf:])


@dataclass
class _Run:
    """What stays as it is while states move."""

    given: Engine
    states: Sequence[TransientState]
    steps: _Steps
    theta: Mapping[str, Any]
    nf: int


def _collocate(of: _Run, at: _StepSolution, runs: int) -> Array:
    """Moves states onto the solution of the method on these steps; which of so many runs are there."""
    steps, nf = of.steps, of.nf
    size = np.maximum(np.abs(at.x).max(axis=1), 1e-12)
    moved, settled, lost = np.zeros(runs), np.zeros(runs, dtype=bool), np.zeros(runs, dtype=bool)
    lost[np.setdiff1d(np.arange(runs), steps.run)] = True
    for _ in range(SWEEPS):
        rows = np.flatnonzero(~(settled | lost)[steps.run])
        asked = rows[at.new[rows]]
        at.now[asked], at.J[asked] = _rates(of, at.x[asked], asked, np.tile(RADAU, (len(asked), 1)))
        change = _newton(at, steps, rows, nf)
        share = np.where(np.isfinite(change), np.abs(change) / size[rows, None], np.inf)
        worst = np.zeros((2, runs))
        np.maximum.at(worst[0], steps.run[rows], share.max(axis=(1, 2)))
        np.maximum.at(worst[1], steps.run[rows], share[:, :, :nf].max(axis=(1, 2)))
        moved += worst[1]
        lost |= ~((moved < FARTHEST) & np.isfinite(worst[0]))
        settled |= (worst[0] < SETTLED) & ~lost
        keep = ~lost[steps.run[rows]]
        some, change = rows[keep], change[keep]
        given = change[:, 1:].copy()
        given[:, :, nf:] = change[:, :1, nf:]
        at.begin[some] += change[:, 0]
        at.x[some] += given
        # where states hardly move their rates are known from their derivatives
        at.now[some] += np.einsum("nskl,nsl->nsk", at.J[some], given)
        at.new[some] = share[keep].max(axis=(1, 2)) > SETTLED
        if (settled | lost).all():
            break
    return settled & ~lost


def _parts(of: _Run, at: _StepSolution, rows: Array, order: float) -> Array:
    """Into how many each of some steps (n,) is to be divided, so that none of its states moves otherwise than its rate
    adds up to by more than BALANCE: by rates at two more points."""
    steps, nf = of.steps, of.nf
    h, run = steps.h[rows], steps.run[rows]
    shares = np.tile(BESIDE, (len(rows), 1))
    x, slopes = _curve_states(of, at, rows, shares)
    found, _ = _rates(of, x, rows, shares, wrt=False)
    curve = np.stack([slope(one, slopes).T for one in shares.T], axis=1)
    off = np.abs(h[:, None] * np.einsum("i,mik->mk", SHARE_OF_BESIDE, found[:, :, :nf] - curve))
    size = np.zeros((int(steps.run.max()) + 1, nf))
    np.maximum.at(size, steps.run, np.abs(at.x[:, -1, :nf]))
    excess = (off / np.maximum(size[run], 1e-12)).max(axis=1) / BALANCE
    parts = np.clip(np.ceil(np.nan_to_num(excess) ** (1.0 / order)), 1, MOST_PARTS).astype(int)
    return np.where(h / parts > SHORTEST_S, parts, 1)


def _curve_states(of: _Run, at: _StepSolution, rows: Array, shares: Array) -> tuple[Array, Array]:
    """States (n, s, ns) at shares (n, s) of some steps, and slopes (4, nf, n) of their curves."""
    slopes = np.concatenate([_first_slopes(of.steps, at, of.nf)[None], at.now[:, :, : of.nf].transpose(1, 0, 2)])
    slopes = slopes.transpose(0, 2, 1)[:, :, rows]
    x = np.repeat(at.begin[rows, None], shares.shape[1], axis=1)
    for i, share in enumerate(shares.T):
        x[:, i, : of.nf] = quartic(share, of.steps.h[rows], at.begin[rows, : of.nf].T, slopes).T
    return x, slopes


def _divided_states(of: _Run, at: _StepSolution, parts: Array) -> dict[int, Array]:
    """What follows (parts - 1, ns - nf), where steps that are to be divided will begin anew."""
    divided = np.flatnonzero(parts > 1)
    if not divided.size or of.nf == len(of.states):
        return {}
    rows = np.repeat(divided, parts[divided] - 1)
    first = np.cumsum(parts[divided] - 1) - (parts[divided] - 1)
    shares = (np.arange(len(rows)) - np.repeat(first, parts[divided] - 1) + 1.0) / parts[rows]
    x, _ = _curve_states(of, at, rows, shares[:, None])
    now, _ = _rates(of, x, rows, shares[:, None], wrt=False)
    return dict(zip(divided.tolist(), np.split(now[:, 0, of.nf :], first[1:]), strict=True))


def _first_slopes(steps: _Steps, at: _StepSolution, nf: int) -> Array:
    """Slopes (M, nf) at the beginning of steps: those at the end of the one before, or of an engine that stood
    still."""
    before = np.concatenate([np.zeros((1, nf)), at.now[:-1, -1, :nf]])
    return np.where(steps.first[:, None], 0.0, before)


def _divide(track: Track, parts: Array, stood: Sequence[Array | None], follows: Sequence[int]) -> None:
    """Steps of a track into so many parts, on the curve that it has; `stood`: states `follows` where they begin
    anew."""
    T = np.asarray(track.time)
    fine = [k + np.arange(n) / n for k, n in enumerate(parts.tolist())]
    time = np.interp(np.append(np.concatenate(fine), len(T) - 1), np.arange(len(T)), T)
    nodes = (time[:-1, None] + np.diff(time)[:, None] * RADAU[:-1]).ravel()
    known, unknowns = interpolate(track, time, np.zeros(len(track.states[0]), dtype=bool))
    states, at = known[:-1], np.append(0, np.cumsum(parts))
    states[:, at] = np.array(track.states).T
    for k, values in enumerate(stood):
        if values is not None:
            states[follows, at[k] + 1 : at[k + 1]] = values.T
    inner = state_slopes(track, nodes).reshape(len(states), -1, 2)
    slopes = state_slopes(track, time)
    track.time, track.states, track.unknowns = time.tolist(), list(states.T), list(unknowns.T)
    track.slopes, track.within = list(slopes.T), list(inner.transpose(1, 2, 0))
    track.work = [np.zeros(len(states)) for _ in time]


def _newton(at: _StepSolution, steps: _Steps, rows: Array, nf: int) -> Array:
    """Corrections (n, 1 + s, ns) of some steps' begin and nodes: x_i - x_0 - h A f = 0 in each step, and each begins
    where the last one ended."""
    n, s, ns = at.x[rows].shape
    h, x, now, begin, J = steps.h[rows], at.x[rows], at.now[rows], at.begin[rows], at.J[rows]
    left = begin[:, None, :nf] - x[:, :, :nf] + h[:, None, None] * np.einsum("ij,njk->nik", WEIGHTS, now[:, :, :nf])
    hAJ = h[:, None, None, None, None] * np.einsum("ij,njkl->nikjl", WEIGHTS, J[:, :, :nf])  # (n, s, nf, s, ns)
    G = np.eye(s * nf) - hAJ[..., :nf].reshape(n, s * nf, s * nf)
    # what the beginning of the step does: as x_0, and as that from which something follows
    of_begin = np.concatenate(
        [np.tile(np.eye(nf), (n, s, 1)), hAJ[..., nf:].sum(axis=3).reshape(n, s * nf, ns - nf)], axis=2
    )
    solved = linear_solve(G, np.concatenate([left.reshape(n, s * nf, 1), of_begin], axis=2))
    own, along = solved[:, :, 0].reshape(n, s, nf), solved[:, :, 1:].reshape(n, s, nf, ns)
    # from the begin of a step to that of the next one
    last = J[:, -1, nf:]  # of what follows, by states at the end and by where it stood
    end = np.concatenate([own[:, -1], np.einsum("nij,nj->ni", last[..., :nf], own[:, -1])], axis=1)
    through = np.concatenate([along[:, -1], np.einsum("nij,njk->nik", last[..., :nf], along[:, -1])], axis=1)
    through[:, nf:, nf:] += last[..., nf:]
    ended = np.concatenate([x[:, -1, :nf], now[:, -1, nf:]], axis=1)
    end[:-1] += ended[:-1] - begin[1:]
    d0 = np.zeros((n, ns))
    edges = np.append(np.flatnonzero(steps.first[rows]), n)
    lengths = np.diff(edges)
    for k in range(1, int(lengths.max(initial=0))):
        to = edges[:-1][lengths > k] + k
        d0[to] = end[to - 1] + np.einsum("nij,nj->ni", through[to - 1], d0[to - 1])
    change = np.zeros((n, 1 + s, ns))
    change[:, 0] = d0
    change[:, 1:, :nf] = own + np.einsum("nsij,nj->nsi", along, d0)
    return change


def _initial_solution(
    tracks: Sequence[Track],
    going: Sequence[int],
    order: Sequence[int],
    nf: int,
    known: Mapping[int, tuple[_StepSolution, Array]],
) -> _StepSolution:
    """States as the tracks have them; `known`: what was found of runs before so many parts were made of their steps."""
    s, ns = len(RADAU), len(order)
    everything = np.zeros(ns, dtype=bool)
    found = []
    for r in going:
        own = np.array(tracks[r].states)[:, order]
        M = len(own) - 1
        nodes = interpolate(tracks[r], _nodes(tracks[r]), everything)[0][order].T.reshape(-1, s, ns)
        nodes[:, -1] = own[1:]
        nodes[:, :, nf:] = own[:-1, None, nf:]
        at = _StepSolution(own[:-1], nodes, np.zeros((M, s, ns)), np.zeros((M, s, ns, ns)), np.ones(M, dtype=bool))
        if r in known:
            old, parts = known[r]
            whole = parts == 1
            to = (np.cumsum(parts) - parts)[whole]
            at.begin[to], at.x[to], at.now[to], at.J[to], at.new[to] = vars(old.select(whole)).values()
            at.new[to] = False
        found.append(at)
    return _StepSolution(*(np.concatenate(of) for of in zip(*(vars(at).values() for at in found), strict=True)))


def _write(track: Track, network: MovingNetwork, order: Sequence[int], nf: int, at: _StepSolution, rows: Array) -> None:
    """What was found into a track."""
    back, x, now = np.argsort(order), at.x[rows], at.now[rows]
    ends = np.concatenate([x[:, -1, :nf], now[:, -1, nf:]], axis=1)
    rates = np.where(np.arange(len(order)) < nf, now, 0.0)
    h = np.diff(track.time)
    power = np.stack([network.power(x[:, i, back].T, rates[:, i, back].T) for i in range(len(RADAU))])
    work = np.cumsum(h * np.einsum("i,ikn->kn", WEIGHTS[-1], power), axis=1)
    track.states[1:] = list(ends[:, back])
    track.slopes[1:] = list(rates[:, -1, back])
    track.work[1:] = list(work.T)
    track.within = [*rates[:, :-1, back]]


def _nodes(track: Track) -> Array:
    T = np.asarray(track.time)
    return (T[:-1, None] + np.diff(T)[:, None] * RADAU).ravel()


def _make_steps(kept: Sequence[int], course: InputCourse, tracks: Sequence[Track], going: Sequence[int]) -> _Steps:
    """Between corners a step has straight inputs, so that those of its ends will do."""
    run, h, columns, start = [], [], [], []
    for r in going:
        T, X = np.asarray(tracks[r].time), np.stack(tracks[r].unknowns, axis=1)[kept]
        run.append(np.full(len(T) - 1, r))
        h.append(np.diff(T))
        own = slice(course.first[r], course.last[r] + 1)
        at_ends = {c: np.interp(T, course.time[own], v[own]) for c, v in course.columns.items()}
        columns.append({c: np.stack([v[:-1], v[1:]], axis=1) for c, v in at_ends.items()})
        start.append(np.stack([X[:, :-1], X[:, 1:]], axis=2))
    table = {c: np.concatenate([of[c] for of in columns]) for c in course.columns}
    runs = np.concatenate(run)
    return _Steps(runs, np.concatenate(h), np.diff(runs, prepend=-1) > 0, table, np.concatenate(start, axis=1))


def _rates(of: _Run, x: Array, rows: Array, shares: Array, wrt: bool = True) -> tuple[Array, Array]:
    """At `shares` (n, s) of some steps: rates of states x (n, s, ns), or, of those that follow, what they are (n, s,
    ns), and their derivatives by the states as they are given (n, s, ns, ns)."""
    given, states, steps = of.given, of.states, of.steps
    n, s, ns = x.shape
    values = {c: (v[rows, :1] + (v[rows, 1:] - v[rows, :1]) * shares).ravel() for c, v in steps.inputs.items()}
    values |= dict(zip((state.fixed_leaf for state in states), x.reshape(-1, ns).T, strict=True))
    values[ELAPSED] = (steps.h[rows, None] * shares).ravel()
    parameters = {**of.theta, **{c: v for c, v in values.items() if c in given.parameters}}
    points = {c: v for c, v in {**of.theta, **values}.items() if c not in given.parameters}
    columns, along = (
        tuple(state.model_column for state in states),
        tuple(state.fixed_leaf for state in states) if wrt else (),
    )
    start = steps.start[:, rows, :1] + (steps.start[:, rows, 1:] - steps.start[:, rows, :1]) * shares
    p = given.solved(points, parameters, n * s, columns, along, start.reshape(len(start), -1))
    if not wrt:
        return p.y.reshape(n, s, ns), np.empty(0)
    per = np.array([state.per_given for state in states])
    return p.y.reshape(n, s, ns), (p.jacobian * per).reshape(n, s, ns, ns)


BETWEEN = 8
"""Points of each step at which what is remembered of readings is followed, beside the records: a probe then errs by a
hundredth of what the gas bends within a step."""


class FlightSolution(NamedTuple):
    """What is known of an engine at N records: states (ns, N), the time since the beginning of the step and the moment
    on the tape of the run, (ns + 2, N) in all, and unknowns (nx, N), NaN where it did not get; `lost`: why it did
    not; `loose`: states of its run are only as exact as error-controlled steps are."""

    states: Array
    unknowns: Array
    lost: Any = ""
    loose: Any = False

    def select(self, piece: slice) -> FlightSolution:
        """Of the records `piece`."""
        lost, loose = (np.asarray(x)[piece] for x in (self.lost, self.loose))
        return FlightSolution(self.states[:, piece], self.unknowns[:, piece], lost, loose)


class MovingEngine:
    """`engine` with its states; `varied`: parameters that flights change. Raises ValueError for a power setting that
    says what a state is to be, for what cannot be followed along time and for what is stated twice."""

    def __init__(self, engine: Engine, tolerance: float = TOLERANCE, varied: Sequence[str] = ()):
        self.engine, self.tolerance = engine, tolerance
        network = engine.network
        self.states = transient_states(engine, varied)
        self._follows = np.array([s.follows for s in self.states], dtype=bool)
        # an inertia that a term gives is the rotor's now
        turning = [s for s in self.states if isinstance(s, RotorState)]
        self._theirs = {
            n: absent
            for m in remembered(engine, varied)
            for s in turning
            if s.represents(m)
            for n, absent in m.absent.items()
        }
        self.network = MovingNetwork(network, self.states)
        held = network.governor.aim if network.governor is not None else None
        shaft = network.speed_columns.get(held.column, "") if held is not None else ""
        if held is not None and shaft in self.network.rotors and not held.lead_s:
            raise ValueError(
                f"{engine.name}: {held.owner} is to hold {held.column} at once, which no fuel can with an inertia; "
                "give it lead_s, in seconds, for its time constant"
            )
        given = network.power_leaf or ""
        for rotor in self.network.rotors.values():
            if given == f"{rotor.shaft}.speed_rpm":
                raise ValueError(
                    f"{engine.name}: {engine.power_setting} as power setting says how fast {rotor.shaft} turns, so "
                    "that its inertia has nothing to move; let a fuel control meet it (`controls:` with actuator fuel "
                    "and lead_s)"
                )
        at_records = Engine(FixedStateNetwork(network, self.states), engine.declared, engine.path)
        known = {**engine.changed_nominals, **self._theirs}
        self._given = at_records.replace_nominals({n: v for n, v in known.items() if n in at_records.parameters})

    def fly(self, flights: Sequence[TransientInputs]) -> list[FlightSolution]:
        """What is known at the records of each flight; each begins in its steady state. All flights have the same
        columns."""
        found = []
        for track, flight in zip(self.tracks(flights), flights, strict=True):
            states, unknowns = interpolate(track, flight.records, self._follows)
            moment = self._moments(track, flight)
            loose = bool(self.network.states) and len(track.time) > 1 and not track.exact
            found.append(FlightSolution(np.vstack([states, moment]), unknowns, _failure(track), loose))
        return found

    def tracks(self, flights: Sequence[TransientInputs]) -> list[Track]:
        """The same step by step."""
        found, course, theta = self.integrated(flights)
        made_exact(self._given, self.network, course, theta, found)
        return found

    def integrated(self, flights: Sequence[TransientInputs]) -> tuple[list[Track], InputCourse, dict[str, Any]]:
        """Runs as error-controlled steps leave them, what they were asked for, and parameters that hold throughout."""
        engine = self.engine
        inputs = (*engine.inputs, *engine.optional_inputs)
        first = {c: np.array([f.columns[c][0] for f in flights]) for c in flights[0].columns}
        begin = engine.predict(
            {c: v for c, v in first.items() if c in inputs},
            {c: v for c, v in first.items() if c not in inputs},
            sensors=(),
        )
        course = make_course([network_inputs(engine, f) for f in flights])
        points = {c: v[course.first] for c, v in course.columns.items()}
        defaults = {**engine.nominal, **engine.optional_inputs, **self._theirs}
        theta = {n: v for n, v in defaults.items() if n not in points}
        x = np.where(begin.ok, begin.x, np.nan)
        found = integrate(self.network, course, theta, x, self._steady(points, theta, x), self.tolerance)
        for r in np.flatnonzero(~begin.ok).tolist():
            found[r].why = begin.reason(r)
        return found, course, theta

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any],
        flown: FlightSolution,
        *,
        sensors: Sequence[str],
        also: Sequence[str] = (),
    ) -> Prediction:
        """What the engine shows at records, from what is known of them."""
        states, unknowns, lost = flown.states, flown.unknowns, flown.lost
        names = [u.name for u in self.network.unknowns()]
        start = unknowns[[names.index(u.name) for u in self._given.unknowns]]
        given = dict(zip((*(s.fixed_leaf for s in self.states), ELAPSED, MOMENT), states, strict=True))
        if MOMENT not in self._given.optional_inputs:
            del given[MOMENT]
        found = self._given.predict({**inputs, **given}, parameters, sensors=sensors, start=start, also=also)
        away = np.flatnonzero(np.isnan(states[len(self.states)]))
        if not away.size:
            return found
        why = np.broadcast_to(np.asarray(lost), (states.shape[1],))
        status = found.status.copy()
        status[away] = NOT_CONVERGED
        reasons = {k: found.reason(k) for k in np.flatnonzero(status).tolist()}
        return replace(found, status=status, _reasons=reasons | {k: str(why[k]) for k in away.tolist()})

    def _moments(self, track: Track, flight: TransientInputs) -> Array:
        """Where the records of a flight (N,) stand on the tape of its run, the past that readings lag behind; NO_MOMENT
        where nothing is remembered, or the run did not get."""
        moment = np.full(len(flight.records), NO_MOMENT)
        if not self._given.network.memories or not track.time:
            return moment
        ends = np.asarray(track.time)
        reached = flight.records <= ends[-1]
        within = np.interp(np.arange(BETWEEN * (len(ends) - 1) + 1) / BETWEEN, np.arange(len(ends)), ends)
        time = np.union1d(within, np.concatenate([flight.time[flight.time <= ends[-1]], flight.records[reached]]))
        states, _ = interpolate(track, time, self._follows)
        columns = {c: np.interp(time, flight.time, v) for c, v in flight.columns.items()}
        columns |= dict(zip((*(s.fixed_leaf for s in self.states), ELAPSED), states, strict=True))
        on_tape = self._given.tapes.add({**columns, "time_s": time})
        moment[reached] = on_tape[np.searchsorted(time, flight.records[reached])]
        return moment

    def _steady(self, points: Mapping[str, Any], theta: Mapping[str, Any], x: Array) -> Array:
        """States (ns, R) of steady solutions with unknowns x (nx, R)."""
        e = solver.evaluate(self.engine.network, points, theta, x, frozenset())
        return np.reshape([np.broadcast_to(value(s.value(e)), (x.shape[1],)) for s in self.states], (-1, x.shape[1]))


def _failure(track: Track) -> str:
    if track.stopped == np.inf:
        return ""
    if track.stopped == -np.inf:
        return f"it cannot stand still where its flight begins: {track.why}"
    return f"there is no way beyond {track.stopped:.2f} s: {track.why}; ask for less, or more slowly"
