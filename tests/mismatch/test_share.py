"""Long recordings: a share of whole stretches is searched, and what it shows is judged on all records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan

from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.on_all import judged_on_all
from enginediag_cli.mismatch.explain.story import explain_mismatch
from enginediag_cli.mismatch.fit import share
from enginediag_cli.mismatch.fit.share import chosen, is_long, on_share, share_of
from enginediag_cli.report.tables.explanation_text import sentences

REYNOLDS = ("reynolds_efficiency", "hpc")
LIBRARY = carried((*REYNOLDS, {}), ("inlet_ram_recovery", "inlet", {}), ("reynolds_efficiency", "booster", {}))


@pytest.fixture
def short(monkeypatch):
    """What counts as long, so that tests are short."""
    for name, value in (("MANY", 600), ("SHARE", 160), ("FLIGHTS", 4), ("STRETCH", 20)):
        monkeypatch.setattr(share, name, value)


def flown(exponent: float, seed: int = 4, faulty: float = 0.0):
    """Eight flights of 80 records; a sensor that reads too high by a share from the sixth on."""
    effects = carried((*REYNOLDS, {"exponent": exponent})) if exponent else []
    found = flights(effects, np.random.default_rng(seed), count=8, records=80)
    late = {k: 1.0 + faulty * (k >= 5) for k in range(len(found))}
    return evidence(
        [replace(f, columns={**f.columns, "T3_K": f.columns["T3_K"] * late[k]}) for k, f in enumerate(found)]
    )


def test_a_share_is_of_whole_stretches_of_flights_from_first_to_last():
    rows = chosen([800] * 20)
    taken = [k for k, r in enumerate(rows) if len(r)]
    assert taken[0] == 0 and taken[-1] == 19 and len(taken) == share.FLIGHTS
    assert 0.9 * share.SHARE <= sum(map(len, rows)) <= 1.1 * share.SHARE
    for k in taken:
        runs = np.split(rows[k], np.flatnonzero(np.diff(rows[k]) > 1) + 1)
        assert all(len(r) >= share.STRETCH for r in runs) and rows[k][-1] < 800
    # no part of a flight is missed in all flights
    seen = np.unique(np.concatenate(rows))
    assert np.max(np.diff(np.concatenate([[0], seen, [799]]))) < 2 * share.STRETCH


def test_many_short_flights_give_a_share_of_as_many_records():
    rows = chosen([20] * 1000)
    assert 0.9 * share.SHARE <= sum(map(len, rows)) <= 1.1 * share.SHARE


def test_few_records_are_all_searched():
    e = flown(0.0)
    assert not is_long(e.flights) and on_share(e) is e and share_of(e.flights) == list(e.flights)


def test_a_record_of_a_share_is_told_by_its_place_in_its_recording(short):
    whole = flown(0.0).flights
    for part in share_of(whole):
        full = next(f for f in whole if f.label == part.label)
        k = len(part) // 2
        assert full.columns["altitude_m"][part.place(k)] == part.columns["altitude_m"][k]
        assert part.moment(k) == full.moment(part.place(k))


def answered(e):
    """By a share and then all records, and by all records from the start."""
    search = Search(on_share(e), LIBRARY)
    first = search.run()
    return first, judged_on_all(search, first, e).answer, Search(e, LIBRARY).run()


@pytest.mark.slow
def test_an_effect_that_a_share_shows_is_named_and_judged_on_all_records(short):
    first, judged, whole = answered(flown(0.12))
    for answer in (first, judged, whole):
        assert [x.label for x in answer.explanations] == ["reynolds_efficiency@hpc"]
    (a,), (b,) = judged.explanations[0].coefficients, whole.explanations[0].coefficients
    assert judged.readings == whole.readings > 3 * first.readings
    assert abs(a.value - b.value) < 0.1 * b.standard_error and np.isclose(a.standard_error, b.standard_error, rtol=0.02)


@pytest.mark.slow
def test_what_only_all_records_show_is_found_though_the_share_shows_nothing(short):
    first, judged, whole = answered(flown(0.01, seed=5))
    assert first.status == "nothing" and judged.status == "named"
    assert [x.label for x in judged.explanations] == [x.label for x in whole.explanations]
    assert "reynolds_efficiency@hpc" in [x.label for x in judged.explanations]


@pytest.mark.slow
def test_a_change_in_time_begins_on_all_records_where_it_does(short):
    _, judged, whole = answered(flown(0.0, seed=6, faulty=0.004))
    assert judged.explanations[0].label == whole.explanations[0].label == "sensor.T3.scale since record 1 of flight 6"


@pytest.mark.slow
def test_nothing_missing_is_nothing_on_all_records_and_says_what_only_a_share_was_searched_for(short):
    story = explain_mismatch(flown(0.0, seed=7), LIBRARY, advise=False)
    assert story.answer.status == "nothing" and story.answer.readings > 600 * 5
    assert any("driver is not recorded, only in" in line for line in sentences(story))


def with_bleed(flight, on, fraction=0.01):
    """The flight with air taken from the compressor in the records that are `on`."""
    engine = turbofan().replace_effects(carried(("customer_bleed", "hpc", {})))
    inputs = {c: flight.columns[c] for c in engine.inputs}
    before = engine.predict(inputs)
    after = engine.predict(inputs, {"customer_bleed.hpc.fraction": fraction * on})
    moved = {c: flight.columns[c] + (after.y - before.y)[:, j] for j, c in enumerate(after.columns)}
    return replace(flight, columns={**flight.columns, **moved})


@pytest.mark.slow
def test_what_switches_in_a_flight_that_the_share_has_little_of_is_found(short):
    e = flown(0.0, seed=8)
    taken = {f.label for f in on_share(e).flights}
    k = next(k for k, f in enumerate(e.flights) if f.label not in taken)
    on = (np.arange(80) >= 25) & (np.arange(80) < 55)
    bled = with_bleed(e.flights[k], on)
    story = explain_mismatch(
        replace(e, flights=tuple(bled if f.label == bled.label else f for f in e.flights)), LIBRARY, advise=False
    )
    assert story.answer.status == "hidden"
    assert {s.flight for s in story.hidden[0].switches} == {bled.label}
