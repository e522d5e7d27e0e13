"""The scorer of isolation: opens a trial's sealed answer and marks what the isolator said.

With T the places that are wrong, A the answer's and R its rivals (sets of places, each):

    false_alarm   the verdict is a fault where nothing is wrong
    right         A = T. Of physics, which isolation does not know: A lies where the effect acts
    covered       T ∈ {A} ∪ R, or the class that is told holds T; not asked of physics
    false_name    a name where nothing is wrong
    false_sensor  A names an output sensor that reads right; false_input: an input channel
    stated        probability that A changed and nothing else that matters, and whether it is so: A lies in T, and what
                  T holds besides is below `least_that_matters`; stated_changed: of each place of A the probability
                  that it changed, whatever else did, and whether it lies in T (of physics, where the effect acts)
    interval      of every size that is told, whether its interval holds the true change, 0 of what did not change

An instrument is right by its column: whether the error is told as a bias or as a scale is no matter, but sizes of those
told in another way than they were made are not marked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from enginediag_cli.detection.verdict import FAULT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.isolation.posterior import least_that_matters
from enginediag_cli.validation.blind.causes import Cause, components
from enginediag_cli.validation.isolated import kinds
from enginediag_cli.validation.isolated.sealed import Sealed, reading

NAMED, NOTHING, CANNOT_TELL = "named", "nothing", "cannot tell"
NO_VERDICT, NOT_IDENTIFIED, FAILED = "no verdict", "not identified", "failed"
OUTCOMES = (NAMED, NOTHING, CANNOT_TELL, NO_VERDICT, NOT_IDENTIFIED, FAILED)
JUDGED = (NAMED, NOTHING, CANNOT_TELL)
"""Outcomes that are an answer."""

OF_ALL_FAULTS = {"exact_fault": "exact", "exact_instrument": "exact", "covered_fault": "covered"}
"""Marks of every trial with a fault, judged or not, and those of judged trials that they repeat."""

Marks = dict[str, Any]


def outcome(told: Mapping[str, Any]) -> str:
    """What kind of answer the isolator gave."""
    if "error" in told:
        return FAILED
    if not told["identified"]:
        return NOT_IDENTIFIED
    window = _window(told)
    if "sets" not in window:
        return NO_VERDICT
    if window["named"]:
        return CANNOT_TELL if "class" in window else NAMED
    return CANNOT_TELL if window["sets"][0] else NOTHING


def marks(engine: Engine, sealed: Sealed, told: Mapping[str, Any]) -> Marks:
    """All marks of a trial."""
    came = outcome(told)
    found: Marks = {"judged": came in JUDGED, "cannot_tell": came == CANNOT_TELL}
    found |= {"no_verdict": came in (NO_VERDICT, FAILED), "not_identified": came == NOT_IDENTIFIED}
    window = _window(told)
    if sealed.kind == kinds.NULL:
        found["false_alarm"] = window.get("verdict") == FAULT
    elif not sealed.effects:
        found |= {"exact_fault": False, "covered_fault": False}
        if sealed.kind in kinds.INSTRUMENTS:
            found["exact_instrument"] = False
    if came not in JUDGED:
        return found
    truth = frozenset(c.place for c in sealed.changes)
    said = frozenset(window["sets"][0]) if came == NAMED else frozenset()
    outputs, inputs = ({reading(c) for c in columns} for columns in (engine.sensors, engine.inputs))
    found["false_sensor"] = bool((said & outputs) - truth)
    found["false_input"] = bool((said & inputs) - truth)
    if sealed.kind == kinds.NULL:
        found["false_name"] = window["named"]  # a class, too, says that something is wrong
    else:
        found["found"] = came != NOTHING
    acting = _where_it_acts(engine, sealed) if sealed.effects else truth
    right = said <= acting if sealed.effects else said == truth
    as_stated = right if sealed.effects else said <= truth and not (truth - said) & _that_matter(engine, sealed)
    if window["named"] and "class" in window and not sealed.effects:
        one_of = [frozenset(s) for s in window["class"]]
        found["stated_class"] = [float(window["class_probability"] or 0.0), truth in one_of]
    if came == NAMED:
        found["stated"] = [float(window["probabilities"][0] or 0.0), as_stated]
        each = zip(window["sets"][0], window.get("changed", ()), strict=False)
        found["stated_changed"] = [[float(p or 0.0), place in acting] for place, p in each]
        found["right_name"] = right
    elif came == NOTHING:
        found["stated_nothing"] = [float(window["probabilities"][0] or 0.0), as_stated and not sealed.effects]
    if not sealed.effects:
        found["exact"] = came != CANNOT_TELL and right
        sets = [frozenset(s) for s in (*window["sets"], *window.get("class", ()))]
        found["covered"] = truth in sets
        found |= {name: found[of] for name, of in OF_ALL_FAULTS.items() if name in found}
        if came == NAMED:
            inside = _intervals(sealed, window["sizes"])
            found |= {"interval": inside} if inside else {}
    return found


def _window(told: Mapping[str, Any]) -> Mapping[str, Any]:
    """A recording of one flight is one window."""
    windows: Sequence[Mapping[str, Any]] = told.get("windows") or ({},)
    return windows[0]


def _intervals(sealed: Sealed, sizes: Sequence[Sequence[Any]]) -> list[float]:
    by_place = {c.place: c for c in sealed.changes}
    found = []
    for place, quantity, _, low, high in sizes:
        change = by_place.get(place)
        if change is not None and change.instrument and change.share != (quantity == "scale"):
            continue
        true = change.size if change is not None else 0.0
        found.append(float((low is None or low <= true) and (high is None or true <= high)))
    return found


def _that_matter(engine: Engine, sealed: Sealed) -> frozenset[str]:
    """Places of the changes that are as large as what matters beside others."""
    found = {c.place for c in sealed.changes if c.instrument}
    for c in sealed.changes:
        if not c.instrument and c.place in engine.parameters:
            p = engine.parameters[c.place]
            if abs(c.size) >= least_that_matters([p], np.array([p.prior_sigma]))[0]:
                found.add(c.place)
    return frozenset(found)


def _where_it_acts(engine: Engine, sealed: Sealed) -> frozenset[str]:
    """Places of the components through which the effects act, and of the readings that they falsify."""
    acting = frozenset().union(*(components(engine, Cause(e.label)) for e in sealed.effects))
    places = {n for n, p in engine.parameters.items() if p.component in acting and not p.of_sensor}
    places |= {reading(c) for c, s in engine.sensors.items() if {s.quantity, c, f"sensor.{s.quantity}"} & acting}
    if acting & {c.name for c in engine.network.components if c.TYPE == "ambient"}:
        places |= {reading(c) for c in engine.inputs if c != engine.power_setting}
    return frozenset(places)
