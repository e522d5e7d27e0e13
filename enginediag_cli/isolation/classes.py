"""Classes: explanations that these records cannot tell apart are one answer with several members.

A set T stands against the leading set S by exchange where each holds something that the other does not. As long as the
posterior odds of S over T are below ODDS, the records do not tell them apart: their noise, and what is uncertain about
nominal, leaves either. S and all such T are a class; what all of them hold is shared, what a set holds besides is its
member, and a member that holds another one says nothing more. The class is the answer where S has less than CONVINCED
of its probability.

A set that merely adds to S or leaves out of it is no exchange: it asks whether there is more, not which it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.isolation.advice import ODDS

CONVINCED = 0.9
"""Share of its class from which the leading set is an answer of its own: odds of nine to one."""
MOST_MEMBERS = 8
"""Members that are told, likeliest first; nobody reads further, and the probability counts all."""


@dataclass(frozen=True)
class Class:
    """`members`: sets of parameters (or components) of which these records cannot tell which one changed, likeliest
    first; `shared`: what changed beside any of them; `probability`: of all together; `left_out`: members not told.

    would_tell: columns of sensors that, recorded as well, would tell the leading two apart, best first; empty where
    none would, or where nothing was asked.
    """

    members: tuple[tuple[str, ...], ...]
    shared: tuple[str, ...]
    probability: float
    left_out: int = 0
    would_tell: tuple[str, ...] = ()

    def told_by(self, sensors: Sequence[str]) -> Class:
        """The same with the sensors that would tell its members apart."""
        return replace(self, would_tell=tuple(sensors))

    @property
    def leading_pair(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The two likeliest explanations as whole sets."""
        first, second = self.members[:2]
        return (*self.shared, *first), (*self.shared, *second)


def class_of(names: Sequence[str], masks: np.ndarray, probabilities: np.ndarray, answer: int = 0) -> Class | None:
    """The class of the `answer`-th set, the leading one, among sets (M, p) bool of `names` (p,), by falling probability
    (M,); None where that set is an answer of its own, or is empty."""
    own = float(probabilities[answer])
    near = int(np.searchsorted(-probabilities, -own / ODDS, side="right"))
    sets, leader = masks[:near], masks[answer]
    exchanged = (leader & ~sets).any(axis=1) & (sets & ~leader).any(axis=1)
    held = own + float(probabilities[:near][exchanged].sum())
    if not leader.any() or not exchanged.any() or own >= CONVINCED * held:
        return None
    chosen = sets[np.concatenate([[answer], np.flatnonzero(exchanged)])]
    shared = chosen.all(axis=0)
    rest = chosen & ~shared
    minimal = [row for row in rest if not any(_within(other, row) for other in rest)]
    told = [tuple(np.asarray(names, object)[row]) for row in minimal]
    return Class(
        tuple(told[:MOST_MEMBERS]), tuple(np.asarray(names, object)[shared]), held, max(len(told) - MOST_MEMBERS, 0)
    )


def _within(inner: np.ndarray, outer: np.ndarray) -> bool:
    """Whether the set `inner` is a part of `outer` and not the whole."""
    return bool(np.all(outer | ~inner) and np.any(outer & ~inner))
