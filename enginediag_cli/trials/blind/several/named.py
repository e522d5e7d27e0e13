"""Causes that an answer names, each against each of the true ones: the same, or one that the readings cannot tell from
it when the others are known.

A rival r of the true cause t is an alias where, given all other true causes,

    χ² of the flights without noise with r in place of t, all that is identified fitted anew, is below 11
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.answer import LAW, NAMED
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.trials.blind.causes import Cause, hypothesis
from enginediag_cli.trials.blind.laws.told import built
from enginediag_cli.trials.blind.score import Said


@dataclass(frozen=True)
class Named:
    """A cause that was named; `law`: the effect, where it is a law; None for a law that no engine could carry."""

    cause: Cause
    law: Effect | None = None
    is_law: bool = False

    def hypothesis(self, engine: Engine, records: int, values: Mapping[str, float]) -> Hypothesis | None:
        """It as something to fit; None where that is not possible."""
        if self.is_law:
            return None if self.law is None else Hypothesis((self.law,))
        try:
            return hypothesis(engine, (self.cause,), records, values)
        except KeyError:
            return None


def named_causes(engine: Engine, said: Said) -> tuple[list[Named], Mapping[str, float]]:
    """All causes of the first explanation, and the coefficients that were told; none where nothing was named."""
    explained: Sequence[Mapping[str, Any]] = said.raw.get("explanations", ())
    if said.status not in (NAMED, LAW) or not explained:
        return [], {}
    first = explained[0]
    laws = {f"{entry['law']}@{entry['at']}": entry for entry in first.get("laws", ())}
    found = []
    for told in first["causes"]:
        cause = Cause.from_json(told)
        is_law = cause.name in laws
        found.append(Named(cause, built(engine, laws[cause.name]) if is_law else None, is_law))
    return found, {n: c[0] for n, c in first.get("coefficients", {}).items()}


def matched(same: np.ndarray) -> tuple[int, ...]:
    """Of a table (true causes, named ones) of what may stand for what: number of the named cause that each true one is
    told by, −1 for none, as many told as can be."""
    true, named = same.shape
    slots = [*range(named), *[-1] * true]
    best: tuple[int, ...] = (-1,) * true
    for order in set(permutations(slots, true)):
        usable = tuple(j if j >= 0 and same[i, j] else -1 for i, j in enumerate(order))
        if sum(j >= 0 for j in usable) > sum(j >= 0 for j in best):
            best = usable
    return best
