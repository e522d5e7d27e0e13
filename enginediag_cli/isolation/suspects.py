"""Who may change during a series, how, and how probable that is beforehand.

A suspect is a component, with all or one of its parameters, or an instrument, with one form of its error:

    P(suspect changes) · P(parameters | suspect) · P(kind | suspect) · P(onset | kind)
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.detection.course import Courses
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.parameters import Parameter

STEPS = {True: 0.9, False: 0.05}
"""Chance that an instrument (True) and a component (False) changes at once, and not growing. A thermocouple breaks or
is replaced, few drift; most components wear and foul, a third stands for damage, washing and overhaul. Valves leak as
seals wear, and stick; as often as a component is damaged, so that neither passes for the other by this. Judgement."""
WRONG_WAY = 0.1
"""Chance that a value which wear can move one way only has moved the other: washing and overhaul, in the main."""


@dataclass(frozen=True)
class Suspects:
    """Groups of parameters (positions) that change together, the component of each, whether it is an instrument (G,),
    whether its own readings show it (G,), and its log prior odds (G,)."""

    described: tuple[Parameter, ...]
    groups: tuple[tuple[int, ...], ...]
    owner: tuple[str, ...]
    instrument: np.ndarray
    shown: np.ndarray
    log_odds: np.ndarray

    @property
    def components(self) -> tuple[str, ...]:
        """In the order of their parameters."""
        return tuple(dict.fromkeys(self.owner))

    def members(self, component: str) -> list[int]:
        """Positions of its groups, the one of all its parameters first."""
        return [k for k, owner in enumerate(self.owner) if owner == component]


def suspects_of(
    described: Sequence[Parameter], prior: SetPrior, sensors: bool = True, governed: Collection[str] = ()
) -> Suspects:
    """sensors: instruments may have changed, too; governed: errors of inputs that a governor may hold where they were
    read: its instrument steps either in its readings or, with the governor after it, in all others."""
    members: dict[str, list[int]] = {}
    for i, parameter in enumerate(described):
        if sensors or not parameter.of_instrument:
            members.setdefault(parameter.component, []).append(i)
    groups: list[tuple[int, ...]] = []
    owner, wrong, shown, log_odds = [], [], [], []
    for component, mine in members.items():
        instrument = all(described[i].of_instrument for i in mine)
        chance = prior.sensor if instrument else prior.inclusion
        each, whole = [(i,) for i in mine], [tuple(mine)]
        # an instrument is wrong in one of its forms, a component in all of its parameters or in one
        sets = each if instrument or len(mine) == 1 else [*whole, *each]
        for group in sets:
            share = 1 / len(sets) if sets is each else 0.5 if group == whole[0] else 0.5 / len(mine)
            groups.append(group)
            owner.append(component)
            wrong.append(instrument)
            shown.append(True)
            log_odds.append(np.log(chance / (1 - chance) * share))
            if any(described[i].name in governed for i in group):
                groups.append(group)
                owner.append(component)
                wrong.append(instrument)
                shown.append(False)
                log_odds[-1] -= np.log(2)
                log_odds.append(log_odds[-1])
    return Suspects(
        tuple(described),
        tuple(groups),
        tuple(owner),
        np.array(wrong, bool),
        np.array(shown, bool),
        np.array(log_odds),
    )


def log_of_kinds(suspects: Suspects, among: Courses) -> np.ndarray:
    """log P(kind | suspect) P(course | kind) (G, L): all courses of a kind alike."""
    found = np.full((len(suspects.groups), len(among.g)), -np.inf)
    for instrument, step in STEPS.items():
        for growing, chance in ((False, step), (True, 1 - step)):
            at = among.growing == growing
            if at.any():
                found[np.ix_(suspects.instrument == instrument, at)] = np.log(chance / at.sum())
    return found
