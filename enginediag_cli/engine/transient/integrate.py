"""Moves the states of many engines along time, each at steps of its own, as long as its error allows.

A step never crosses a corner of what the engine is asked for. What settles is left to long steps; a limit that takes
over bends the course, and the error asks for short ones there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.transient.course import Course
from enginediag_cli.engine.transient.dense import cubic, quartic, slope
from enginediag_cli.engine.transient.networks import MovingNetwork
from enginediag_cli.engine.transient.stages import Stages
from enginediag_cli.engine.transient.state import ELAPSED, STEP
from enginediag_cli.engine.transient.tableau import EMBEDDED, GAMMA, NODES, ORDER, STAGES

TOLERANCE = 1e-6
"""Error of a step, of the size of each state: a tenth of what the best speed pick-up can show."""
FIRST_STEP_S = 0.05
"""Step at the beginning, from which the error finds its way."""
SHORTEST_S = 1e-7
"""A step that must be shorter leads nowhere."""
SAFETY, LEAST, MOST = 0.9, 0.2, 5.0
"""Of the step that the error allows, and how far a step may be from the last one. Hairer and Wanner, Solving Ordinary
Differential Equations II, ch. IV.8."""
REFUSED = 0.25
"""Of a step whose stages have no solution."""


@dataclass
class Track:
    """What was found of each run: at its steps' ends `time` (k,), states, their derivatives (ns, k), unknowns (nx,
    k) and the energy (ns, k) [J] that each state has taken up since the beginning, summed as the states are;
    `within`: derivatives (2, ns) at the inner nodes of each step, where they are known;
    `stopped`: when there was no way on, else infinite, and `why` that was; `exact`: whether states are on the solution
    of the whole run, and not as error-controlled steps leave them."""

    time: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    slopes: list[Array] = field(default_factory=list)
    unknowns: list[Array] = field(default_factory=list)
    work: list[Array] = field(default_factory=list)
    within: list[Array] = field(default_factory=list)
    stopped: float = np.inf
    why: str = ""
    exact: bool = False


@dataclass
class _Now:
    """Where the runs stand (R,), and what their next steps begin with."""

    time: Array
    corner: Array
    step: Array
    states: Array
    slopes: Array
    work: Array
    x: Array
    past: list[tuple[Array, Array]]  # seconds before now (R,), and unknowns (nx, R) there, of the last step


def integrate(
    network: MovingNetwork,
    course: Course,
    theta: Mapping[str, Value],
    x: Array,
    states: Array,
    tolerance: float = TOLERANCE,
) -> list[Track]:
    """All runs of a course, from steady unknowns x (nx, R) and states (ns, R); runs whose states are not finite do not
    move. `theta`: parameters that hold throughout, numbers or (R,)."""
    R = x.shape[1]
    now = _Now(
        course.time[course.first].copy(),
        course.first.copy(),
        np.full(R, FIRST_STEP_S),
        states.copy(),
        np.zeros_like(states),
        np.zeros_like(states),
        x.copy(),
        [(np.full(R, s), x.copy()) for s in (-1.0, -0.5)],  # it has stood still
    )
    tracks = [Track() for _ in range(R)]
    going = np.isfinite(states).all(axis=0) & np.isfinite(x).all(axis=0)
    for r in range(R):
        if going[r]:
            _note(tracks[r], now, r)
        else:
            tracks[r].stopped = -np.inf
    stages = Stages(network, R, tolerance)
    floor = np.maximum(np.abs(states), 1e-12)
    allowed = tolerance * np.reshape([s.coarser for s in network.states], (-1, 1))
    while going.any():
        at = np.flatnonzero(going)
        end = course.time[now.corner[at] + 1]
        left = end - now.time[at]
        h = np.minimum(now.step[at], left)
        h = np.where(left - h < 0.1 * h, left, h)  # no crumbs
        step = _step(network, course, theta, stages, now, at, h)
        error = np.abs(step.error) / (allowed * np.maximum(np.abs(now.states[:, at]), floor[:, at]))
        size = np.where(step.good, error.max(axis=0, initial=0.0), np.inf)
        taken = size <= 1.0
        with np.errstate(divide="ignore"):
            factor = np.clip(SAFETY * size ** (-1.0 / ORDER), LEAST, MOST)
        factor = np.where(np.isfinite(size), factor, REFUSED)
        ok = at[taken]
        for (ago, unknowns), (share, stage) in zip(now.past, step.on_the_way, strict=True):
            ago[ok], unknowns[:, ok] = (share - 1.0) * h[taken], stage[:, taken]
        now.x[:, ok], now.states[:, ok], now.slopes[:, ok] = (v[:, taken] for v in (step.x, step.states, step.slopes))
        now.work[:, ok] += step.work[:, taken]
        reached = taken & (h >= left)
        now.time[ok] += h[taken]
        now.time[at[reached]] = end[reached]
        now.corner[at[reached]] += 1
        # a step that a corner cut short says little of how long the next may be
        cut = taken & (h < now.step[at])
        now.step[at] = np.where(cut, np.maximum(now.step[at], h * factor), h * factor)
        for k in np.flatnonzero(taken).tolist():
            _note(tracks[at[k]], now, at[k])
        lost = ~taken & (now.step[at] < SHORTEST_S)
        for r in at[lost].tolist():
            tracks[r].stopped = float(now.time[r])
            tracks[r].why = stages.missed.get(r, "") or "it changes too fast to be followed"
        going[at[lost]] = False
        going[at[now.corner[at] >= course.last[at]]] = False
    return tracks


@dataclass
class _Step:
    x: Array
    states: Array
    slopes: Array
    work: Array
    error: Array
    good: Array
    on_the_way: list[tuple[float, Array]]  # share of the step, and unknowns (nx, n) there


def _step(
    network: MovingNetwork,
    course: Course,
    theta: Mapping[str, Value],
    stages: Stages,
    now: _Now,
    at: Array,
    h: Array,
) -> _Step:
    """One step of length h (n,) of the runs `at` (n,)."""
    passed = now.states[:, at]
    begun, f = now.states[:, at], [now.slopes[:, at]]
    t = solver.take(theta, at)
    known = [(ago[at] / h, unknowns[:, at]) for ago, unknowns in now.past]
    known.append((np.zeros_like(h), now.x[:, at]))
    taken_up = [network.power(begun, f[0])]
    x, states, good = now.x[:, at], begun, np.ones(len(at), dtype=bool)
    follows = np.reshape([s.follows for s in network.states], (-1, 1)).astype(bool)
    on = [begun]
    for i in range(1, len(NODES)):
        base = np.where(follows, begun, begun + h * sum(a * d for a, d in zip(STAGES[i], f, strict=False)))
        inputs: dict[str, Value] = dict(course.at(now.corner[at], now.time[at] + NODES[i] * h))
        inputs[STEP], inputs[ELAPSED] = GAMMA * h, NODES[i] * h
        for state, b in zip(network.states, base, strict=True):
            inputs[state.base] = b
        guess = _through(known[-3:], np.full_like(h, NODES[i]))
        solved = stages.solve(at, inputs, t, guess, fresh=i == 1)
        passed = states if i == len(NODES) - 1 else passed
        x, states, good = solved.x, solved.states, good & solved.good
        f.append((states - base) / (GAMMA * h))
        known.append((np.full_like(h, NODES[i]), x))
        on.append(states)
        taken_up.append(network.power(states, f[-1]))
    work = h * sum(b * p for b, p in zip(STAGES[-1], taken_up, strict=True))
    error = h * sum((a - b) * d for a, b, d in zip(STAGES[-1], EMBEDDED, f, strict=True))
    # of the same order and size, but where one of the two happens to vanish the other does not
    beside = cubic(NODES[-2], h, (begun, states), (f[0], f[-1])) - passed
    error = np.maximum(np.abs(error), np.abs(beside))
    order = np.argsort(NODES)
    times = NODES[order, None] * h
    for k, state in enumerate(network.states):
        if state.follows:
            error[k] = state.overrun(times, np.stack([on[i][k] for i in order]), {**t, **inputs})
    way = [(0.0, now.x[:, at]), (NODES[2], known[-2][1])]
    return _Step(x, states, f[-1], work, error, good & np.isfinite(error).all(axis=0), way)


def _through(known: list[tuple[Array, Array]], share: Array) -> Array:
    """Unknowns (nx, n) on the curve through those `known` at other shares of the step."""
    total = np.zeros_like(known[0][1])
    for i, (a, x) in enumerate(known):
        weight = np.ones_like(share)
        for j, (b, _) in enumerate(known):
            if i != j:
                weight = weight * (share - b) / (a - b)
        total = total + weight * x
    return total


def _note(track: Track, now: _Now, r: int) -> None:
    track.time.append(float(now.time[r]))
    track.states.append(now.states[:, r].copy())
    track.slopes.append(now.slopes[:, r].copy())
    track.work.append(now.work[:, r].copy())
    track.unknowns.append(now.x[:, r].copy())


def between(track: Track, time: Array, follows: Array) -> tuple[Array, Array]:
    """States and unknowns (nx, n) of a run at `time` (n,). States (ns + 1, n): between the ends of steps with their
    derivatives; what `follows` (ns,) as it was at the beginning of the step; last, the time since then. Straight
    for the unknowns, which are only a start. NaN where the run does not reach."""
    T = np.asarray(track.time)
    S, F, X = (np.stack(v, axis=1) for v in (track.states, track.slopes, track.unknowns))
    if len(T) == 1:
        alone = np.vstack([np.repeat(S, len(time), axis=1), np.zeros(len(time))])
        return alone, np.repeat(X, len(time), axis=1)
    k = np.clip(np.searchsorted(T, time, side="right") - 1, 0, len(T) - 2)
    h = T[k + 1] - T[k]
    s = (time - T[k]) / h
    ends = S[:, k], S[:, k + 1]
    if track.within:
        inner = np.stack(track.within)[k].transpose(1, 2, 0)
        states = quartic(s, h, ends[0], np.concatenate([F[None, :, k], inner, F[None, :, k + 1]]))
    else:
        states = cubic(s, h, ends, (F[:, k], F[:, k + 1]))
    states = np.vstack([np.where(follows[:, None], S[:, k], states), time - T[k]])
    unknowns = X[:, k] + (X[:, k + 1] - X[:, k]) * s
    out = time > T[-1]
    states[:, out] = np.nan
    return states, unknowns


def slopes_at(track: Track, time: Array) -> Array:
    """How fast states change (ns, n) at `time` (n,) of a run that has derivatives within its steps."""
    T, F = np.asarray(track.time), np.stack(track.slopes, axis=1)
    k = np.clip(np.searchsorted(T, time, side="left") - 1, 0, len(T) - 2)
    inner = np.stack(track.within)[k].transpose(1, 2, 0)
    share = (time - T[k]) / (T[k + 1] - T[k])
    return slope(share, np.concatenate([F[None, :, k], inner, F[None, :, k + 1]]))
