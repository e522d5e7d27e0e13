"""Blind trials: what is drawn, what is handed over, how it is marked and counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE, IDENTIFIED, NO_DISCREPANCY, NOT_CONVERGED, UNEXPLAINED
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import term_names
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import (
    draw_truth,
    record_trial,
    true_flight_readings,
    write_trial_files,
)
from enginediag_cli.validation.marks import ExplainAnswer, hidden_marks, interval_marks, marks, trial_dataset
from enginediag_cli.validation.score_sheet import sheet
from enginediag_cli.validation.separability import Separability, separability
from enginediag_cli.validation.trial_flights import (
    SELDOM,
    Cause,
    cause_names,
    causes_hypothesis,
    check_engine,
    draw_flights,
    draw_weights,
    drawable_effects,
    stack_flights,
)
from enginediag_cli.validation.trials import rate, target_met, trials_journal, wilson
from enginediag_cli.validation.truth_engines import draw_map_errors

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def turbofan():
    return load_engine(CONFIGS / "turbofan.yaml")


def drawn(engine, kind, trial=0, truth=kinds.SAME_MODEL, seed=5):
    return draw_truth(engine, seed, trial, (truth,), (kind,))


# what is drawn


def test_a_trial_does_not_depend_on_the_trials_before_it(turbofan):
    alone = draw_truth(turbofan, 3, 7, kinds.TRUTHS, kinds.KINDS)
    for k in range(3):
        draw_truth(turbofan, 3, k, kinds.TRUTHS, kinds.KINDS)
    again = draw_truth(turbofan, 3, 7, kinds.TRUTHS, kinds.KINDS)
    assert again.causes == alone.causes and again.health == alone.health and again.noise_seed == alone.noise_seed
    assert all(np.array_equal(a[c], b[c]) for a, b in zip(alone.flights, again.flights, strict=True) for c in a)


def test_other_trials_and_other_seeds_are_other_engines(turbofan):
    a, b, c = (draw_truth(turbofan, s, k, kinds.TRUTHS, kinds.KINDS) for s, k in ((3, 7), (3, 8), (4, 7)))
    assert a.health != b.health and a.health != c.health


@pytest.mark.parametrize("name", sorted(p.stem for p in CONFIGS.glob("*.yaml")))
def test_every_engine_is_flown_inside_its_envelope_where_it_has_a_solution(name):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    flights, training = draw_flights(engine, np.random.default_rng(0))
    assert 4 <= training <= 6 and len(flights) == training + 2
    assert all(50 <= len(f["time_s"]) <= 70 for f in flights)
    u = stack_flights(flights)
    for column, (low, high) in engine.envelope.items():
        if column in engine.inputs:
            assert low <= u[column].min() and u[column].max() <= high
    assert engine.predict({c: u[c] for c in engine.inputs}).ok.all()


def test_an_engine_of_which_nothing_says_how_it_is_run_is_refused(tmp_path):
    text = (CONFIGS / "turboshaft.yaml").read_text(encoding="utf-8")
    path = tmp_path / "engine.yaml"
    path.write_text(text.replace("  N2_rpm: {low: 20200, high: 21600}\n", ""), encoding="utf-8")
    with pytest.raises(DataError, match="other inputs need a range"):
        check_engine(str(path))


@pytest.mark.parametrize(
    ("kind", "effects", "steps"),
    [
        (kinds.NULL, 0, 0),
        (kinds.SINGLE, 1, 0),
        (kinds.PAIR, 2, 0),
        (kinds.WITHHELD, 1, 0),
        (kinds.FAULT, 0, 1),
        (kinds.EFFECT_AND_FAULT, 1, 1),
        (kinds.HIDDEN_SWITCH, 1, 0),
    ],
)
def test_every_kind_conceals_what_it_says(turbofan, kind, effects, steps):
    for k in range(5):
        s = drawn(turbofan, kind, k)
        assert sum(not c.is_step for c in s.causes) == effects == len(s.effects)
        assert sum(c.is_step for c in s.causes) == steps and (s.change != 0) == bool(steps)
        assert s.withheld_terms == (tuple(e.term.NAME for e in s.effects) if kind == kinds.WITHHELD else ())
        for e in s.effects:
            for c in e.term.amplitudes():
                size = (s.values[e.parameter_name(c.name)] - c.absent) / (c.typical - c.absent)
                assert 0.3 <= size <= 1.5
        if kind == kinds.HIDDEN_SWITCH:
            assert s.effects[0].term.SWITCHES and set(np.unique(s.states)) == {0.0, 1.0}


def test_an_effect_that_needs_a_column_of_hours_is_drawn_because_hours_are_recorded(turbofan):
    assert any(e.term.NAME == "fouling" for e in drawable_effects(turbofan))
    assert "hours_since_wash_h" in drawn(turbofan, kinds.NULL).flights[0]


def test_effects_that_identification_absorbs_are_drawn_seldom(turbofan):
    found = draw_weights(turbofan.path, 1.5)
    assert set(found) == {e.label for e in drawable_effects(turbofan)} and set(found.values()) == {1.0, SELDOM}
    assert found["reynolds_efficiency@hpc"] == 1.0 and found["fuel_heating_value@burner"] == SELDOM


# truth engines


def test_map_errors_are_in_no_library_and_change_the_readings_by_less_than_two_per_cent(turbofan):
    s = drawn(turbofan, kinds.NULL, truth=kinds.MAP_ERROR)
    wrong, right = (
        true_flight_readings(turbofan, s, exact_model=False),
        true_flight_readings(turbofan, s, exact_model=True),
    )
    assert 1e-4 < np.abs(wrong / right - 1.0).max() < 0.02
    assert not any("map_error" in n for n in term_names())


def test_map_errors_vanish_at_the_design_point(turbofan):
    effects = draw_map_errors(turbofan, np.random.default_rng(1)).effects
    u = {c: np.array([float(turbofan.network.design.get(c, 0.0))]) for c in turbofan.inputs}
    u[turbofan.power_setting] = turbofan.power_from_fraction(1.0, u)
    low = {**u, turbofan.power_setting: 0.6 * u[turbofan.power_setting]}
    at, away = (turbofan.replace_effects(effects).predict(x).y / turbofan.predict(x).y - 1.0 for x in (u, low))
    assert np.abs(at).max() < 0.3 * np.abs(away).max()


def test_the_open_folder_shows_no_effect(turbofan, tmp_path):
    s = drawn(turbofan, kinds.HIDDEN_SWITCH)
    engine, files = write_trial_files(tmp_path, turbofan, record_trial(turbofan, s), s.training)
    assert engine.read_bytes() == (CONFIGS / "turbofan.yaml").read_bytes()
    assert len(files) == s.training
    header = files[0].read_text(encoding="utf-8").splitlines()[0].split(",")
    known = {"time_s", "hours_since_wash_h", "hours_since_filter_change_h", *turbofan.inputs, *turbofan.sensors}
    assert set(header) == known
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([engine.name, *(f.name for f in files)])


def test_noise_has_the_stated_size_and_correlation(turbofan):
    s = drawn(turbofan, kinds.NULL)
    s = replace(s, noise=replace(s.noise, factor=1.5, rho=0.6), flights=s.flights * 6)
    r = record_trial(turbofan, s)
    e = np.concatenate([a.columns["T45_K"] - b.columns["T45_K"] for a, b in zip(r.noisy, r.clean, strict=True)])
    # about 2 500 records worth 600 independent ones: 3 standard errors of a standard deviation are 9 %
    assert np.std(e) == pytest.approx(1.5 * turbofan.sensors["T45_K"].noise_sigma, rel=0.09)
    assert np.corrcoef(e[1:], e[:-1])[0, 1] == pytest.approx(0.6, abs=0.06)


# how far the truth is from its rivals


def test_the_true_model_fits_noise_free_recordings_without_residual(turbofan):
    s = drawn(turbofan, kinds.SINGLE)
    effect = next(e for e in drawable_effects(turbofan) if e.label == "reynolds_efficiency@hpc")
    s = replace(s, effects=(effect,), causes=(Cause(effect.label),), values={"reynolds_efficiency.hpc.exponent": 0.08})
    evidence = trial_dataset(turbofan, s, record_trial(turbofan, s), clean=True)
    separation = separability(evidence, s.causes, dict(s.health), ())
    assert separation.ok and separation.conditional == (separation.total,)
    assert separation.total > 100 and 0 < separation.nearest < separation.total and not separation.aliases
    # half the coefficient, a quarter of λ; not exactly, since the engine is not linear
    half = replace(s, values={"reynolds_efficiency.hpc.exponent": 0.04})
    evidence = trial_dataset(turbofan, half, record_trial(turbofan, half), clean=True)
    assert separability(evidence, s.causes, dict(s.health), ()).total == pytest.approx(separation.total / 4, rel=0.1)


def test_nothing_concealed_is_no_misfit(turbofan):
    s = drawn(turbofan, kinds.NULL)
    evidence = trial_dataset(turbofan, s, record_trial(turbofan, s), clean=True)
    assert separability(evidence, (), dict(s.health), ()).total < 1e-3


def test_causes_become_something_to_fit_and_come_back_the_same(turbofan):
    causes = (Cause("reynolds_efficiency@hpc"), Cause("hpc.efficiency", 120))
    h = causes_hypothesis(turbofan, causes, 300)
    assert h.effects[0].label == "reynolds_efficiency@hpc"
    (curve,) = h.curves.values()
    assert curve.sum() == 180 and cause_names(causes) == frozenset({"reynolds_efficiency@hpc", "hpc.efficiency"})


# marks


def said(status, *names, coefficients=None):
    raw = {
        "explanations": [
            {
                "causes": [{"name": n, "first": -1} for n in name],
                "kinds": ["effect"],
                "probability": 1.0 / len(names),
                "coefficients": coefficients or {},
            }
            for name in names
        ],
        "status": status,
        "hidden": [],
    }
    return ExplainAnswer.from_json(raw)


FAR = Separability(400.0, (400.0,), 60.0, "b@x", frozenset(), True)


@pytest.fixture(scope="module")
def single(turbofan):
    return replace(drawn(turbofan, kinds.SINGLE), causes=(Cause("a@x"),), values={"a.x.k": 1.0})


def test_the_right_name_is_exact_covered_and_tight(single):
    m = marks(single, FAR, said(IDENTIFIED, ["a@x"]))
    assert m["exact"] and m["covered"] and m["tight"] and m["set_score"] == [1.0] and not m["false_name"]


def test_a_right_name_among_two_is_covered_not_tight_and_scores_half(single):
    m = marks(single, FAR, said(IDENTIFIED, ["b@x"], ["a@x"]))
    assert not m["exact"] and m["covered"] and not m["tight"] and m["set_score"] == [0.5] and not m["false_name"]


def test_an_unavoidable_alias_is_no_false_name_and_not_in_the_denominator_of_exact(single):
    separation = replace(FAR, nearest=3.0, aliases=frozenset({frozenset({"b@x"})}))
    m = marks(single, separation, said(IDENTIFIED, ["b@x"]))
    assert not m["false_name"] and "exact" not in m and not m["covered"]


def test_a_wrong_name_is_false_and_none_of_these_is_wrongly_none(single):
    assert marks(single, FAR, said(IDENTIFIED, ["c@x"]))["false_name"]
    m = marks(single, FAR, said(UNEXPLAINED))
    assert m["wrongly_none"] and not m["covered"] and m["set_score"] == [0.0] and not m["false_name"]


def test_any_name_is_false_where_nothing_is_missing(single):
    null = replace(single, kind=kinds.NULL, causes=())
    assert marks(null, None, said(IDENTIFIED, ["a@x"]))["false_name"]
    assert marks(null, None, said(HIDDEN_STATE))["false_name"]
    m = marks(null, None, said(UNEXPLAINED))
    assert not m["false_name"] and m["false_finding"]
    assert not marks(null, None, said(NO_DISCREPANCY))["false_finding"]


def test_a_grey_trial_has_no_mark_but_a_false_name(single):
    grey = replace(FAR, total=12.0, conditional=(12.0,))
    assert set(marks(single, grey, said(NO_DISCREPANCY))) == {"no_verdict", "false_name"}


def test_a_search_that_failed_is_no_verdict_and_nothing_else(single):
    assert marks(single, FAR, said(NOT_CONVERGED)) == {"no_verdict": True}
    assert marks(single, FAR, ExplainAnswer.from_json({"error": "it broke"})) == {"no_verdict": True}


def test_none_of_these_is_right_only_when_every_rival_is_far(single):
    withheld = replace(single, kind=kinds.WITHHELD)
    assert marks(withheld, FAR, said(UNEXPLAINED))["none_right"]
    assert not marks(withheld, FAR, said(IDENTIFIED, ["b@x"]))["none_right"]
    assert "none_right" not in marks(withheld, replace(FAR, nearest=20.0), said(UNEXPLAINED))


def test_a_part_of_the_truth_is_not_a_false_name(single):
    pair = replace(single, kind=kinds.PAIR, causes=(Cause("a@x"), Cause("b@x")))
    separation = Separability(400.0, (300.0, 90.0), 60.0, "c@x", frozenset(), True)
    m = marks(pair, separation, said(IDENTIFIED, ["a@x"]))
    assert not m["false_name"] and not m["covered"]
    assert marks(pair, separation, said(IDENTIFIED, ["b@x", "a@x"]))["exact_no_alias"]


def test_interval_asks_the_explanation_that_is_the_truth(turbofan, single):
    one = replace(single, effects=tuple(drawable_effects(turbofan)[:1]))
    inside = said(IDENTIFIED, ["b@x"], ["a@x"], coefficients={"a.x.k": [1.1, 0.9, 1.3]})
    assert interval_marks(one, inside) == {"interval": [1.0]}
    outside = said(IDENTIFIED, ["a@x"], coefficients={"a.x.k": [1.5, 1.2, 1.8]})
    assert interval_marks(one, outside) == {"interval": [0.0]}
    assert interval_marks(one, said(IDENTIFIED, ["b@x"])) == {}


def test_states_of_a_hidden_switch_are_marked_where_the_records_show_it():
    states, snr = np.array([0.0, 1.0, 1.0, 0.0]), np.array([3.0, 3.0, 3.0, 0.5])
    raw = {
        "status": HIDDEN_STATE,
        "explanations": [],
        "hidden": [{"component": "hpc", "number": [0, 1, 2, 3], "states": [0.1, 0.9, 0.2, 0.9], "sign": 1}],
    }
    m = hidden_marks({"hpc"}, states, snr, ExplainAnswer.from_json(raw))
    assert m["hidden_location"] and m["hidden_states"] == [pytest.approx(2 / 3)]
    raw["hidden"][0] |= {"states": [0.9, 0.1, 0.1, 0.1], "sign": 0}
    assert hidden_marks({"hpc"}, states, snr, ExplainAnswer.from_json(raw))["hidden_states"] == [1.0]
    assert "hidden_location_weak" in hidden_marks({"hpc"}, states, snr / 3, ExplainAnswer.from_json(raw))


# counting


def test_wilson_interval_of_published_numbers():
    # Newcombe 1998, Stat. Med. 17, 857, table I: 15 of 148 and 0 of 20
    assert wilson(15, 148) == (pytest.approx(0.0624, abs=5e-5), pytest.approx(0.1605, abs=5e-5))
    assert wilson(0, 20) == (0.0, pytest.approx(0.1611, abs=5e-5))


def test_a_rate_counts_marks_and_lists_of_them():
    assert rate([True, True, False])["count"] == 2
    assert rate([[1.0, 0.0], [1.0]])["of"] == 3
    assert rate([[0.5], [1.0]])["rate"] == 0.75
    assert rate([])["rate"] is None and rate([])["of"] == 0


def test_the_sheet_splits_by_truth_and_kind():
    records = [
        {"truth": t, "kind": k, "marks": {"covered": c, "no_verdict": False}}
        for t, k, c in [
            ("same_model", "single", True),
            ("same_model", "single", False),
            ("map_error", "single", True),
            ("same_model", "pair", False),
        ]
    ]
    found = sheet(records)
    assert found["covered"]["rate"] == pytest.approx(2 / 3)
    assert found["covered"]["same_model"]["rate"] == 0.5
    assert found["covered"]["same_model"]["kinds"]["pair"]["rate"] == 0.0
    assert found["no_verdict"]["of"] == 4


@pytest.mark.parametrize(
    ("value", "target", "verdict"),
    [
        (0.98, ">= 0.97", "yes"),
        (0.96, ">= 0.97", "no"),
        (1.2, "<= 1.3", "yes"),
        (0.99, "0.92 to 0.98", "no"),
        (None, ">= 0.97", ""),
        (0.5, "", ""),
    ],
)
def test_targets_are_judged_as_they_are_worded(value, target, verdict):
    assert target_met(value, target) == verdict


def test_a_journal_goes_on_after_a_line_cut_short(tmp_path):
    journal = trials_journal(tmp_path / "t.jsonl", "key")
    journal.add(1, {"trial": 1, "marks": {}})
    journal.add(0, {"trial": 0, "marks": {}})
    with open(journal.path, "a", encoding="utf-8") as stream:
        stream.write('{"trial": 2, "ma')
    found = journal.read()
    assert sorted(found) == [0, 1]
    journal.write(dict(sorted(found.items())))
    assert [line.split(",")[0] for line in journal.path.read_text(encoding="utf-8").splitlines()[1:]] == [
        '{"trial": 0',
        '{"trial": 1',
    ]


def test_a_journal_of_other_trials_is_refused(tmp_path):
    trials_journal(tmp_path / "t.jsonl", "key").write({})
    with pytest.raises(DataError, match="another seed, choice or engine"):
        trials_journal(tmp_path / "t.jsonl", "other").read()
    (tmp_path / "x.jsonl").write_text("hello\n", encoding="utf-8")
    with pytest.raises(DataError, match="not a file of trials"):
        trials_journal(tmp_path / "x.jsonl", "key").read()
