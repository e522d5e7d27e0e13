"""Posterior of sets while one error grows: closed forms along straight lines of the score.

With an error of size a along d (a vector of changes that it looks like) the score is b + a I d, and with
β = D b, γ = D I d, D the widths of the prior, the marginal likelihood of a set S under the slab w is

    ½ (β + aγ)_Sᵀ P (β + aγ)_S + ½ log det P − |S| log w = c₀ + a c₁ + a² c₂,     P = (D I_SS D + w⁻²)⁻¹

so that whether S or another set is the likelier at any a takes three numbers of each; what wear does to the slab
prior (`wear.py`) is computed again where it may decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.isolation.belief import Belief
from enginediag_cli.isolation.prior import Instruments, are_sensors
from enginediag_cli.isolation.wear import FAINT, log_factors, wear_signs
from enginediag_cli.residuals.score import Score

LIKELY = 3e-3
"""Share of the answer's probability from which what wear does to a set was weighed for certain."""


@dataclass(frozen=True)
class _Group:
    """Sets (their rows) that are read by one score, in widths of the prior: γ of each line (D, p)."""

    rows: np.ndarray
    score: Score
    moves: np.ndarray


class Lines:
    """log posterior of M sets along D lines, up to a constant. masks (M, p) bool; log_prior (M,); lines (D, p): what
    an error of size one looks like, in units of the parameters; reported (M,): log probabilities of the sets as they
    were found, NaN of what was not, the first being known."""

    def __init__(
        self,
        belief: Belief,
        masks: np.ndarray,
        log_prior: np.ndarray,
        lines: np.ndarray,
        reported: np.ndarray,
        *,
        leader_only: bool = False,
    ):
        self.leader_only = leader_only
        self.masks, self._prior = masks, belief.prior
        own = np.array([mask.tobytes() in belief.about for mask in masks], bool)
        groups = [(np.flatnonzero(~own), belief.score)]
        groups += [(np.array([k]), belief.about[masks[k].tobytes()]) for k in np.flatnonzero(own)]
        self._groups = [self._group(rows, score, lines) for rows, score in groups if rows.size]
        S, M, D = len(belief.prior.slabs), len(masks), len(lines)
        self._c0, self._c1, self._c2 = np.empty((S, M)), np.empty((S, M, D)), np.empty((S, M, D))
        for group in self._groups:
            self._expand(group)
        signs = wear_signs(belief.score, belief.prior)
        self._bounded = (masks & ~are_sensors(belief.score.described)).any(axis=1)
        self._most = np.log(2 * max(belief.prior.rises, 1 - belief.prior.rises))
        self._signed = (masks & (signs != 0)).sum(axis=1)
        self._constant = np.zeros(M)
        here = log_prior + self._plain(np.zeros(1, int), np.zeros(1))[0] + self._wear_of(np.arange(M), 0, 0.0)
        # what was found for a set holds more than its quadratic says: of those that the full model was fitted to and
        # of likely ones; in others wear may not have been weighed, and they are as far apart as the answer is
        with np.errstate(invalid="ignore"):
            sure = np.isfinite(reported) & (own | (reported > reported[0] + np.log(LIKELY)))
        apart = np.where(sure, reported - here, reported[0] - here[0])
        self._constant = log_prior + apart

    def _group(self, rows: np.ndarray, score: Score, lines: np.ndarray) -> _Group:
        D = score.prior_sigma * self._prior.widths(score.described)
        return _Group(rows, score, (lines @ score.information) * D)

    def _expand(self, group: _Group) -> None:
        b, information = self._prior.scaled(group.score)
        sizes = self.masks[group.rows].sum(axis=1)
        slabs = np.asarray(self._prior.slabs, float)
        for size in np.unique(sizes):
            rows = group.rows[sizes == size]
            members = np.nonzero(self.masks[rows])[1].reshape(len(rows), size)
            I = information[members[:, :, None], members[:, None, :]]
            beta, gamma = b[members], group.moves[:, members].transpose(1, 2, 0)  # (M, k), (M, k, D)
            P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))
            moved = P @ gamma
            at = P @ beta[..., None]
            self._c0[:, rows] = (
                0.5 * np.sum(beta * at[..., 0], axis=2) + 0.5 * np.linalg.slogdet(P)[1] - size * np.log(slabs)[:, None]
            )
            self._c1[:, rows] = np.sum(beta[..., None] * moved, axis=2)
            self._c2[:, rows] = 0.5 * np.sum(gamma * moved, axis=2)

    def _plain(self, line: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Log posterior (n, M) at sizes a (n,) along lines number (n,), without what wear does."""
        size = a[:, None]
        each = (
            self._c0[:, None, :]
            + size * np.moveaxis(self._c1[:, :, line], 2, 1)
            + size**2 * np.moveaxis(self._c2[:, :, line], 2, 1)
        )
        return np.asarray(np.logaddexp.reduce(each, axis=0) - np.log(len(each)) + self._constant)

    def _wear_of(self, sets: np.ndarray, line: int | np.ndarray, a: float | np.ndarray) -> np.ndarray:
        """Log of what wear does to sets number (k,), each at its own size a along its own line."""
        found = np.zeros(len(sets))
        lines, sizes = np.broadcast_to(line, sets.shape), np.broadcast_to(a, sets.shape)
        group_of = np.empty(len(self.masks), int)
        for g, group in enumerate(self._groups):
            group_of[group.rows] = g
        for g, group in enumerate(self._groups):
            at = np.flatnonzero(group_of[sets] == g)
            if at.size:
                moved = sizes[at, None] * group.moves[lines[at]]
                own, of = np.unique(sets[at], return_inverse=True)
                found[at] = log_factors(group.score, self.masks[own], self._prior, moved, of)
        return found

    def at(self, line: Sequence[int] | np.ndarray, a: np.ndarray) -> np.ndarray:
        """Log posterior (n, M) at sizes a (n,) along lines number (n,), up to a constant of each."""
        line = np.asarray(line, int)
        logs = self._plain(line, a)
        ceiling = logs + self._most * self._signed
        least = ceiling.max(axis=1, keepdims=True) + np.log(FAINT)
        if self.leader_only:  # no set that stays behind the one with the highest ceiling can lead
            top = ceiling.argmax(axis=1)
            rows = np.arange(len(line))
            least = np.maximum(least, (logs[rows, top] + self._wear_of(top, line, a))[:, None] - 1e-9)
        n, k = np.nonzero((ceiling > least) & self._bounded)
        logs[n, k] += self._wear_of(k, line[n], a[n])
        return np.where(ceiling > least, logs, -np.inf) if self.leader_only else logs

    @property
    def standard_errors(self) -> np.ndarray:
        """Size (D,) of an error along each line that moves the score by one standard error."""
        group = self._groups[0]
        D = group.score.prior_sigma * self._prior.widths(group.score.described)
        with np.errstate(divide="ignore"):
            information = group.score.information * D * D[:, None]
            eigenvalues, vectors = np.linalg.eigh(information)
            seen = eigenvalues > 1e-9 * max(float(eigenvalues[-1]), 1e-300)
            along = group.moves @ vectors[:, seen]
            return np.asarray(1 / np.sqrt(np.sum(along**2 / eigenvalues[seen], axis=1)))


def log_prior_of(belief: Belief, masks: np.ndarray) -> np.ndarray:
    """log P(S) (M,) of sets of parameters (M, p)."""
    return belief.prior.log_of(masks, Instruments.from_parameters(belief.score.described))
