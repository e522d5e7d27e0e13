"""What a place says of curves beside the law that a fit carries there, before they are fitted in the simulator.

At a fit that carries a law f₀ the derivatives are those that a large law leaves; what it says of another curve h in its
place is linear in the readings' residuals e with f₀ added back,

    g = c⊥ᵀ(e + c f₀),     G = c⊥ᵀc⊥,     c = ∂y/∂θ · h
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import STILL
from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.scan import Formula, KnownVariable
from enginediag_cli.mismatch.laws.shaping import Shaping

AT_ONCE = 500
"""Tries that are scored at once."""
STARTS = 2
"""Tries of a form, best first, from which its shape is sought: what a place and a width say together has several
maxima."""
MOST = 400
"""Tries from which shapes are sought, best first. How far one may be behind cannot be told: a narrow curve that is
misplaced says nothing."""
LEAST = 1e-9
"""Standard deviation of a form of size 1 from which it is anything: a bump far from all records is not."""


@dataclass(frozen=True)
class Says:
    """What stays of what a place says when the fit there is gone: of `any` curve, the law `f` (N,) that was carried,
    `gain`: ½ χ² that a fit without either had more, and the variables `known` as the fit had them."""

    any: AnyCurve
    f: np.ndarray
    gain: float
    known: tuple[KnownVariable, ...]

    def of(self, curves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Products (K, k, k), and pulls (K, k) of what is left and carried, of sets of curves (N, K, k)."""
        beside = np.broadcast_to(self.f[:, None, None], (*curves.shape[:2], 1))
        G = self.any.grams(np.concatenate([curves, beside], axis=2))
        return G[:, :-1, :-1], self.any.pulls(curves) + G[:, :-1, -1]


class Said:
    """What a place says of any curve beside what is carried there; `gain`: ½ χ² that a fit without either had more."""

    def __init__(self, at: Carried):
        self.at = at
        through = [at.place.through] if at.place.through is not None else []
        columns = Columns(at.found, [at.place.parameter], through)
        self.any = AnyCurve.at(at.projection, columns, at.place.parameter)
        own = self.any.grams(at.f[:, None, None])[0, 0, 0]
        # less what the law is worth at the fit that carries it
        self.gain = at.gain - (float(self.any.pulls(at.f)) + 0.5 * own)

    @property
    def kept(self) -> Says:
        return Says(self.any, self.at.f, self.gain, self.at.known)

    def with_carried(self, f: np.ndarray, pull: np.ndarray) -> Said:
        """Of the same place, what it would say if a fit carried the law f (N,) and left noise that pulls so (N,)."""
        other = copy(self)
        other.at, other.any, other.gain = replace(self.at, f=f), replace(self.any, pull=pull), 0.0
        return other

    def of(self, curves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products (K, k, k), and pulls (K, k) of what is left and carried, of sets of curves (N, K, k), not finite of
        one that is too large to square; standard deviation (K,) of an amplitude of the first, none (NaN) of a curve
        that does not vary."""
        with np.errstate(over="ignore", invalid="ignore"):
            G, g = self.kept.of(curves)
            rms = np.std(curves[:, :, 0], axis=0)
            varies = rms > np.maximum(STILL * np.abs(curves[:, :, 0]).max(axis=0), LEAST)
            tau = np.where(varies, self.at.place.scale / np.where(varies, rms, 1.0), np.nan)
            return G, g, tau

    def best(self, tries: Sequence[Formula]) -> list[Formula]:
        """Of each form of the same variables, in their order, the best as they stand."""
        weight = np.empty(len(tries))
        for a in range(0, len(tries), AT_ONCE):
            part = slice(a, a + AT_ONCE)
            G, g, tau = self.of(np.stack([f.curve for f in tries[part]], axis=1)[:, :, None])
            narrowed = 1.0 + tau**2 * G[:, 0, 0]
            prior = np.array([f.prior for f in tries[part]])
            weight[part] = 0.5 * (tau * g[:, 0]) ** 2 / narrowed - 0.5 * np.log(narrowed) + prior
        best: dict[object, list[Formula]] = {}
        for k in np.argsort(-weight, kind="stable"):
            own = best.setdefault(tries[k].what, [])
            if len(own) < STARTS:
                own.append(tries[k])
        return [f for own in best.values() for f in own][:MOST]

    def look(self, shaping: Sequence[Shaping]) -> None:
        """One look at each; those with as many letters together."""
        for k in sorted({len(s.z) for s in shaping}):
            own = [s for s in shaping if len(s.z) == k]
            curves = np.stack([s.curves() for s in own], axis=1)
            good = np.isfinite(curves).all(axis=(0, 2))
            G, g, tau = self.of(np.where(good[None, :, None], curves, 0.0))
            for j, s in enumerate(own):
                s.look(G[j], g[j], float(tau[j]) if good[j] else np.nan)
