"""What `explain` tells around its answer: coefficients in words, unlisted physics as curves, cost, advice."""

from __future__ import annotations

import json

import numpy as np
import pytest
from refine_flights import evidence, flights, library

from enginediag_cli.isolation.planned_flights import SAME, SWITCH, best_of_each_kind
from enginediag_cli.mismatch.explain.answer import Coefficient, Explanation
from enginediag_cli.mismatch.explain.curves import best_places
from enginediag_cli.mismatch.explain.plan import advise_flights_for_explanations
from enginediag_cli.mismatch.explain.story import explain_mismatch, named_effects
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.report.output import finite, plain
from enginediag_cli.report.tables.explanation import document, rows
from enginediag_cli.report.tables.explanation_text import sentences

RIVALS = ("power_offtake@hp", "thermocouple_radiation@T45", "nozzle_discharge@core_nozzle")


@pytest.fixture(scope="module")
def thin_air():
    return flights("reynolds_efficiency@hpc", {"exponent": 0.1}, seed=1)[0]


@pytest.fixture(scope="module")
def named(thin_air):
    return explain_mismatch(evidence(thin_air), library("reynolds_efficiency@hpc", *RIVALS))


@pytest.fixture(scope="module")
def unlisted(thin_air):
    return explain_mismatch(evidence(thin_air[:5], model_error=0.0), library("thermocouple_radiation@T45"))


def test_a_concealed_reynolds_effect_is_named_with_an_interval_that_holds_the_truth(named):
    assert named.answer.status == "named"
    assert [e.label for e in named_effects(named)] == ["reynolds_efficiency@hpc"]
    (c,) = named.answer.explanations[0].coefficients
    assert c.low < 0.1 < c.high


def test_the_sentences_say_what_acts_where_how_large_and_what_the_tolerance_of_the_maps_cost(named):
    told = "\n".join(sentences(named))
    (e,) = named_effects(named)
    assert e.term.STATEMENT in told and "(reynolds_efficiency@hpc)" in told and "95 % interval" in told
    assert "Tolerance of the maps 0.3 %: reynolds_efficiency@hpc" in told


def test_the_floor_never_raises_a_score_much_nor_lowers_the_visible_size(named):
    assert {c.label for c in named.floor} >= {"reynolds_efficiency@hpc", "power_offtake@hp"}
    for c in named.floor:
        assert c.visible >= 0.999 * c.visible_without


def test_rows_and_json_agree_on_the_coefficient(named):
    (row,) = list(rows(named))
    told = json.loads(json.dumps(finite(plain(document(named, ())))))
    assert told["explanations"][0]["coefficients"][0]["value"] == row["value"]
    assert told["status"] == row["status"] == "named"


@pytest.mark.slow
def test_an_effect_outside_the_library_is_a_law_at_its_place(unlisted):
    assert unlisted.answer.status == "law"
    law = unlisted.answer.law
    (place, p), band = law.places[0], law.band
    assert place.name == "hpc.efficiency" and p > 0.9 and law.explained > 0.9
    assert {"reynolds_index", "ambient_pressure"} & {v.name for (g,), _ in law.drivers[:1] for v in g}
    # efficiency falls by about a tenth of the losses (14 %) a unit of ln RNI
    slope = np.polyfit(np.log(band.at), band.change, 1)[0]
    assert 0.007 < slope < 0.021 and (band.standard_error > 0.0).all()
    told = "\n".join(sentences(unlisted))
    assert "a law does" in told and "Where is settled" in told and "f = a *" in told
    assert {r["kind"] for r in rows(unlisted)} == {"law"}


@pytest.mark.slow
def test_a_law_stands_in_the_document_as_an_engine_file_takes_it(unlisted):
    told = json.loads(json.dumps(finite(plain(document(unlisted, ())))))["law"]
    entry = told["laws"][0]["entry"]
    assert entry["at"] == "hpc.efficiency" and set(entry) >= {"law", "expression", "coefficients", "statement"}
    assert told["places"][0]["location"] == "hpc.efficiency" and len(told["band"]["values"]) >= 10


@pytest.mark.slow
def test_places_within_reach_are_named_once_each(unlisted):
    names = [c.location.name for c in best_places(unlisted.answer.cells)]
    assert len(names) == len(set(names)) and "hpc.efficiency" in names


def test_nothing_missing_is_told_as_nothing():
    story = explain_mismatch(evidence(flights("", {}, seed=5)[0][:4]), library("reynolds_efficiency@hpc"), advise=False)
    assert story.answer.status == "nothing"
    assert next(sentences(story)).startswith("Nothing is missing")
    assert [r["status"] for r in rows(story)] == ["nothing"]


def _explanation(base, along, label: str) -> Explanation:
    trial = attempt([effect_option(library(label)[0])], base, along)
    found = tuple(Coefficient(n, "1", v, e, v - 2 * e, v + 2 * e) for n, (v, e) in trial.coefficients.items())
    return Explanation(trial.options, found, trial.objective, 0.0, 0.5, 0.0, 1.0)


@pytest.fixture(scope="module")
def rivals():
    """An off-take of power that a few records of cruise cannot tell from a Reynolds effect."""
    case = evidence(flights("power_offtake@hp", {"fraction": 0.02}, seed=3, count=1)[0])
    along = nuisance(case)
    base = identify_with(case, NULL_HYPOTHESIS, along)
    return base, [_explanation(base, along, n) for n in ("power_offtake@hp", "reynolds_efficiency@hpc")]


def test_switching_the_off_take_off_tells_it_from_a_reynolds_effect_sooner_than_more_of_the_same(rivals):
    found = advise_flights_for_explanations(*rivals)
    assert found is not None and found.separates
    by_kind = {s.kind: s for s in best_of_each_kind(found.suggestions)}
    assert by_kind[SWITCH].subject == "power_offtake@hp"
    assert by_kind[SWITCH].records < by_kind[SAME].records


def test_the_order_of_the_rivals_does_not_matter(rivals):
    base, (one, other) = rivals
    ways = [advise_flights_for_explanations(base, told) for told in ((one, other), (other, one))]
    records = [{s.subject: s.records for s in w.suggestions if s.flight} for w in ways if w is not None]
    assert records[0] == records[1]
