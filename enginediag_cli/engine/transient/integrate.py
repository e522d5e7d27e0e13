"""Integration of the states of many engines along time, each with steps of its own, under error control.

A step never crosses a corner of the inputs. Fast modes that have settled allow long steps; a limit that takes over
bends the course, and the error estimate shortens the steps there.

The method is a singly diagonally implicit Runge–Kutta method of third order with a second-order error estimate. Every
stage is one solve of the network with one more term in the balances, x − base = γ h f(x): it takes as long as a solve
of the steady engine and is as robust. The method is L-stable, so that fast modes (a valve, a probe) do not bound the
step. Its last stage is the end of the step, so that an engine at rest is on its steady solution.

Stages are solved by Newton iteration. Jacobians are kept from stage to stage and step to step, and every pass corrects
them (C. G. Broyden, Math. Comp. 19 (1965) 577–593). Between the ends of steps, states are interpolated from their
slopes at the ends and at nodes within.

Source: ESDIRK3(2)4L[2]SA, C. A. Kennedy and M. H. Carpenter, Appl. Numer. Math. 44 (2003) 139–181, appendix C
(the implicit part of ARK3(2)4L[2]SA).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.solver import LARGEST_STEP, SMALL
from enginediag_cli.engine.solver import TOLERANCE as EFFORT_TOLERANCE
from enginediag_cli.engine.transient.states import ELAPSED, STEP, InputCourse, MovingNetwork

GAMMA = 0.4358665215084589994160194
"""Weight of a stage's own derivative: the root of γ³ − 3γ² + 3γ/2 − 1/6 at which the method is L-stable."""
NODES = np.array([0.0, 2.0 * GAMMA, 0.6, 1.0])
"""Where the stages are, of the step."""


def _stages() -> np.ndarray:
    """Weights of the derivatives in each stage, from the conditions of order: Σ b = 1, Σ b c = 1/2, Σ b c² = 1/3, and
    stages of order two, Σ a c = c²/2."""
    c = NODES
    third = (c[2] ** 2 / 2.0 - GAMMA * c[2]) / c[1]
    A = np.zeros((4, 4))
    A[1, :2] = GAMMA
    A[2, :3] = c[2] - third - GAMMA, third, GAMMA
    rest = np.array([1.0 - GAMMA, 0.5 - GAMMA, 1.0 / 3.0 - GAMMA])
    A[3] = *np.linalg.solve(np.vander(c[:3], increasing=True).T, rest), GAMMA
    return A


STAGES = _stages()
"""Weights of the derivatives in each stage; the first stage is the beginning of the step, the last one its end."""
EMBEDDED = np.array(
    [
        2756255671327 / 12835298489170,
        -10771552573575 / 22201958757719,
        9247589265047 / 10645013368117,
        2193209047091 / 5459859503100,
    ]
)
"""Weights of the method of second order that estimates the error."""
ORDER = 3
"""Of the local error: it grows with this power of the step."""


def matrix(e: Evaluation, rows: Mapping[str, Value], names: tuple[str, ...]) -> Array:
    """Derivatives of `rows` with respect to leaves `names`, shape (N, rows, names)."""
    return np.ascontiguousarray(solver.directed(e, rows, names).transpose(2, 0, 1))


def values_and_jacobian(
    network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array
) -> tuple[Array, Array]:
    """Balances (nx, n) and their derivatives (n, nx, nx): exact, or for a few points by forward differences
    in one widened batch, which costs one plain pass where the overhead of calls dominates."""
    nx, n = x.shape
    if n <= solver.FEW_POINTS:
        h = solver.DIFFERENCE * np.maximum(np.abs(x), SMALL)
        wide = np.repeat(x[:, None, :], nx + 1, axis=1)
        wide[np.arange(nx), np.arange(1, nx + 1)] += h
        tile, theta = solver.repeated(inputs, nx + 1), solver.repeated(parameters, nx + 1)
        e = solver.evaluate(network, tile, theta, wide.reshape(nx, -1), frozenset())
        R = solver.balances(e).reshape(-1, nx + 1, n)
        with np.errstate(invalid="ignore", over="ignore"):
            return R[:, 0], np.ascontiguousarray(((R[:, 1:] - R[:, :1]) / h).transpose(2, 0, 1))
    names = tuple(u.name for u in network.unknowns())
    e = solver.evaluate(network, inputs, parameters, x, frozenset(names))
    return solver.balances(e), matrix(e, e.balances, names)


def linear_solve(A: Array, B: Array) -> Array:
    """A⁻¹ B for stacks (n, k, k), (n, k, m); a matrix that is exactly singular or not finite gives NaN in its
    own rows only."""
    try:
        return np.linalg.solve(A, B)
    except np.linalg.LinAlgError:
        bad = ~(np.abs(np.linalg.det(A)) > 0.0)
        solved = np.linalg.solve(np.where(bad[:, None, None], np.eye(A.shape[1]), A), B)
        return np.where(bad[:, None, None], np.nan, solved)


SLOW = 0.2
"""A pass that leaves more than this share of the residual needs a new Jacobian."""
STEP_CHANGE = 1.3
"""So does a step that is as many times as long, or as short, as the one whose Jacobian is kept. Judgement."""
LEAST_SHOWN = 0.1
"""A move that changed less than this of what the kept Jacobian says corrects nothing."""
SHARE = 1e-3
"""Of the error that a step may have, what the iteration of its stages may leave."""
CAREFUL = 3.0
"""Times the pace of the last stage is what a first move is trusted to be followed at."""
STEADY_PACE = 0.5
"""A move that is shorter than the last one by less does not show how short the next will be."""
SHORT_S = 0.1
"""Stages shorter than this take smaller differences of speeds, in proportion."""
PASSES = 20
"""With kept Jacobians; what has not converged then goes the way of the steady engine's solver."""


@dataclass
class StageSolution:
    """Unknowns (nx, n), states (ns, n) and whether the stage was solved (n,)."""

    x: Array
    states: Array
    good: Array


class Stages:
    """Of N engines, to `SHARE` of a step's `tolerance`; keeps the inverse of each one's last Jacobian and its step."""

    def __init__(self, network: MovingNetwork, size: int, tolerance: float):
        self.network = network
        nx = len(network.unknowns())
        self._inverse = np.full((size, nx, nx), np.nan)
        self._step = np.full(size, np.nan)
        self._pace = np.ones(size)  # how much shorter each one's moves became, last
        self._lower = np.array([[u.lower] for u in network.unknowns()])
        self._upper = np.array([[u.upper] for u in network.unknowns()])
        speeds = {f"{shaft}.corrected_speed" for shaft in network.rotors}
        self._turns = np.array([u.name in speeds for u in network.unknowns()])
        self._names = [u.name for u in network.unknowns()]
        self.left = SHARE * tolerance
        self.missed: dict[int, str] = {}  # engine → the balance that its last stage without a solution missed
        self.passes = 0

    def solve(
        self, rows: Array, inputs: Mapping[str, Value], theta: Mapping[str, Value], x: Array, *, fresh: bool
    ) -> StageSolution:
        """Of engines `rows` (n,), from unknowns x (nx, n); `inputs` hold base and step of the stage too. `fresh`: with
        new Jacobians from the start, as every step begins, so that an engine goes its way whatever its batch is."""
        n = len(rows)
        step = np.asarray(inputs[STEP])
        with np.errstate(invalid="ignore"):
            ratio = step / self._step[rows]
        stale = ~((ratio < STEP_CHANGE) & (ratio > 1.0 / STEP_CHANGE)) | fresh
        found = StageSolution(x.copy(), np.zeros((len(self.network.states), n)), np.zeros(n, dtype=bool))
        at, now = np.arange(n), x.copy()
        residual, length = np.full(n, np.inf), np.full(n, np.inf)
        came: tuple[Array, Array] | None = None  # how far the last pass moved (nx, n), and from which residuals
        for _ in range(PASSES):
            renewed = stale[at]
            whole = len(at) == n
            u, t = (inputs, theta) if whole else (solver.take(inputs, at), solver.take(theta, at))
            e, R, J = self._pass(u, t, now, renewed)
            if J is not None:
                self._inverse[rows[at[renewed]]] = _inverse(J)
                self._step[rows[at[renewed]]] = step[at[renewed]]
            self.passes += len(at)
            if came is not None:
                self._correct(rows[at], came[0], R - came[1], ~renewed)
            size = np.where(np.isfinite(R), np.abs(R), np.inf).max(axis=0)
            # where another limit acts the Jacobian is another one: it is made there before anything moves
            slow = size > SLOW * residual[at]
            waits = slow & ~renewed
            stale[at] = slow
            residual[at] = size
            with np.errstate(invalid="ignore"):
                move = -np.einsum("nij,jn->in", self._inverse[rows[at]], R)
                far = np.max(np.abs(move) / np.maximum(np.abs(now), SMALL), axis=0)
                begun = np.isfinite(length[at])
                pace = np.where(begun, far / length[at], np.minimum(CAREFUL * self._pace[rows[at]], 1.0))
                pace[renewed] = 1.0  # nobody has seen it yet
            self._pace[rows[at[begun]]] = pace[begun]
            move[:, waits] = 0.0
            move *= np.minimum(1.0, LARGEST_STEP / np.maximum(far, 1e-300))
            then = np.clip(now + move, self._lower, self._upper)
            usable = np.isfinite(then).all(axis=0)
            # what the moves after this one will add up to, going on at this pace
            done = usable & ~waits & ((size <= EFFORT_TOLERANCE) | ((pace < STEADY_PACE) & (pace * far < self.left)))
            if done.any():
                k = at[done]
                found.x[:, k], found.good[k] = then[:, done], True
                for i, state in enumerate(self.network.states):
                    reached = np.broadcast_to(value(state.value(e)), (e.size,))[: len(at)]
                    found.states[i, k] = state.extrapolate(reached, self._names, now, then)[done]
            length[at] = far
            going = usable & ~done
            came = then[:, going] - now[:, going], R[:, going]
            at, now = at[going], then[:, going]
            if not at.size:
                break
        self._solve_damped(rows, inputs, theta, x, found)
        return found

    def _pass(
        self, u: Mapping[str, Value], t: Mapping[str, Value], x: Array, renewed: Array
    ) -> tuple[Evaluation, Array, Array | None]:
        """An evaluation at x (nx, n), its balances (nx, n), and the Jacobians of those that are `renewed` (n,)."""
        n = x.shape[1]
        if renewed.all() and n > solver.FEW_POINTS:
            names = tuple(self._names)
            e = solver.evaluate(self.network, u, t, x, frozenset(names))
            return e, solver.balances(e), matrix(e, e.balances, names)
        if not renewed.any():
            e = solver.evaluate(self.network, u, t, x, frozenset())
            return e, solver.balances(e), None
        k = np.flatnonzero(renewed)
        if n > solver.FEW_POINTS:
            e = solver.evaluate(self.network, u, t, x, frozenset())
            _, J = values_and_jacobian(self.network, solver.take(u, k), solver.take(t, k), x[:, k])
            return e, solver.balances(e), J
        # one pass for all: the points first, then those that are renewed, a little further along each unknown
        nx, h = len(x), solver.DIFFERENCE * np.maximum(np.abs(x[:, k]), SMALL)
        # a speed that moves a little in a short stage is a large acceleration, and may bring another limit into play
        short = np.minimum(1.0, np.broadcast_to(np.asarray(u[STEP]), (n,))[k] / SHORT_S)
        h = np.where(self._turns[:, None], h * short, h)
        index = np.concatenate([np.arange(n), np.tile(k, nx)])
        wide = x[:, index]
        wide[np.repeat(np.arange(nx), len(k)), np.arange(n, len(index))] += h.ravel()
        e = solver.evaluate(self.network, solver.take(u, index), solver.take(t, index), wide, frozenset())
        R = solver.balances(e)
        with np.errstate(invalid="ignore", over="ignore"):
            slopes = (R[:, n:].reshape(nx, nx, len(k)) - R[:, None, k]) / h
        return e, R[:, :n], np.ascontiguousarray(slopes.transpose(2, 0, 1))

    def _correct(self, rows: Array, moved: Array, changed: Array, which: Array) -> None:
        """The kept inverses of engines `rows` (n,) that are of `which` (n,), so that they explain how balances
        `changed` (nx, n) when unknowns `moved` (nx, n)."""
        k = np.flatnonzero(which & np.isfinite(changed).all(axis=0))
        if not k.size:
            return
        H, s = self._inverse[rows[k]], moved[:, k].T
        Hy = np.einsum("nij,jn->ni", H, changed[:, k])
        sH = np.einsum("ni,nij->nj", s, H)
        size = np.einsum("ni,ni->n", s, Hy)
        good = np.abs(size) > LEAST_SHOWN * np.einsum("ni,ni->n", s, s)
        gain = (s - Hy)[good] / size[good, None]
        self._inverse[rows[k[good]]] = H[good] + gain[:, :, None] * sH[good][:, None, :]

    def _solve_damped(
        self,
        rows: Array,
        inputs: Mapping[str, Value],
        theta: Mapping[str, Value],
        x: Array,
        found: StageSolution,
    ) -> None:
        """What did not converge, by damped Newton iteration with all its Jacobians."""
        bad = np.flatnonzero(~found.good)
        if not bad.size:
            return
        u, t = solver.take(inputs, bad), solver.take(theta, bad)
        solved = solver.newton(self.network, u, t, x[:, bad])
        good = solved.converged
        if not good.all():
            balances = tuple(solver.evaluate(self.network, u, t, solved.x, frozenset()).balances)
            for k in np.flatnonzero(~good).tolist():
                self.missed[int(rows[bad[k]])] = f"{balances[solved.worst(k)]} cannot be met"
        self._step[rows[bad]] = np.nan
        if good.any():
            e = solver.evaluate(self.network, u, t, solved.x, frozenset())
            states = [np.broadcast_to(value(s.value(e)), (len(bad),)) for s in self.network.states]
            found.x[:, bad[good]], found.good[bad[good]] = solved.x[:, good], True
            found.states[:, bad[good]] = np.reshape(states, (-1, len(bad)))[:, good]


def _inverse(J: Array) -> Array:
    return linear_solve(J, np.broadcast_to(np.eye(J.shape[1]), J.shape))


RADAU = np.array([(4.0 - 6.0**0.5) / 10.0, (4.0 + 6.0**0.5) / 10.0, 1.0])
"""Nodes of Radau's method of fifth order, of a step."""
_CUBIC = np.linalg.inv(np.append(0.0, RADAU)[:, None] ** np.arange(4))
"""Coefficients (degree, node) of the cubic through values at the beginning and at the nodes."""


def cubic(share: Array | float, h: Array, ends: tuple[Array, Array], slopes: tuple[Array, Array]) -> Array:
    """On the cubic through both ends of a step with their slopes, at a share of its length."""
    s = share
    value = ends[0] * ((1.0 + 2.0 * s) * (1.0 - s) ** 2) + ends[1] * (s**2 * (3.0 - 2.0 * s))
    return value + h * (slopes[0] * (s * (1.0 - s) ** 2) - slopes[1] * (s**2 * (1.0 - s)))


def quartic(share: Array, h: Array, begin: Array, slopes: Array) -> Array:
    """From `begin` (ns, n) along slopes (4, ns, n) at the beginning and at the nodes, at a share (n,) of the step. At
    its end that is the end of the method, whose weights integrate the cubic through the slopes exactly."""
    power = np.arange(1, 5)[:, None]
    rates = np.einsum("dj,jkn->dkn", _CUBIC, slopes)
    return np.asarray(begin + h * np.einsum("dkn,dn->kn", rates, share**power / power))


def slope(share: Array, slopes: Array) -> Array:
    """Of the same curve (ns, n)."""
    return np.asarray(np.einsum("dj,jkn,dn->kn", _CUBIC, slopes, share ** np.arange(4)[:, None]))


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


def _initial(course: InputCourse, x: Array, states: Array) -> _Now:
    """Each run at its first corner, with unknowns x (nx, R) and states (ns, R) that have not changed before."""
    return _Now(
        course.time[course.first].copy(),
        course.first.copy(),
        np.full(x.shape[1], FIRST_STEP_S),
        states.copy(),
        np.zeros_like(states),
        np.zeros_like(states),
        x.copy(),
        [(np.full(x.shape[1], s), x.copy()) for s in (-1.0, -0.5)],
    )


def integrate(
    network: MovingNetwork,
    course: InputCourse,
    theta: Mapping[str, Value],
    x: Array,
    states: Array,
    tolerance: float = TOLERANCE,
) -> list[Track]:
    """All runs of a course, from steady unknowns x (nx, R) and states (ns, R); runs whose states are not finite do not
    move. `theta`: parameters that hold throughout, numbers or (R,)."""
    R = x.shape[1]
    now = _initial(course, x, states)
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
    course: InputCourse,
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
        inputs: dict[str, Value] = dict(course.evaluate(now.corner[at], now.time[at] + NODES[i] * h))
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


def interpolate(track: Track, time: Array, follows: Array) -> tuple[Array, Array]:
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


def state_slopes(track: Track, time: Array) -> Array:
    """How fast states change (ns, n) at `time` (n,) of a run that has derivatives within its steps."""
    T, F = np.asarray(track.time), np.stack(track.slopes, axis=1)
    k = np.clip(np.searchsorted(T, time, side="left") - 1, 0, len(T) - 2)
    inner = np.stack(track.within)[k].transpose(1, 2, 0)
    share = (time - T[k]) / (T[k + 1] - T[k])
    return slope(share, np.concatenate([F[None, :, k], inner, F[None, :, k + 1]]))
