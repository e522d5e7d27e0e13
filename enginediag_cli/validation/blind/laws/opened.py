"""A trial of a law opened: what was said of it, held against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.answer import LAW
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.freeform import Location, locations_of
from enginediag_cli.mismatch.fit.identified import (
    NO_HYPOTHESIS,
    Hypothesis,
    Identified,
    Nuisance,
    identify_with,
    inputs_of,
    nuisance,
)
from enginediag_cli.physics.laws.declared import entry_of
from enginediag_cli.physics.laws.law import variables_of
from enginediag_cli.validation.blind.laws.ahead import FOUND, NONE, SPLINE, TRUE, Ahead
from enginediag_cli.validation.blind.laws.marks import (
    ahead_marks,
    curve_error,
    given_marks,
    judged,
    null_marks,
    same_driver,
)
from enginediag_cli.validation.blind.laws.places import curved, inseparable, place_named, place_separability
from enginediag_cli.validation.blind.laws.spline import spline
from enginediag_cli.validation.blind.laws.told import ToldLaw, all_built
from enginediag_cli.validation.blind.laws.truth import LawTruth, along, curve, law_of
from enginediag_cli.validation.blind.lowest import left_by, lowest
from enginediag_cli.validation.blind.opened import evidence_of, short, trial_record
from enginediag_cli.validation.blind.recorded import Recorded, readings
from enginediag_cli.validation.blind.score import Marks, Said
from enginediag_cli.validation.blind.sealed import Sealed
from enginediag_cli.validation.blind.separability import ALIAS, separability

UNSEEN, HIGHER = "unseen", "higher"
"""Kinds of flights that nobody is shown: like the others, and four kilometres above them."""


def opened_law(engine: Engine, sealed: Sealed, recorded: Recorded, said: Said) -> dict[str, Any]:
    """The trial's record: truth, answer, separability, marks."""
    if sealed.law is None:
        return trial_record(sealed, recorded, None, np.nan, said, null_marks(said), ())
    clean = centred(evidence_of(engine, sealed, recorded, clean=True), sealed.health)
    far = separability(clean, sealed.causes, dict(sealed.health), ())
    found = given_marks(far, said)
    told = ToldLaw.of(said.raw) if said.status == LAW else None
    kept: dict[str, Any] = {"law": described(sealed.law)}
    if sealed.law.higher:
        found["higher_at_ceiling"] = [sealed.law.at_ceiling]
    if judged(far) and not found["no_verdict"]:
        marked: Marks = dict.fromkeys(("law_place", "law_driver", "law_curve"), False)
        if told is not None:
            opened = Opened.of(engine, sealed, clean)
            marked, further = opened.marks(told, evidence_of(engine, sealed, recorded, clean=False))
            kept["law"] |= further
        found |= {f"{name}_of_all": marked[name] for name in ("law_place", "law_driver", "law_curve")}
        found |= marked if told is not None else {}
    return trial_record(sealed, recorded, far, np.nan, said, found, ()) | kept


def centred(evidence: Evidence, health: Mapping[str, float]) -> Evidence:
    """With priors at the true state, so that what a true model leaves is nothing."""
    known = {n: health[n] for n in evidence.settings.nuisance if n in health}
    return replace(evidence, settings=replace(evidence.settings, prior_mean=known))


def described(law: LawTruth) -> dict[str, Any]:
    """What the record keeps of a concealed law."""
    return {
        "entry": entry_of(law.effect),
        "place": law.place.name,
        "variables": list(law.law.variables),
        "form": law.form,
        "outside": law.outside,
        "at_ceiling": short(law.at_ceiling),
    }


@dataclass(frozen=True)
class Opened:
    """A concealed law, and what is known of it without noise: `values` of all variables over the records (N,), `f` its
    curve, `base` the fit without it."""

    engine: Engine
    sealed: Sealed
    truth: LawTruth
    base: Identified
    nuisance: Nuisance
    places: tuple[Location, ...]
    values: Mapping[str, np.ndarray]
    f: np.ndarray

    @staticmethod
    def of(engine: Engine, sealed: Sealed, clean: Evidence) -> Opened:
        """`clean`: the flights without noise, priors at the true state."""
        assert sealed.law is not None
        beside = nuisance(clean)
        base = identify_with(clean, NO_HYPOTHESIS, beside)
        truth = engine.with_effects((*engine.effects, *sealed.effects))
        theta = {**sealed.health, **sealed.values}
        values = along(truth, inputs_of(clean), theta, tuple(variables_of(engine.network).values()))
        places = tuple(locations_of(engine, list(clean.noise.sigma)))
        return Opened(engine, sealed, sealed.law, base, beside, places, values, curve(sealed.law.effect, values))

    def marks(self, told: ToldLaw, searched: Evidence) -> tuple[Marks, dict[str, Any]]:
        """Marks of what was told, and what the record keeps of it. `searched`: the recordings as they were given."""
        laws = all_built(self.engine, told.entries)
        apart, at_best = self.distance(laws), self.distance(laws, sought=True)
        far = place_separability(self.base, self.nuisance, self.f, self.truth.place)
        first = told.places[0][0]
        alike = inseparable(far) | ({first} if apart < ALIAS else frozenset())
        exact = first == self.truth.place.name
        named = place_named(self.places, first)
        marks: Marks = {
            "law_place": exact or first in alike,
            "law_place_exact": exact,
            "law_component": named is not None and named.component == self.truth.place.component,
            "law_driver": same_driver(list(self.truth.law.variables), told.drivers[0][0], self.values),
            "law_curve": apart < ALIAS,
            "law_form": at_best < ALIAS,
        }
        marks["law_alone"] = len({entry["at"] for entry in told.entries}) == 1
        marks["stated"] = [told.together, marks["law_place"]]
        marks["law_driver_or_alike"] = marks["law_driver"] or apart < ALIAS
        marks["law_driver_told"] = any(
            same_driver(list(self.truth.law.variables), groups, self.values) for groups in told.along
        )
        marks["law_drivers_told"] = [len(told.along)]
        marks["stated_driver"] = [told.drivers[0][1], marks["law_driver"]]
        here = [e for e in laws or () if law_of(e).acts.leaf == self.truth.law.acts.leaf]
        if exact and here:
            told_curve = np.sum([curve(e, self.values) for e in here], axis=0)
            marks["law_error"] = [curve_error(told_curve, self.f)]
        excess = self.ahead(laws, named, told, searched)
        kept = {
            "found": [dict(entry) for entry in told.entries],
            "told_places": [[p, short(x)] for p, x in told.places[:3]],
            "told_drivers": [[[g[0] for g in groups], short(x)] for groups, x in told.drivers[:3]],
            "explained": short(told.explained),
            "distance": short(apart),
            "distance_at_best": short(at_best),
            "alike": sorted(alike),
            "excess": {name: {m: short(x) for m, x in e.items()} for name, e in excess.items()},
        }
        return marks | ahead_marks(excess), kept

    def distance(self, laws: Sequence[Effect] | None, sought: bool = False) -> float:
        """D of `marks`; infinite where the laws cannot be carried or fitted. `sought`: with their coefficients fitted
        anew, too."""
        if laws is None:
            return np.inf
        evidence, free = self.base.evidence, Hypothesis(tuple(laws))
        if not sought:
            engine = evidence.engine
            evidence, free = replace(evidence, engine=engine.with_effects((*engine.effects, *laws))), NO_HYPOTHESIS
        return left_by(lowest(evidence, free, self.nuisance, self.base, ALIAS))

    def ahead(
        self, laws: Sequence[Effect] | None, place: Location | None, told: ToldLaw, searched: Evidence
    ) -> dict[str, dict[str, float]]:
        """Excess on unseen flights of no law, of the one that was told, of the true one, and of a spline in the place
        and driver that were told."""
        unseen = {
            name: self._flights(name, flights)
            for name, flights in (
                (UNSEEN, self.sealed.flights[self.sealed.training :]),
                (HIGHER, self.truth.higher),
            )
        }
        ahead = Ahead.of(searched, {name: f for name, f in unseen.items() if f})
        models = {NONE: ahead.squares(), TRUE: ahead.squares(Hypothesis((self.truth.effect,)))}
        models[FOUND] = models[NONE]
        if laws is not None:
            carrying = searched.engine.with_effects((*searched.engine.effects, *laws))
            models[FOUND] = ahead.squares(engine=carrying)
        if place is not None:
            free = self._free(ahead, place, told.drivers[0][0], searched.records)
            if free is not None:
                models[SPLINE] = ahead.squares(free)
        return ahead.excess(models)

    def _free(self, ahead: Ahead, place: Location, groups: Sequence[Sequence[str]], fitted: int) -> Hypothesis | None:
        """A spline of each variable told, and the product of two, at a place; None where nothing is known of one."""
        known = variables_of(self.engine.network)
        of = [known[g[0]] for g in groups if g and g[0] in known]
        if len(of) < len(groups) or not of:
            return None
        x = along(self.engine, inputs_of(ahead.both), ahead.base.theta, of)
        curves = {f"{n} {k}": c for n, v in x.items() for k, c in enumerate(spline(v, v[:fitted]).T)}
        if len(x) == 2:
            a, b = ((v - np.nanmean(v[:fitted])) / max(float(np.nanstd(v[:fitted])), 1e-12) for v in x.values())
            curves["product"] = a * b
        return curved(place, {n: np.where(np.isfinite(c), c, 0.0) for n, c in curves.items()}, ahead.base)

    def _flights(self, name: str, flights: Sequence[Mapping[str, np.ndarray]]) -> list[Flight]:
        """Flights with what the truth engine's sensors read without noise; records that it cannot compute left out."""
        if not flights:
            return []
        y = readings(self.engine, replace(self.sealed, flights=tuple(flights)), exact_model=False)
        found, start = [], 0
        for k, flight in enumerate(flights):
            n = len(flight["time_s"])
            own = y[start : start + n]
            good = np.isfinite(own).all(axis=1)
            columns = {**flight, **dict(zip(self.engine.sensors, own.T, strict=True))}
            if good.any():
                found.append(Flight(f"{name}_{k + 1}", "", {c: np.asarray(v)[good] for c, v in columns.items()}))
            start += n
        return found
