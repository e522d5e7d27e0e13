"""The scorer: opens a trial's sealed answer and marks what the explainer said.

A mark is True or False where the trial counts for a score, a list of shares or sizes where it has one, and absent
where the trial is not in the score's denominator. Definitions, with t the truth, A the answer's alias set, C(t) the
unavoidable aliases (λ_sep < 11), visible: λ ≥ 25 (of each of two causes, given the other):

    exact        A's first = t                    visible, λ_sep ≥ 22      (exact_no_alias: C(t) empty)
    covered      t ∈ A                            visible
    tight        |A| ≤ 1 + |C(t)|                 visible and covered
    set_score    [t ∈ A] min(1, (1 + |C|)/|A|)    visible
    false_name   named, A ∩ ({t} ∪ C(t)) = ∅ and no part of t alone; on null data any name
    none_right   "none of these", or a law        effect outside the library, λ_out ≥ 25
    wrongly_none "none of these", or a law        effect in the library, visible
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.mismatch.explain.answer import FAILED, HIDDEN, LAW, NAMED, NONE, NOTHING
from enginediag_cli.mismatch.fit.options import FAULT, SENSOR_FAULT
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.causes import Cause, Key, key
from enginediag_cli.validation.blind.sealed import Sealed
from enginediag_cli.validation.blind.separability import ALIAS, Separability
from enginediag_cli.validation.blind.visible import VISIBLE

SILENT, SEPARATE = 5.0, 22.0
"""λ below which nothing can be told, and λ_sep from which the truth stands alone: twice the 11 at which it wins 19
times out of 20."""
LOCATABLE, GAINING = 40.0, 40.0
"""λ from which a place is asked for, and from which unseen flights are asked to gain: there chance no longer
decides."""
CLEAR = 2.0  # signal to noise of one record
LEAST_PROBABILITY = 1e-3
"""A truth that was called impossible costs as much as one of this probability, 6.9 nats, not infinity."""

Marks = dict[str, Any]


@dataclass(frozen=True)
class Said:
    """An explainer's answer, its alias set as sets of causes."""

    status: str
    aliases: tuple[Key, ...]
    probabilities: tuple[float, ...]
    raw: Mapping[str, Any]

    @staticmethod
    def of(answer: Mapping[str, Any]) -> Said:
        if "error" in answer:
            return Said(FAILED, (), (), answer)
        # explanations told beside a hidden amplitude are the second choice, not the answer
        found = answer["explanations"] if answer["status"] == NAMED else []
        sets = tuple(key([Cause.from_json(c) for c in x["causes"]]) for x in found)
        return Said(answer["status"], sets, tuple(x["probability"] for x in found), answer)


def marks(sealed: Sealed, far: Separability | None, said: Said) -> Marks:
    """All marks of a trial but those that need further fits. `far` is None for null trials and hidden switches."""
    found: Marks = {"no_verdict": said.status == FAILED}
    kind = kinds.base(sealed.kind)
    if said.status == FAILED:
        return found
    if sealed.realistic is not None:
        found |= _answered(sealed, far, said)
    if kind == kinds.NULL:
        return found | {"false_name": said.status in (NAMED, LAW, HIDDEN), "false_finding": said.status != NOTHING}
    if far is None or not far.ok:
        return found
    t = key(sealed.causes)
    allowed = {t, *far.aliases}
    false = said.status == NAMED and not any(a in allowed or a < t for a in said.aliases)
    found["false_name"] = bool(false)
    if far.total < SILENT:  # every name is as good as another, so only the truth's own is not false
        found["false_name"] = said.status == NAMED and t not in said.aliases
    if min(far.given) >= VISIBLE:
        found["found"] = said.status != NOTHING
        if kind == kinds.WITHHELD:
            if far.nearest >= VISIBLE:
                found["none_right"] = said.status in (NONE, LAW)
        else:
            found |= _naming(t, far, said)
            found["wrongly_none"] = said.status in (NONE, LAW)
        if kind in (kinds.FAULT, kinds.SINGLE) and said.status == NAMED:
            first = said.raw["explanations"][0]["kinds"]
            fault = all(k in (FAULT, SENSOR_FAULT) for k in first)
            found["fault_called_fault" if kind == kinds.FAULT else "effect_called_fault"] = fault
    return found


def _answered(sealed: Sealed, far: Separability | None, said: Said) -> Marks:
    """Marks of every name that is told, whatever can be told at all: stated probability and whether it is right, and
    whether an instrument is named that reads right."""
    t = key(sealed.causes)
    if said.status != NAMED:
        return {"false_sensor": False}
    first = said.raw["explanations"][0]
    right = said.aliases[0] == t or (far is not None and far.ok and said.aliases[0] in far.aliases)
    return {
        "answered": [float(said.probabilities[0]), bool(right and t)],
        "false_sensor": bool(set(first["sensors"]) - t),
    }


def _naming(t: Key, far: Separability, said: Said) -> Marks:
    """Marks of a visible truth that the library has."""
    first, size = (said.aliases[0] if said.aliases else frozenset()), len(said.aliases)
    covered, others = t in said.aliases, len(far.aliases)
    found: Marks = {"covered": covered}
    if far.nearest >= SEPARATE:
        found["exact"] = first == t
    if far.nearest >= ALIAS:
        found["exact_no_alias"] = first == t
    if size:
        found["alias_set_size"] = [float(size)]
    if covered:
        found["tight"] = size <= 1 + others
    found["set_score"] = [min(1.0, (1 + others) / size) if covered else 0.0]
    p = sum(q for a, q in zip(said.aliases, said.probabilities, strict=True) if a == t or a in far.aliases)
    found["log_score"] = [float(-np.log(max(p, LEAST_PROBABILITY)))]
    if size:
        found["stated"] = [float(said.probabilities[0]), first == t or first in far.aliases]
    return found


def interval_marks(sealed: Sealed, said: Said) -> Marks:
    """Whether each true coefficient lies in its 95 % interval, of the explanation that is the truth."""
    t = key(sealed.causes)
    if t not in said.aliases or not sealed.effects or sealed.states is not None:
        return {}
    stated = said.raw["explanations"][said.aliases.index(t)]["coefficients"]
    inside = [float(stated[n][1] <= v <= stated[n][2]) for n, v in sealed.values.items() if n in stated]
    return {"interval": inside} if inside else {}


def hidden_marks(components: Set[str], states: np.ndarray, signal_to_noise: np.ndarray, said: Said) -> Marks:
    """Marks of a hidden switch: `states` (N,), 0 or 1, and signal to noise (N,) of the training records. A complement
    counts as right where physics does not say which state is on. Of a switch that most records show clearly, states
    are marked in the records that do; marks of any other are apart, `…_weak`, with the states of all records."""
    if said.status == FAILED:
        return {}
    clear = signal_to_noise >= CLEAR
    weak = float(np.median(signal_to_noise)) < CLEAR
    judged = np.ones(len(states), bool) if weak else clear
    found: Marks = {"hidden_found": said.status != NOTHING}
    first: Mapping[str, Any] = said.raw["hidden"][0] if said.status == HIDDEN else {}
    found["hidden_location"] = bool(first) and first["component"] in components
    share = 0.0
    if first and first["states"] is not None:
        number = np.asarray(first["number"], int)
        right = ((np.asarray(first["states"]) > 0.5) == (states[number] > 0.5))[judged[number]]
        share = float(np.mean(right))
        share = share if first["sign"] else max(share, 1.0 - share)
    found["hidden_states"] = [share]
    if weak:
        found = {f"{name}_weak": mark for name, mark in found.items()}
    return found


def located(
    cells: Sequence[Mapping[str, Any]], components: Set[str], right_drivers: Sequence[bool | None] | None
) -> Marks:
    """Whether the free-form map's first cell is of the true component, and whether the true driver is the first that
    is told, is one of those, and how many those are; none is where nothing is located. None: it varies with nothing."""
    found: Marks = {"locate_component": bool(cells) and cells[0]["component"] in components}
    if right_drivers is None:
        return found
    found["locate_driver"] = bool(right_drivers) and bool(right_drivers[0])
    found["locate_driver_told"] = any(right_drivers)
    if right_drivers:
        found["drivers_told"] = [float(len(right_drivers))]
    return found
