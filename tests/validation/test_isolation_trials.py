"""Blind trials of isolation: what is drawn, what is handed over, how answers are marked and counted."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.__main__ import main
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation import kinds
from enginediag_cli.validation.diagnoser import answer
from enginediag_cli.validation.isolation_trials import (
    CANNOT_TELL,
    NAMED,
    NO_VERDICT,
    NOT_IDENTIFIED,
    NOTHING,
    ConcealedChange,
    draw_changes,
    isolation_sheet,
    marks,
    outcome,
    outcomes_by_kind,
    record_trial,
    reliability,
)
from enginediag_cli.validation.trial_flights import instrument_place
from enginediag_cli.validation.trials import TrialPlan

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def turbojet():
    return load_engine(CONFIGS / "turbojet.yaml")


def drawn(engine, kind, trial=0, truth=kinds.SAME_MODEL):
    return draw_changes(engine, 5, trial, (truth,), (kind,))


# what is drawn and handed over


def test_every_kind_conceals_what_it_says(turbojet):
    for k in range(6):
        assert drawn(turbojet, kinds.NULL, k).changes == ()
        (component,) = drawn(turbojet, kinds.COMPONENT, k).changes
        assert component.place in turbojet.monitored and 0.003 <= abs(component.size) <= 0.03
        if turbojet.parameters[component.place].wear < 0:
            assert component.size < 0
        (sensor,) = drawn(turbojet, kinds.OUTPUT_SENSOR, k).changes
        assert sensor.instrument and sensor.place in {instrument_place(c) for c in turbojet.sensors}
        (channel,) = drawn(turbojet, kinds.INPUT_CHANNEL, k).changes
        assert channel.instrument and channel.place in {instrument_place(c) for c in turbojet.inputs}
        assert 2 <= len(drawn(turbojet, kinds.SEVERAL, k).changes) <= 3
        physics = drawn(turbojet, kinds.PHYSICS, k)
        assert len(physics.effects) == 1 and physics.values and len(physics.changes) == 1


def test_only_the_judged_flight_is_changed(turbojet, tmp_path):
    concealed = replace(
        drawn(turbojet, kinds.NULL), changes=(ConcealedChange(instrument_place("T3_K"), 25.0, instrument=True),)
    )
    for name, s in (("with", concealed), ("without", replace(concealed, changes=()))):
        (tmp_path / name).mkdir()
        record_trial(turbojet, s, tmp_path / name)
    files = sorted(p.name for p in (tmp_path / "with").glob("*.csv"))
    for name in files:
        a, b = (np.genfromtxt(tmp_path / w / name, delimiter=",", names=True) for w in ("with", "without"))
        assert np.allclose(a["T3_K"] - b["T3_K"], 25.0 if name.startswith("judged") else 0.0, atol=1e-5)
    assert sum(name.startswith("healthy") for name in files) in (4, 5, 6)


def test_the_isolator_says_what_the_commands_say(turbojet, tmp_path):
    files = record_trial(turbojet, drawn(turbojet, kinds.COMPONENT, 1), tmp_path)
    healthy = [str(p) for p in files.healthy]
    told = answer({"task": "isolate", "engine": str(files.engine), "healthy": healthy, "judged": str(files.judged)})
    nominal, out = tmp_path / "by_command.yaml", tmp_path / "rows.csv"
    assert main(["identify", str(files.engine), *healthy, "-o", str(nominal), "-q"]) == 0
    assert main(["isolate", "-n", str(nominal), str(files.judged), "-o", str(out), "-q"]) == 0
    with open(out, encoding="utf-8", newline="") as stream:
        row = next(csv.DictReader(line for line in stream if not line.startswith("#")))
    (window,) = told["windows"]
    assert window["verdict"] == row["verdict"]
    assert window["probabilities"][0] == pytest.approx(float(row["probability"]), rel=1e-6)
    assert all(p >= window["probabilities"][0] - 1e-9 for p in window["changed"])
    assert len(window["sets"]) - 1 == len([each for each in row["rivals"].split(";") if each])


def test_the_field_holds_its_shares_and_one_engine_for_several_judged_flights(turbojet, tmp_path):
    cycle = [kinds.field_kind(k) for k in range(320)]
    assert cycle.count(kinds.NULL) == 80 and sum(cycle.count(k) for k in kinds.INSTRUMENTS) == 60
    one, other = (draw_changes(turbojet, 5, k, (kinds.REALISTIC,), (kinds.FIELD,)) for k in (1, 2))
    assert one.health == other.health and one.changes != other.changes
    field = TrialPlan("isolate", (), 5, (kinds.REALISTIC,), (kinds.FIELD,))
    assert field.group(1) == field.group(2) != field.group(8)
    for a, b in zip(one.flights[:-1], other.flights[:-1], strict=True):
        assert all(np.array_equal(a[c], b[c]) for c in a)
    assert not np.array_equal(one.flights[-1]["mach"], other.flights[-1]["mach"])
    texts = []
    for concealed in (one, other):
        folder = tmp_path / str(concealed.trial)
        folder.mkdir()
        files = record_trial(turbojet, concealed, folder)
        texts.append([p.read_text() for p in files.healthy])
        data = np.genfromtxt(files.judged, delimiter=",", names=True)
        assert np.all(np.diff(data["time_s"]) == 60.0)
        cells = np.isnan(np.stack([data[c] for c in turbojet.sensors]))
        assert 0.01 < cells.mean() < 0.12
    assert texts[0] == texts[1]  # healthy recordings are the group's


# marks


def said(*sets, named=True, probabilities=(0.95, 0.03), sizes=()):
    window = {"verdict": "fault", "named": named, "sets": [list(s) for s in sets], "sizes": list(sizes)}
    return {"identified": True, "windows": [window | {"probabilities": list(probabilities[: len(sets)])}]}


@pytest.fixture(scope="module")
def component(turbojet):
    return replace(drawn(turbojet, kinds.COMPONENT), changes=(ConcealedChange("turbine.efficiency", -0.01),))


def test_the_right_set_is_right_covered_and_stated(turbojet, component):
    size = ["turbine.efficiency", "efficiency", -0.011, -0.012, -0.009]
    m = marks(turbojet, component, said(["turbine.efficiency"], [], sizes=[size]))
    assert m["exact"] and m["covered"] and m["right_name"] and m["stated"] == [0.95, True] and m["interval"] == [1.0]
    assert not m["false_sensor"] and not m["false_input"]


def test_a_set_with_one_more_is_wrong_and_its_interval_must_hold_nothing(turbojet, component):
    sizes = [["turbine.efficiency", "efficiency", -0.011, -0.012, -0.0105], ["reading T3_K", "bias", 3.0, 1.0, 5.0]]
    m = marks(turbojet, component, said(["turbine.efficiency", "reading T3_K"], ["turbine.efficiency"], sizes=sizes))
    assert not m["exact"] and m["covered"] and m["false_sensor"] and m["interval"] == [0.0, 0.0]


def test_each_named_place_is_held_against_its_own_probability(turbojet, component):
    told = said(["turbine.efficiency", "nozzle.area"])
    told["windows"][0]["changed"] = [0.99, 0.6]
    m = marks(turbojet, component, told)
    assert m["stated_changed"] == [[0.99, True], [0.6, False]] and not m["right_name"]
    rows = reliability([{"kind": kinds.COMPONENT, "marks": m}])["changed"]
    assert [(b["stated"], b["count"], b["of"]) for b in rows] == [(0.6, 0, 1), (0.99, 1, 1)]


def test_a_wrong_input_is_told_apart_from_a_wrong_output(turbojet, component):
    m = marks(turbojet, component, said(["reading mach"]))
    assert m["false_input"] and not m["false_sensor"] and not m["covered"]


def test_any_name_is_false_where_nothing_is_wrong(turbojet):
    null = drawn(turbojet, kinds.NULL)
    assert marks(turbojet, null, said(["turbine.efficiency"], []))["false_name"]
    m = marks(turbojet, null, said([], named=False))
    assert not m["false_name"] and m["exact"] and m["covered"] and m["stated_nothing"] == [0.95, True]


def test_an_answer_that_does_not_stand_is_an_outcome_of_its_own_and_its_class_may_hold_the_truth(turbojet, component):
    told = said(["reading T3_K"], ["turbine.efficiency"], named=False)
    assert outcome(told) == CANNOT_TELL
    m = marks(turbojet, component, told)
    assert m["cannot_tell"] and not m["exact"] and m["covered"] and "stated" not in m and not m["false_sensor"]
    told["windows"][0] |= {"sets": [["reading T3_K"]], "class": [["turbine.efficiency"], ["reading T3_K"]]}
    assert marks(turbojet, component, told)["covered"]


def test_a_class_that_stands_is_cannot_tell_with_a_probability_of_its_own(turbojet, component):
    told = said(["nozzle.area"])
    told["windows"][0] |= {"class": [["nozzle.area"], ["turbine.efficiency"]], "class_probability": 0.97}
    m = marks(turbojet, component, told)
    assert outcome(told) == CANNOT_TELL and m["stated_class"] == [0.97, True] and m["covered"] and "stated" not in m
    assert marks(turbojet, drawn(turbojet, kinds.NULL), told)["false_name"]


def test_of_physics_a_name_is_right_where_the_effect_acts(turbojet):
    concealed = drawn(turbojet, kinds.PHYSICS)
    from enginediag_cli.validation.trial_flights import drawable_effects

    effect = next(e for e in drawable_effects(turbojet) if e.label == "reynolds_efficiency@compressor")
    concealed = replace(concealed, effects=(effect,), changes=(ConcealedChange(effect.label, 0.0),))
    assert marks(turbojet, concealed, said(["compressor.efficiency"]))["right_name"]
    m = marks(turbojet, concealed, said(["turbine.efficiency"]))
    assert not m["right_name"] and "covered" not in m and "exact" not in m


def test_what_was_not_judged_has_no_marks_but_that(turbojet, component):
    for told, came in (
        ({"identified": False, "reason": "why"}, NOT_IDENTIFIED),
        ({"identified": True, "windows": [{"verdict": "no verdict", "named": False}]}, NO_VERDICT),
        ({"error": "it broke"}, "failed"),
    ):
        assert outcome(told) == came
        m = marks(turbojet, component, told)
        assert set(m) == {"judged", "cannot_tell", "no_verdict", "not_identified", "exact_fault", "covered_fault"}
        assert not m["exact_fault"] and not m["covered_fault"]  # of all faults, those without an answer too
    assert outcome(said([], named=False)) == NOTHING and outcome(said(["x"])) == NAMED


# counting


def records(*stated, kind=kinds.COMPONENT):
    return [
        {"truth": kinds.REALISTIC, "kind": kind, "outcome": NAMED, "marks": {"stated": [p, right]}}
        for p, right in stated
    ]


def test_reliability_counts_each_name_in_the_bin_of_its_probability():
    found = reliability(records((0.95, True), (0.92, False), (1.0, True), (0.7, True), (0.3, False)))
    bins = {(b["from"], b["to"]): (b["count"], b["of"]) for b in found["all"]}
    assert bins == {(0.9, 1.0): (2, 3), (0.7, 0.9): (1, 1), (0.0, 0.5): (0, 1)}
    assert found["component"] == found["all"] and "null" not in found


def test_the_sheet_compares_what_is_probable_with_what_was_stated():
    found = isolation_sheet(records((0.8, True), (0.8, True), (0.8, False), (0.8, True), (0.95, True)))
    assert found["right_less_stated_when_probable"]["rate"] == pytest.approx(0.75 - 0.8)
    assert found["largest_gap"]["of"] == 0  # too few names for a bin
    many = isolation_sheet(records(*[(0.8, True)] * 9, *[(0.8, False)] * 3))["largest_gap"]
    assert many["rate"] == pytest.approx(0.75 - 0.8) and many["of"] == 12
    assert found["right_when_sure"]["rate"] == 1.0 and found["right_when_sure"]["target"] == ">= 0.88"
    assert outcomes_by_kind(records((0.8, True)))["all"]["outcomes"][NAMED] == 1
