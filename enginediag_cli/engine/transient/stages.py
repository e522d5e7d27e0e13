"""Solves the stages of a step: Newton iteration with Jacobians that are kept from stage to stage and step to step, and
that every pass corrects by what it showed (C. G. Broyden, Math. Comp. 19 (1965) 577–593)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.effort import TOLERANCE
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.open_points import LARGEST_STEP, SMALL
from enginediag_cli.engine.transient.jacobian import linear_solve, matrix, values_and_jacobian
from enginediag_cli.engine.transient.networks import MovingNetwork
from enginediag_cli.engine.transient.state import STEP

SLOW = 0.2
"""A pass that leaves more than this of the residual asks for a new Jacobian."""
STEP_CHANGE = 1.3
"""So does a step that is as many times as long, or as short, as the one whose Jacobian is kept. Judgement."""
LEAST_SHOWN = 0.1
"""A move that changed less than this of what the kept Jacobian says corrects nothing."""
SHARE = 1e-3
"""Of the error that a step may have, what the iteration of its stages may leave."""
CAREFUL = 3.0
"""Times the pace of the last stage is what a first move is trusted to be followed at."""
STEADY_PACE = 0.5
"""A move that is shorter than the last one by less tells nothing of how short the next will be."""
SHORT_S = 0.1
"""Stages shorter than this take smaller differences of speeds, in proportion."""
PASSES = 20
"""With kept Jacobians; what has not converged then goes the way of the steady engine's solver."""


@dataclass
class Solved:
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
    ) -> Solved:
        """Of engines `rows` (n,), from unknowns x (nx, n); `inputs` hold base and step of the stage too. `fresh`: with
        new Jacobians from the start, as every step begins, so that an engine goes its way whatever its batch is."""
        n = len(rows)
        step = np.asarray(inputs[STEP])
        with np.errstate(invalid="ignore"):
            ratio = step / self._step[rows]
        stale = ~((ratio < STEP_CHANGE) & (ratio > 1.0 / STEP_CHANGE)) | fresh
        found = Solved(x.copy(), np.zeros((len(self.network.states), n)), np.zeros(n, dtype=bool))
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
            done = usable & ~waits & ((size <= TOLERANCE) | ((pace < STEADY_PACE) & (pace * far < self.left)))
            if done.any():
                k = at[done]
                found.x[:, k], found.good[k] = then[:, done], True
                for i, state in enumerate(self.network.states):
                    reached = np.broadcast_to(value(state.value(e)), (e.size,))[: len(at)]
                    found.states[i, k] = state.moved(reached, self._names, now, then)[done]
            length[at] = far
            going = usable & ~done
            came = then[:, going] - now[:, going], R[:, going]
            at, now = at[going], then[:, going]
            if not at.size:
                break
        self._again(rows, inputs, theta, x, found)
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

    def _again(
        self,
        rows: Array,
        inputs: Mapping[str, Value],
        theta: Mapping[str, Value],
        x: Array,
        found: Solved,
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
