"""Blind trials of kind planned: what is drawn, what is flown next, and what counts as resolved."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from enginediag_cli.cli.validation import prove
from enginediag_cli.isolation.planned_flights import AIRLINER, RECORDS, SWEEP, WEATHER, flights
from enginediag_cli.mismatch.explain.answer import IDENTIFIED, NO_DISCREPANCY
from enginediag_cli.parallel import QuestionProcess
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import draw_truth, record_trial, true_flight_readings
from enginediag_cli.validation.explain_trials import (
    ANOTHER,
    ARMS,
    HINDSIGHT,
    PLANNED,
    RECORDED,
    SWEPT,
    choose_flights,
    draw_ambiguous,
    flight_from_json,
    is_resolved,
    planned_columns,
    run_trial,
)
from enginediag_cli.validation.marks import ExplainAnswer
from enginediag_cli.validation.score_sheet import PLANNED_SCORES, sheet
from enginediag_cli.validation.trials import DIAGNOSER, TrialPlan

ENGINE = str(Path(__file__).parents[2] / "configs" / "turbojet.yaml")


@pytest.fixture(scope="module")
def engine():
    return load_engine(ENGINE)


@pytest.fixture(scope="module")
def concealed():
    return draw_ambiguous(ENGINE, 1100, 0, kinds.SAME_MODEL)


def test_planned_trials_are_never_drawn_unasked_and_shift_no_other_draw(engine):
    assert kinds.PLANNED in kinds.CHOICES and kinds.PLANNED not in kinds.KINDS
    one = draw_truth(engine, 1100, 0, (kinds.SAME_MODEL,), (kinds.SINGLE,))
    draw_ambiguous(ENGINE, 1100, 0, kinds.SAME_MODEL)
    assert draw_truth(engine, 1100, 0, (kinds.SAME_MODEL,), (kinds.SINGLE,)).values == one.values


def test_realistic_truths_are_refused():
    ended = CliRunner().invoke(prove, ["--kind", "planned", "--truth", "realistic", "--trials", "1"])
    assert ended.exit_code == 2 and "planned does not go with --truth realistic" in ended.output


def test_the_same_seed_conceals_the_same_and_records_cruise_alone(concealed, engine):
    again = draw_ambiguous(ENGINE, 1100, 0, kinds.SAME_MODEL)
    assert again.values == concealed.values and again.noise_seed == concealed.noise_seed
    assert len(concealed.effects) == 1 and len(concealed.flights) == concealed.training
    assert max(concealed.records) < (RECORDED[1] - RECORDED[0]) * 70 + 1


def test_a_plan_travels_as_json_and_is_flown_after_the_recorded_flights(concealed, engine):
    for flight in flights(engine, {})[::6]:
        assert flight_from_json(asdict(flight)).inputs(engine, 5).keys() == flight.inputs(engine, 5).keys()
        flown = planned_columns(engine, concealed, flight)
        assert all(len(v) == RECORDS for v in flown.values())
        hours = [c for c in flown if c.endswith("_h")]
        assert hours and all(flown[c][0] >= concealed.flights[-1][c][-1] for c in hours)


def test_every_arm_flies_one_of_the_flights_whatever_their_order_but_the_plan_the_first(engine):
    found = flights(engine, {})
    one = choose_flights(found, np.random.default_rng(1), 4)
    other = choose_flights(found[::-1], np.random.default_rng(1), 4)
    assert tuple(one) == ARMS and one[PLANNED] == 0 and one[HINDSIGHT] == 4
    assert found[one[ANOTHER]].kind in (AIRLINER, WEATHER) and found[one[SWEPT]].kind == SWEEP
    for arm in ARMS[1:-1]:
        assert found[one[arm]].words == found[::-1][other[arm]].words


def test_rivals_are_resolved_when_the_truth_is_alone_or_as_good_as_certain():
    t, other = frozenset({"a"}), frozenset({"b"})

    def said(aliases, probabilities, status=IDENTIFIED):
        return ExplainAnswer(status, tuple(aliases), tuple(probabilities), {})

    assert is_resolved(said([t], [0.5]), t) and is_resolved(said([t, other], [0.96, 0.03]), t)
    assert not is_resolved(said([t, other], [0.9, 0.1]), t)
    assert not is_resolved(said([other, t], [0.96, 0.04]), t) and not is_resolved(said([], [], NO_DISCREPANCY), t)


def test_the_sheet_compares_the_plan_with_chance_and_with_hindsight():
    def trial(k, plan, random, best):
        marks = {"ambiguous": True, "resolved_planned": plan, "resolved_random": random, "resolved_hindsight": best}
        marks |= {"less_twice_random": [plan - 2.0 * random], "less_hindsight": [float(plan - best)]}
        return {"trial": k, "truth": kinds.SAME_MODEL, "kind": kinds.PLANNED, "marks": marks}

    told = sheet([trial(0, True, False, True), trial(1, True, True, True), trial(2, False, False, True)])
    assert set(PLANNED_SCORES) <= set(told)
    assert told["resolved_by_plan"]["same_model"]["rate"] == pytest.approx(2 / 3)
    assert told["plan_less_twice_random"]["same_model"]["rate"] == pytest.approx(0.0)
    assert told["plan_less_hindsight"]["same_model"]["rate"] == pytest.approx(-1 / 3)


def test_what_is_flown_next_reads_what_the_concealed_truth_gives(concealed, engine):
    from dataclasses import replace

    flight = next(f for f in flights(engine, {}) if f.kind == SWEEP)
    flown = replace(concealed, flights=[planned_columns(engine, concealed, flight)], training=1)
    exact = true_flight_readings(engine, flown, exact_model=False)
    (read,) = record_trial(engine, flown).noisy
    sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
    kept = np.isfinite(exact).all(axis=1)
    wrong = (np.column_stack([read.columns[c] for c in engine.sensors]) - exact[kept]) / sigma
    assert 0.8 < np.std(wrong) < 1.2


@pytest.mark.slow
def test_a_whole_trial_asks_plans_flies_and_marks():
    explainer = QuestionProcess(DIAGNOSER)
    try:
        found = run_trial(
            TrialPlan("explain", (str(ENGINE),), 1100, (kinds.SAME_MODEL,), (kinds.PLANNED,)), 0, explainer
        )
    finally:
        explainer.close()
    assert found["kind"] == kinds.PLANNED and found["error"] == "" and "ambiguous" in found["marks"]
    assert set(found["arms"]) in (set(), set(ARMS))
