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
from enginediag_cli.validation.blind.causes import Cause, hypothesis
from enginediag_cli.validation.blind.laws.told import all_built
from enginediag_cli.validation.blind.score import Said


@dataclass(frozen=True)
class Named:
    """A cause that was named; `laws`: the effects, where it is a law, several where that is a sum of forms at one
    place; none for a law that no engine could carry."""

    cause: Cause
    laws: tuple[Effect, ...] = ()
    is_law: bool = False

    def lacks_in(self, said: Said) -> bool:
        """Whether one of the explanations that were told as rivals does without it."""
        told: Sequence[Mapping[str, Any]] = said.raw.get("explanations", ())
        place = self.cause.name.partition("@")[2] if self.is_law else ""
        return any(not _has(x, self.cause.name, place) for x in told)

    def hypothesis(self, engine: Engine, records: int, values: Mapping[str, float]) -> Hypothesis | None:
        """It as something to fit; None where that is not possible."""
        if self.is_law:
            return Hypothesis(self.laws) if self.laws else None
        try:
            return hypothesis(engine, (self.cause,), records, values)
        except KeyError:
            return None


def named_causes(engine: Engine, said: Said) -> tuple[list[Named], Mapping[str, float]]:
    """All causes of the first explanation, and the coefficients that were told; none where nothing was named. What
    forms at one place make together is one law."""
    explained: Sequence[Mapping[str, Any]] = said.raw.get("explanations", ())
    if said.status not in (NAMED, LAW) or not explained:
        return [], {}
    first = explained[0]
    laws = {f"{entry['law']}@{entry['at']}": entry for entry in first.get("laws", ())}
    found: list[Named] = []
    at: dict[str, list[str]] = {}
    for told in first["causes"]:
        cause = Cause.from_json(told)
        if cause.name in laws:
            at.setdefault(laws[cause.name]["at"], []).append(cause.name)
        else:
            found.append(Named(cause))
    for names in at.values():
        own = all_built(engine, [laws[n] for n in names])
        found.append(Named(Cause(names[0]), own or (), is_law=True))
    return found, {n: c[0] for n, c in first.get("coefficients", {}).items()}


def _has(explanation: Mapping[str, Any], name: str, place: str) -> bool:
    """Whether it has a cause of this name, or a law at this place."""
    if place:
        return any(entry["at"] == place for entry in explanation.get("laws", ()))
    return any(Cause.from_json(c).name == name for c in explanation["causes"])


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
