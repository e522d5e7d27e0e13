"""What switches in the Citation's flight b22 without any column showing it: named, located, timed, and put to the test.

No label exists. The checks are the other engine, the other flight and the raw steps; the numbers that the tests state
are those of `citation_mismatch.py`, which prints the whole story.
"""

from __future__ import annotations

import citation_mismatch as story
import numpy as np
import pytest
from ground_recordings import enginediag, public_data, table

from enginediag_cli.mismatch.fit.identified import stack_column

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]

BLEED = "@".join(story.BLEED)
FRACTION = ".".join((*story.BLEED, "fraction"))


@pytest.fixture(scope="module")
def flights():
    """Folder of the recordings."""
    return public_data("c550_jt15d")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("citation_mismatch")


@pytest.fixture(scope="module")
def found(flights, folder):
    """Search over both flights, by engine."""
    return {
        side: story.search(
            story.load(flights, (story.REF, story.B22), side, story.nominal(folder, flights, side)), side
        )
        for side in story.SIDES
    }


@pytest.fixture(scope="module")
def trials(found):
    """Rivals refitted at the states found, by engine and name."""
    return {side: story.refitted(f) for side, f in found.items()}


@pytest.fixture(scope="module")
def unseen(flights, folder, found, trials):
    """Flight b22 of each engine, identified on flight_ref alone, with the bleed that the other engine shows."""
    result = {}
    for side, other in (story.SIDES, story.SIDES[::-1]):
        known = story.load(flights, (story.REF,), other, story.nominal(folder, flights, other))
        records = len(known.flights[0].columns["time_s"])
        coefficient = trials[side][BLEED].coefficients[FRACTION][0]
        result[other] = story.judged(known, np.zeros(records), found[other].evidence.flights[1], coefficient)
    return result


@pytest.mark.parametrize("side", story.SIDES)
def test_two_states_are_found_and_none_of_flight_ref_is_on(found, side):
    f = found[side]
    assert f.first.lr > 10 * f.first.threshold
    assert f.first.is_switch
    assert f.states[f.of(story.REF)].sum() == 0
    assert 60 < f.states[f.of(story.B22)].sum() < 80


def test_the_engines_agree_on_every_record(found):
    left, right = (
        dict(zip(stack_column(f.evidence, "time_s")[f.of(story.B22)], f.states[f.of(story.B22)], strict=True))
        for f in found.values()
    )
    both = [t for t in left if t in right]
    assert len(both) > 200
    assert sum(left[t] == right[t] for t in both) >= 0.99 * len(both)


def test_both_engines_switch_within_2_s_of_each_other_and_of_the_raw_steps(flights, found, trials):
    left, right = (story.changes(found[side], trials[side][BLEED], flights) for side in story.SIDES)
    assert [c.on for c in left] == [c.on for c in right] == [on for _, on in story.RAW_STEPS_S]
    for a, b, (raw, _) in zip(left, right, story.RAW_STEPS_S, strict=True):
        assert abs(a.time_s - b.time_s) <= 2.0
        assert max(abs(a.time_s - raw), abs(b.time_s - raw)) <= 10.0


@pytest.mark.parametrize("side", story.SIDES)
def test_a_bleed_behind_the_hpc_fits_best_of_what_a_crew_can_switch(found, trials, side):
    assert found[side].first.location.name == BLEED
    free = [label for label, t in trials[side].items() if t.converged and not t.at_bound and label not in story.RIVALS]
    assert free[0] == BLEED
    # more than the starter-generator can take
    assert trials[side]["power_offtake@hp"].at_bound


@pytest.mark.parametrize("side", story.SIDES)
def test_no_single_part_or_instrument_fits_as_well(trials, side):
    best = trials[side][BLEED].objective
    assert trials[side]["HPC efficiency"].objective > best + 20
    for rival in ("LPT efficiency", "HPT flow capacity", "core nozzle area", "fuel meter", "thermocouples"):
        assert trials[side][rival].objective > best + 250, rival


def test_it_takes_three_instruments_of_each_engine_at_once_to_fit_as_well(trials):
    """Fit alone does not exclude that: six instruments would have to step in the same second, five times."""
    both = {
        name: sum(trials[side][name].objective for side in story.SIDES)
        for name in (BLEED, "fuel meter and thermocouples at once", "fuel meter, thermocouples and N2 at once")
    }
    assert both[BLEED] < both["fuel meter and thermocouples at once"]
    assert abs(both[BLEED] - both["fuel meter, thermocouples and N2 at once"]) < 30


def test_the_engines_ask_for_the_same_share_of_bleed(trials):
    (a, s), (b, t) = (trials[side][BLEED].coefficients[FRACTION] for side in story.SIDES)
    assert 0.03 < a < 0.045 and 0.03 < b < 0.045
    assert abs(a - b) < 2.0 * np.hypot(s, t)


@pytest.mark.parametrize("side", story.SIDES)
def test_an_unseen_flight_of_the_other_engine_is_predicted_better(unseen, side):
    """Instruments are set to zero on the off state of that flight: the left fuel meter is 2.6 % off there."""
    before, after = unseen[side].zeroed_before, unseen[side].zeroed_after
    assert after[2] < 0.35 * before[2]
    assert after[1] < 0.40 * before[1]
    assert after[0] < before[0] + 0.1
    assert unseen[side].after["off"] == pytest.approx(unseen[side].before["off"], rel=1e-3)


@pytest.mark.parametrize("side", story.SIDES)
def test_explain_names_the_bleed(flights, folder, side):
    out, told = enginediag(
        "explain",
        story.ENGINE,
        flights / story.REF,
        flights / story.B22,
        "--recorder",
        story.RECORDER,
        "--engine-instance",
        side,
        "-n",
        story.nominal(folder, flights, side),
        "--no-advice",
    )
    first = table(out)[0]
    assert (first["status"], first["kind"], first["name"]) == ("hidden", "switch", BLEED)
    assert 0.03 < float(first["low"]) < float(first["high"]) < 0.04
    assert "5 changes within flights" in told
