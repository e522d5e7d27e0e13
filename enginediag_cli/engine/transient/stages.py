"""Solves the stages of a step: Newton iteration with Jacobians that are kept from stage to stage and step to step, and
that every pass corrects by what it showed (C. G. Broyden, Math. Comp. 19 (1965) 577–593)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.transient.networks import MovingNetwork
from enginediag_cli.engine.transient.state import STEP

SLOW = 0.2
"""A pass that leaves more than this of the residual asks for a new Jacobian."""
STEP_CHANGE = 1.3
"""So does a step that is as many times as long, or as short, as the one whose Jacobian is kept. Judgement."""
LEAST_SHOWN = 0.1
"""A move that changed less than this of what the kept Jacobian says corrects nothing."""
PASSES = 12
"""With kept Jacobians; what has not converged then goes the way of the steady engine's solver."""


@dataclass
class Solved:
    """Unknowns (nx, n), states (ns, n) and whether the stage was solved (n,)."""

    x: Array
    states: Array
    good: Array


class Stages:
    """Of N engines; keeps the inverse of each one's last Jacobian and its step."""

    def __init__(self, network: MovingNetwork, size: int):
        self.network = network
        nx = len(network.unknowns())
        self._inverse = np.full((size, nx, nx), np.nan)
        self._step = np.full(size, np.nan)
        self._lower = np.array([[u.lower] for u in network.unknowns()])
        self._upper = np.array([[u.upper] for u in network.unknowns()])
        self.passes = 0

    def solve(self, rows: Array, inputs: Mapping[str, Value], theta: Mapping[str, Value], x: Array) -> Solved:
        """Of engines `rows` (n,), from unknowns x (nx, n); `inputs` hold base and step of the stage too."""
        n = len(rows)
        step = np.asarray(inputs[STEP])
        with np.errstate(invalid="ignore"):
            ratio = step / self._step[rows]
        stale = ~((ratio < STEP_CHANGE) & (ratio > 1.0 / STEP_CHANGE))
        found = Solved(x.copy(), np.zeros((len(self.network.states), n)), np.zeros(n, dtype=bool))
        at, now, last = np.arange(n), x.copy(), np.full(n, np.inf)
        came: tuple[Array, Array] | None = None  # how far the last pass moved (nx, n), and from which residuals
        for _ in range(PASSES):
            fresh = stale[at]
            whole = len(at) == n
            u, t = (inputs, theta) if whole else (solver.take(inputs, at), solver.take(theta, at))
            if fresh.any():
                R, J = self._jacobian(u, t, now, fresh)
                self._inverse[rows[at[fresh]]] = _inverse(J)
                self._step[rows[at[fresh]]] = step[at[fresh]]
                e = None
            else:
                e = solver.evaluate(self.network, u, t, now, frozenset())
                R = solver._balances(e)
            self.passes += len(at)
            size = np.where(np.isfinite(R), np.abs(R), np.inf).max(axis=0)
            if e is not None:
                done = size <= solver.TOLERANCE
                if done.any():
                    states = [np.broadcast_to(value(s.value(e)), (len(at),)) for s in self.network.states]
                    found.x[:, at[done]], found.good[at[done]] = now[:, done], True
                    found.states[:, at[done]] = np.stack(states)[:, done]
            else:
                done = np.zeros(len(at), dtype=bool)
            if came is not None:
                self._correct(rows[at], came[0], R - came[1], ~fresh)
            # a Jacobian that has just been made is not made again
            stale[at] = ~fresh & (size > SLOW * last[at])
            last[at] = size
            left = ~done & np.isfinite(size)
            if not left.any():
                break
            at, now, R = at[left], now[:, left], R[:, left]
            move = np.einsum("nij,jn->in", self._inverse[rows[at]], R)
            largest = np.max(np.abs(move) / np.maximum(np.abs(now), solver.SMALL), axis=0)
            move *= np.minimum(1.0, solver.LARGEST_STEP / np.maximum(largest, 1e-300))
            then = np.clip(now - move, self._lower, self._upper)
            left = np.isfinite(then).all(axis=0)
            came = then[:, left] - now[:, left], R[:, left]
            at, now = at[left], then[:, left]
            if not at.size:
                break
        self._again(rows, inputs, theta, x, found)
        return found

    def _jacobian(self, u: Mapping[str, Value], t: Mapping[str, Value], x: Array, fresh: Array) -> tuple[Array, Array]:
        """Balances of all (nx, n), Jacobians of those that are `fresh` (n,)."""
        if fresh.all():
            return solver._values_and_jacobian(self.network, u, t, x)
        R = np.empty_like(x)
        a, b = np.flatnonzero(fresh), np.flatnonzero(~fresh)
        R[:, a], J = solver._values_and_jacobian(self.network, solver.take(u, a), solver.take(t, a), x[:, a])
        e = solver.evaluate(self.network, solver.take(u, b), solver.take(t, b), x[:, b], frozenset())
        R[:, b] = solver._balances(e)
        return R, J

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
        self._step[rows[bad]] = np.nan
        if good.any():
            e = solver.evaluate(self.network, u, t, solved.x, frozenset())
            states = [np.broadcast_to(value(s.value(e)), (len(bad),)) for s in self.network.states]
            found.x[:, bad[good]], found.good[bad[good]] = solved.x[:, good], True
            found.states[:, bad[good]] = np.stack(states)[:, good]


def _inverse(J: Array) -> Array:
    return solver.linear_solve(J, np.broadcast_to(np.eye(J.shape[1]), J.shape))
