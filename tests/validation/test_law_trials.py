"""Blind trials of laws: what is drawn, what is said of it, how it is marked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from enginediag_cli.cli.validation import prove
from enginediag_cli.mismatch.explain.answer import (
    FORMULA,
    IDENTIFIED,
    NO_DISCREPANCY,
    NOT_CONVERGED,
    UNEXPLAINED,
    Answer,
    Coefficient,
    Explanation,
)
from enginediag_cli.mismatch.fit.freeform import list_locations
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION as OPTION_LAW
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.mismatch.laws.finding import FittedLaw, LawFinding
from enginediag_cli.mismatch.laws.scan import KnownVariable
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import Expression, formula_variables
from enginediag_cli.validation import concealed_formulas as forms
from enginediag_cli.validation import diagnoser as explainer
from enginediag_cli.validation import kinds
from enginediag_cli.validation import trial_flights as flights
from enginediag_cli.validation.concealed_effects import draw_engine_file, draw_truth, record_trial
from enginediag_cli.validation.concealed_formulas import (
    LAMBDA,
    LARGEST,
    OUTSIDE,
    RATIOS,
    FormulaDesign,
    FormulaRequest,
    draft_formula,
    draw_foreign_form,
    draw_formula,
    evaluate_formula,
    evaluate_variables,
    spline_basis,
)
from enginediag_cli.validation.explain_trials import run_trial
from enginediag_cli.validation.formula_marks import (
    FOUND,
    TRUE,
    AnsweredFormula,
    build_formula,
    build_formulas,
    curve_error,
    formula_entries,
    formula_json,
    gain,
    is_worse,
    null_marks,
    same_driver,
)
from enginediag_cli.validation.formula_marks import NONE as NO_LAW
from enginediag_cli.validation.marks import ExplainAnswer, trial_dataset
from enginediag_cli.validation.score_sheet import sheet
from enginediag_cli.validation.separability import separability
from enginediag_cli.validation.trial_flights import draw_flights
from enginediag_cli.validation.trials import TrialPlan, median, right_less_stated

CONFIGS = Path(__file__).parents[2] / "configs"
PATH = str(CONFIGS / "turbojet.yaml")
NULL_LAW, SINGLE_LAW = kinds.LAW_KINDS
SEED = 1103


@pytest.fixture(scope="module")
def turbojet():
    return load_engine(PATH)


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(flights, "RECORDS", (30, 34))


def drawn(engine, kind=SINGLE_LAW, trial=0, truth=kinds.SAME_MODEL):
    return draw_truth(engine, SEED, trial, (truth,), (kind,))


class Answers:
    """An explainer that says what it is given."""

    def __init__(self, answer):
        self.answer = {"explanations": [], "hidden": [], **answer}

    def ask(self, question):
        return self.answer


def law_answer(place, component, variables, entry, probability=0.9):
    return {
        "status": FORMULA,
        "law": {
            "places": [{"location": place, "component": component, "probability": probability}],
            "drivers": [{"variables": [[v] for v in variables], "probability": probability}],
            "laws": [{"entry": entry, "probability": 1.0, "label": "it"}],
            "along": [[[v] for v in variables]],
            "explained": 1.0,
            "together": probability,
            "alike": [place],
        },
    }


def truthful(law):
    return law_answer(law.place.name, law.place.component, law.law.variables, law_entry(law.effect))


def run(answer, kind=SINGLE_LAW, trial=0, truth=kinds.SAME_MODEL):
    return run_trial(TrialPlan("explain", (str(PATH),), SEED, (truth,), (kind,)), trial, Answers(answer))


# what is chosen


def test_kinds_law_and_several_stand_for_their_trials_and_are_never_drawn_unasked():
    assert (
        kinds.expand_choices((kinds.LAW,)) == kinds.LAW_KINDS
        and kinds.expand_choices((kinds.SEVERAL,)) == kinds.SEVERAL_KINDS
    )
    apart = {*kinds.LAW_KINDS, *kinds.SEVERAL_KINDS, *kinds.DYNAMIC_KINDS}
    assert not apart & set(kinds.KINDS) and apart < set(kinds.CHOICES)
    assert [kinds.base_kind(k) for k in kinds.LAW_KINDS] == [kinds.NULL, kinds.SINGLE]
    assert kinds.kinds_on_sheet(NULL_LAW) == kinds.LAW_KINDS and kinds.kinds_on_sheet(kinds.NULL) == kinds.KINDS


@pytest.mark.parametrize("choice", [kinds.LAW, kinds.SEVERAL])
def test_realistic_truths_of_laws_and_of_several_causes_are_refused(choice):
    ended = CliRunner().invoke(prove, ["--kind", choice, "--truth", "realistic", "--trials", "1"])
    assert ended.exit_code == 2 and f"{choice} does not go with --truth realistic" in ended.output


# what is drawn


def test_a_null_trial_conceals_nothing(turbojet):
    s = drawn(turbojet, NULL_LAW)
    assert (s.effects, s.values, s.causes, s.formula) == ((), {}, (), None)


@pytest.mark.parametrize("name", ["turbojet", "power_plant"])
def test_a_drawn_law_is_nothing_at_the_design_point_and_plausible_where_it_flies(name):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    s = drawn(engine)
    law = s.formula.law
    at_design = {n: np.array([v.reference]) for n, v in law.variables.items()}
    for flight in s.flights[: s.training]:
        inputs = {c: flight[c] for c in engine.inputs}
        f = evaluate_formula(s.formula.effect, evaluate_variables(engine, inputs, {}, tuple(law.variables.values())))
        # the size is corrected once, by less than a fifth, after it was judged
        assert np.abs(f).max() <= 1.2 * LARGEST * s.formula.place.scale
        assert np.abs(evaluate_formula(s.formula.effect, at_design)).max() <= 1e-4 * np.abs(f).max()


@pytest.mark.parametrize("truth", kinds.USUAL)
def test_the_size_of_a_law_is_that_of_the_non_centrality_that_was_drawn(few, turbojet, truth):
    for k in range(2):
        s = drawn(turbojet, trial=k, truth=truth)
        clean = trial_dataset(turbojet, s, record_trial(turbojet, s), clean=True)
        separation = separability(clean, s.causes, dict(s.health), ())
        assert separation.ok and 0.8 * LAMBDA[0] <= separation.total <= 1.25 * LAMBDA[1]


@pytest.mark.parametrize("name", OUTSIDE)
def test_every_form_outside_the_grammar_makes_a_formula_that_is_nothing_at_the_design_point(
    turbojet, monkeypatch, name
):
    monkeypatch.setattr(forms, "OUTSIDE", {name: OUTSIDE[name]})
    known = formula_variables(turbojet.network)
    rng = np.random.default_rng(3)
    names = ("turbine_reynolds_index", "nozzle_pressure_ratio")
    of = [
        KnownVariable(known[n], np.linspace(0.55, 1.1, 40) + 0.01 * rng.standard_normal(40), k)
        for k, n in enumerate(names)
    ]
    shaped = draw_foreign_form(of[: 1 + any(letter in OUTSIDE[name].replace("exp", "") for letter in "yv")], rng)
    f = Expression.parse(shaped.text)
    assert abs(f.evaluate({"a": 1.0, **dict.fromkeys(names, 1.0)})) < 1e-12
    values = np.asarray(f.evaluate({"a": 1.0, **{k.variable.name: k.values for k in of}}))
    assert np.isfinite(values).all() and np.ptp(values) > 1e-6
    assert set(RATIOS) <= set(OUTSIDE)


def test_a_law_of_two_variables_is_one_that_no_curve_of_one_says(few, turbojet):
    design = FormulaDesign.from_flights(turbojet, draw_flights(turbojet, np.random.default_rng(0))[0][:4], 0.0)
    rng = np.random.default_rng(1)
    found = [law for _ in range(60) if (law := draft_formula(design, FormulaRequest.draw(rng), rng)) is not None]
    two = [law for law in found if len(law.law.variables) == 2]
    assert two and len(two) < len(found)
    values = {k.variable.name: k.values for k in design.variables}
    for law in two:
        x = evaluate_formula(law.effect, values)
        left = [
            design.gram(law.place, (x - b @ np.linalg.lstsq(b, x, rcond=None)[0])[:, None])[0, 0]
            for k in law.law.variables
            for b in [np.column_stack([np.ones(len(x)), spline_basis(values[k])])]
        ]
        assert min(left) > 20.0


def test_flights_four_kilometres_higher_stay_within_the_envelope(turbojet):
    law = draw_formula(turbojet, *draw_flights(turbojet, np.random.default_rng(2)), 0.0, np.random.default_rng(5))
    ceiling = turbojet.envelope["altitude_m"][1]
    altitude = np.concatenate([f["altitude_m"] for f in law.higher])
    assert altitude.min() >= 4000.0 and altitude.max() <= ceiling
    assert np.mean(altitude == ceiling) == pytest.approx(law.ceiling_share)
    for f in law.higher:
        assert turbojet.predict({c: f[c] for c in turbojet.inputs}).ok.mean() > 0.9


# what is said, and read


def test_a_law_that_is_said_is_the_law_that_an_engine_carries(turbojet):
    s = drawn(turbojet)
    said = build_formula(turbojet, law_entry(s.formula.effect))
    one, other = (turbojet.replace_effects((e,)) for e in (s.formula.effect, said))
    u = {c: s.flights[0][c] for c in turbojet.inputs}
    assert np.allclose(one.predict(u).y, other.predict(u).y, rtol=1e-6)
    assert build_formula(turbojet, {**law_entry(s.formula.effect), "at": "nowhere"}) is None


def test_what_is_found_of_a_law_is_told_with_the_coefficients_that_were_fitted(turbojet):
    law = drawn(turbojet).formula
    option = Option(OPTION_LAW, law.effect.label, law.place.component, law.law.DRIVER, Hypothesis((law.effect,)))
    ((name, value),) = law.values.items()
    fitted = Coefficient(name, "1", 0.7 * value, 0.0, 0.0, 0.0)
    explained = Explanation((option,), (fitted,), 0.0, 90.0, 1.0, 0.0, 1.0)
    variables = tuple(law.law.variables.values())
    finding = LawFinding(
        (FittedLaw(option, law.place, None, 50.0, 1.0),),
        ((law.place, 0.8),),
        (((variables,), 0.9),),
        100.0,
        0.9,
        (0.0, 0.0),
        "1",
        None,
    )
    nothing = Answer(
        FORMULA, "", (explained,), (), (), (), (), (0.0, 0.0), 0.0, 0.0, 0, {}, {}, np.zeros(0, int), law=finding
    )
    raw = {"explanations": [{"laws": formula_entries(explained)}], **formula_json(nothing)}
    told = AnsweredFormula.from_json(json.loads(json.dumps(raw)))
    assert told.places == ((law.place.name, 0.8),) and told.explained == 0.9
    assert told.drivers == (((tuple(v.name for v in variables),), 0.9),) and told.driver_groups == (told.drivers[0][0],)
    (effect,) = build_formulas(turbojet, told.entries)
    assert effect.values["a"] == pytest.approx(0.7 * value, rel=1e-5)
    assert raw["law"]["laws"][0]["entry"] == raw["explanations"][0]["laws"][0]
    assert AnsweredFormula.from_json({"status": UNEXPLAINED}) is None


@pytest.mark.slow
def test_what_is_concealed_is_in_no_answer_of_the_explainer_but_its_own(few):
    class InProcess:
        def ask(self, question):
            self.told = explainer.answer(question)
            return self.told

    asked = InProcess()
    found = run_trial(TrialPlan("explain", (str(PATH),), SEED, (kinds.SAME_MODEL,), (SINGLE_LAW,)), 0, asked)
    assert not found["error"] and found["engine"] == "turbojet" and found["marks"]["no_verdict"] is False
    assert "concealed" not in str(asked.told)
    if found["status"] == FORMULA:
        assert asked.told["law"]["places"] and found["law"]["found"]


# how it is marked


@pytest.mark.parametrize("truth", kinds.USUAL)
def test_the_truth_is_right_in_everything(few, turbojet, truth):
    law = drawn(turbojet, truth=truth).formula
    m = run(truthful(law), truth=truth)["marks"]
    for name in (
        "place",
        "place_exact",
        "component",
        "driver",
        "curve",
        "place_of_all",
        "driver_of_all",
        "curve_of_all",
    ):
        assert m[f"law_{name}"] is True, name
    assert m["law_given"] and m["law_found"] and m["law_alone"] and not m["law_wrong_name"]
    assert m["law_error"][0] < 1e-4 and m["law_worse"] == [0.0, 0.0] and m["stated"] == [0.9, True]
    # the true law with its size fitted to noise, which the law as it is need not follow
    assert all(m[f"law_gain_{name}"][0] > 0.9 for name in ("unseen", "higher") if f"law_gain_{name}" in m)


@pytest.mark.slow
def test_the_truth_is_the_truth_where_a_large_law_has_driven_the_fit_without_it_into_another_valley(monkeypatch):
    """A wave, as laws were drawn while no grammar had one. From the fit without it, the fit with the true law ended 330
    of chi-square above the truth."""
    first = list(OUTSIDE.items())
    monkeypatch.setattr(forms, "OUTSIDE", dict([*first[:3], ("swing", "u * exp(-u ** 2)"), *first[3:]]))
    engines = tuple(str(CONFIGS / f"{n}.yaml") for n in ("turbofan", "turbojet", "power_plant", "turboshaft"))
    truths, seed, trial = (kinds.SAME_MODEL, kinds.MAP_ERROR), 7601, 27
    concealed = draw_truth(load_engine(draw_engine_file(engines, seed, trial)), seed, trial, truths, kinds.LAW_KINDS)
    plan = TrialPlan("explain", engines, seed, truths, kinds.LAW_KINDS)
    r = run_trial(plan, trial, Answers(truthful(concealed.formula)))
    assert r["law"]["distance"] < 0.1
    assert r["marks"]["law_gain_unseen"] == [pytest.approx(1.0, abs=0.01)]


@pytest.mark.parametrize("status", [NO_DISCREPANCY, UNEXPLAINED])
def test_silence_finds_nothing_and_says_nothing_false(few, status):
    m = run({"status": status})["marks"]
    assert m["law_given"] is False and m["law_found"] is (status == UNEXPLAINED) and m["law_wrong_name"] is False
    assert not any(m[f"law_{name}_of_all"] for name in ("place", "driver", "curve"))
    assert "law_place" not in m and "law_worse" not in m


def test_a_law_at_a_wrong_place_along_a_wrong_variable_is_wrong_and_predicts_worse_than_none(few, turbojet):
    law = drawn(turbojet).formula
    place = next(p for p in list_locations(turbojet, list(turbojet.sensors)) if p.name == "compressor.flow_capacity")
    assert place.name != law.place.name
    entry = law_entry(law.effect) | {
        "at": place.parameter,
        "expression": "a * (mach - 0)",
        "coefficients": {"a": {"value": 0.06, "absent": 0.0, "prior_sigma": 0.05}},
    }
    found = run(law_answer(place.name, place.component, ["mach"], entry))
    m = found["marks"]
    assert not m["law_place"] and not m["law_curve"] and m["stated"] == [0.9, False] and m["law_worse"][0] == 1.0
    assert "law_error" not in m and found["law"]["distance"] > 11.0


def test_where_nothing_is_concealed_any_law_is_false():
    assert null_marks(ExplainAnswer.from_json({"status": FORMULA, "explanations": []}))["law_false"] is True
    quiet = null_marks(ExplainAnswer.from_json({"status": NO_DISCREPANCY, "explanations": []}))
    assert not (quiet["law_false"] or quiet["law_false_name"] or quiet["law_false_finding"])
    named = null_marks(ExplainAnswer.from_json({"status": IDENTIFIED, "explanations": []}))
    assert named["law_false_name"] and not named["law_false"]
    assert (
        null_marks(ExplainAnswer.from_json({"error": "it broke"})) == {"no_verdict": True} and NOT_CONVERGED != FORMULA
    )


def test_a_driver_is_right_where_every_variable_is_told_by_a_group_of_its_own():
    x = np.linspace(0.0, 1.0, 50)
    values = {"a": x, "b": x + 1e-3 * np.sin(50 * x), "c": np.cos(6 * x)}
    assert same_driver(["a"], [["b", "c"]], values) and not same_driver(["a"], [["c"]], values)
    assert same_driver(["a", "c"], [["c"], ["b"]], values) and not same_driver(["a", "c"], [["a"], ["b"]], values)
    assert not same_driver(["a"], [["a"], ["c"]], values) and not same_driver(["a", "c"], [["a"]], values)
    assert same_driver(["unrecorded"], [["unrecorded"]], values)


def test_a_constant_is_no_error_of_a_curve():
    f = np.linspace(-1.0, 1.0, 30)
    assert curve_error(f + 7.0, f) < 1e-12
    assert curve_error(2.0 * f, f) == pytest.approx(np.std(f) / 2.0)


def test_gain_is_the_share_of_what_the_true_law_takes_away():
    excess = {NO_LAW: 100.0, TRUE: 20.0, FOUND: 40.0}
    assert gain(excess, FOUND) == 0.75 and gain(excess, TRUE) == 1.0 and not is_worse(excess, FOUND)
    assert is_worse({**excess, FOUND: 101.0}, FOUND)
    little = {NO_LAW: 10.0, TRUE: 2.0, FOUND: 30.0}
    assert gain(little, FOUND) is None and not is_worse(little, FOUND) and is_worse({**little, FOUND: 36.0}, FOUND)


def test_a_spline_is_straight_beyond_its_outer_knots_and_holds_the_straight_line():
    x = np.linspace(0.0, 1.0, 200)
    separation = np.array([2.0, 3.0, 4.0])
    B = spline_basis(np.concatenate([x, separation]), x)
    assert np.allclose(np.diff(B[-3:], 2, axis=0), 0.0, atol=1e-9)
    assert np.allclose(B[:200].mean(axis=0), 0.0, atol=1e-12) and np.allclose(B[:200].std(axis=0), 1.0)
    assert np.linalg.matrix_rank(np.column_stack([np.ones(200), B[:200]])) == 4
    fitted = np.linalg.lstsq(B[:200], x - x.mean(), rcond=None)
    assert np.allclose(B[:200] @ fitted[0], x - x.mean(), atol=1e-9)


# counting


def test_a_median_has_an_interval_of_order_statistics():
    found = median([float(k) for k in range(10)])  # second and ninth of ten: 97.9 %
    assert (found["rate"], found["low"], found["high"], found["of"]) == (4.5, 1.0, 8.0, 10)
    assert median([1.0, 2.0])["low"] is None


def test_what_is_stated_is_held_against_how_often_it_is_right():
    found = right_less_stated([(0.9, True), (0.9, True), (0.9, False), (0.9, True)], 0.0, np.inf)
    assert found["rate"] == pytest.approx(0.75 - 0.9)


def test_scores_of_laws_are_told_only_where_there_are_such_trials():
    still = {"truth": kinds.SAME_MODEL, "kind": kinds.SINGLE, "marks": {"exact": True, "no_verdict": False}}
    law = {
        "truth": kinds.MAP_ERROR,
        "kind": SINGLE_LAW,
        "marks": {"law_place": True, "law_gain_unseen": [0.9], "stated": [0.8, True], "no_verdict": False},
    }
    assert not any(name.startswith(("law_", "several_")) for name in sheet([still]))
    both = sheet([still, law])
    assert (
        both["law_place"][kinds.MAP_ERROR]["rate"] == 1.0 and both["law_place"][kinds.MAP_ERROR]["target"] == ">= 0.90"
    )
    assert both["law_gain_unseen"]["rate"] == 0.9
    assert both["law_place_right_less_stated"]["rate"] == pytest.approx(0.2)
    assert both["no_verdict"]["of"] == 1 and both["law_no_verdict"]["of"] == 1
