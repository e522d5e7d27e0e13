"""Blind trials of several causes: what is drawn, what is named, how it is marked."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.mismatch.explain.answer import IDENTIFIED, NO_DISCREPANCY, NOT_CONVERGED
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import Law
from enginediag_cli.validation import concealed_effects as sealing
from enginediag_cli.validation import explain_trials as trials
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import SHOWS, SIZE, ConcealedPart, draw_truth, record_trial
from enginediag_cli.validation.concealed_formulas import NothingVisibleError
from enginediag_cli.validation.explain_trials import independent_variables, match_causes, named_causes, run_trial
from enginediag_cli.validation.marks import ExplainAnswer
from enginediag_cli.validation.score_sheet import sheet
from enginediag_cli.validation.trial_flights import Cause, drawable_effects
from enginediag_cli.validation.trials import TrialPlan

CONFIGS = Path(__file__).parents[2] / "configs"
PATH = str(CONFIGS / "turbojet.yaml")
TWO, THREE, FOUR = kinds.SEVERAL_KINDS
SEED = 1105
SIZE_OF_A_LAW = {"coefficients": {"a": {"value": 0.01, "absent": 0.0, "prior_sigma": 0.02, "description": "size"}}}


@lru_cache
def concealed(kind, trial, truth):
    return draw_truth(load_engine(PATH), SEED, trial, (truth,), (kind,))


@pytest.fixture(autouse=True)
def drawn_once(monkeypatch):
    """Trials do not depend on what was drawn before them, so that one drawing serves all tests."""
    monkeypatch.setattr(
        trials, "draw_truth", lambda engine, seed, trial, truths, ks: concealed(ks[0], trial, truths[0])
    )


@pytest.fixture(scope="module")
def turbojet():
    return load_engine(PATH)


def drawn(kind, trial=0, truth=kinds.SAME_MODEL):
    return concealed(kind, trial, truth)


class Names:
    """An explainer that names these causes."""

    def __init__(self, causes, coefficients=None, laws=(), unexplained=None):
        explained = {
            "causes": [c.to_json() for c in causes],
            "kinds": ["effect"] * len(causes),
            "probability": 1.0,
            "gain": 1.0,
            "left": 0.0,
            "flights": 1.0,
            "coefficients": {n: [v, v, v] for n, v in (coefficients or {}).items()},
            "laws": list(laws),
        }
        status, found = (IDENTIFIED, [explained]) if causes else (NO_DISCREPANCY, [])
        self.told = {"status": status, "explanations": found, "hidden": [], "unexplained": unexplained}

    def ask(self, question):
        return self.told


def run(answers, kind, trial=0, truth=kinds.SAME_MODEL):
    return run_trial(TrialPlan("explain", (str(PATH),), SEED, (truth,), (kind,)), trial, answers)


def true_causes(engine, s):
    recorded = record_trial(engine, s)
    return [recorded.place_cause(c) for c in s.causes]


def entries(s):
    return [law_entry(s.formula.effect)] if s.formula else []


# what is drawn


@pytest.mark.parametrize(("kind", "count"), [(TWO, 2), (THREE, 3), (FOUR, 4)])
def test_so_many_causes_of_mixed_kinds_are_concealed(kind, count):
    for k in range(2 if kind == TWO else 1):
        s = drawn(kind, k)
        laws = [e for e in s.effects if isinstance(e.term, Law)]
        steps = [c for c in s.causes if c.is_step]
        assert len(s.causes) == count == len({c.name for c in s.causes}) == len(s.effects) + len(steps)
        assert set(s.changes) == {c.name for c in steps} and len(steps) <= 2 and len(laws) <= 1
        assert (s.formula is not None) == bool(laws)
        of_library = len(s.effects) - len(laws)
        of_sensors = sum(c.name.startswith("sensor.") for c in steps)
        counts = (of_library, len(laws), len(steps) - of_sensors, of_sensors)
        assert sum(n > 0 for n in counts) >= 2 and max(counts[1:]) <= 1


def test_sizes_stay_within_what_is_plausible():
    step = ConcealedPart("fault", Cause("compressor.efficiency", 9), 1.0, change=-0.01)
    assert step.scaled(100.0).size == SIZE[1] and step.scaled(1e-6).size == SIZE[0]
    s = drawn(THREE)
    for e in s.effects:
        for c in () if isinstance(e.term, Law) else e.term.amplitudes():
            assert c.lower < s.values[e.parameter_name(c.name)] < c.upper


def test_a_cause_that_would_end_at_a_bound_is_drawn_anew(turbojet):
    first = next(e for e in drawable_effects(turbojet) if all(np.isfinite(c.upper) for c in e.term.amplitudes()))
    values = {c.name: c.absent + 0.6 * (c.upper - c.absent) for c in first.term.amplitudes()}
    part = ConcealedPart("effect", Cause(first.label), 1.0, replace(first, values=values))
    assert part.is_plausible
    assert not part.scaled(2.0).is_plausible and not part.scaled(1.0 / 0.6).is_plausible


# how it is marked


@pytest.mark.parametrize(("kind", "truth"), [(TWO, kinds.MAP_ERROR), (THREE, kinds.SAME_MODEL)])
def test_the_truth_is_all_named_none_false_and_leaves_nothing(turbojet, kind, truth):
    s = drawn(kind, truth=truth)
    found = run(Names(true_causes(turbojet, s), s.values, entries(s), unexplained=0.0), kind, truth=truth)
    m = found["marks"]
    assert m["several_all"] is True and m["several_share"] == [1.0] and m["several_none_false"] is True
    assert m["several_unexplained"] is True and found["several"]["stays"] < 0.05
    assert min(found["given"]) >= SHOWS and found["engine"] == "turbojet"


def test_silence_names_nothing_and_nothing_false():
    m = run(Names([], unexplained=1.0), TWO)["marks"]
    assert m["several_all"] is False and m["several_share"] == [0.0] and m["several_none_false"] is True
    assert m["several_unexplained"] is True


def test_a_part_of_the_truth_counts_as_a_part_and_what_is_not_there_is_false(turbojet):
    s = drawn(THREE)
    first, *_ = causes = true_causes(turbojet, s)
    laws = [x for x in entries(s) if s.formula.effect.label == first.name]
    part = run(Names([first], s.values, laws, unexplained=0.0), THREE)
    m = part["marks"]
    assert m["several_share"] == [pytest.approx(1 / 3)] and not m["several_all"] and m["several_none_false"]
    assert part["several"]["stays"] > 0.1 and m["several_unexplained"] is False
    wrong = next(n for n in ("sensor.N1.scale", "sensor.Wf.scale", "sensor.T5.scale") if n not in str(causes))
    m = run(Names([Cause(wrong, 40)]), THREE)["marks"]
    assert not m["several_none_false"] and m["several_share"] == [0.0]


def test_when_a_step_began_is_no_part_of_its_name(turbojet):
    s = drawn(FOUR)
    moved = [Cause(c.name, c.first + 15) if c.is_step else c for c in true_causes(turbojet, s)]
    assert any(c.is_step for c in moved)
    assert run(Names(moved, s.values, entries(s)), FOUR)["marks"]["several_all"] is True


def test_forms_at_one_place_are_one_law(turbojet):
    told = [
        {"law": "first", "at": "turbine.efficiency", "expression": "a * mach", **SIZE_OF_A_LAW},
        {"law": "second", "at": "turbine.efficiency", "expression": "a * mach ** 2", **SIZE_OF_A_LAW},
        {"law": "third", "at": "compressor.efficiency", "expression": "a * mach", **SIZE_OF_A_LAW},
    ]
    names = Names([Cause(f"{t['law']}@{t['at']}") for t in told] + [Cause("sensor.T3.scale", 40)], laws=told)
    found, _ = named_causes(turbojet, ExplainAnswer.from_json(names.told))
    laws = [n for n in found if n.is_law]
    assert sorted(len(n.laws) for n in laws) == [1, 2] and [n.cause.name for n in found if not n.is_law] == [
        "sensor.T3.scale"
    ]


def test_variables_that_the_records_cannot_tell_apart_are_told_once():
    x = np.linspace(0.2, 0.8, 50)
    values = {"mach": x, "ram": 1.0 + 2.0 * x, "power": np.cos(9.0 * x)}
    assert independent_variables(["mach", "ram", "power", "mach"], values) == ["mach", "power"]


def test_as_many_true_causes_are_told_as_can_be():
    assert match_causes(np.array([[True, True], [True, False]])) == (1, 0)
    assert match_causes(np.array([[True], [True]])) in ((0, -1), (-1, 0))
    assert match_causes(np.zeros((2, 0), bool)) == (-1, -1)
    assert match_causes(np.array([[False, False, True], [False, False, True]])) in ((2, -1), (-1, 2))


def test_a_search_that_failed_is_no_verdict():
    class Breaks:
        def ask(self, question):
            return {"error": "it broke"}

    found = run(Breaks(), TWO)
    assert found["marks"] == {"no_verdict": True} and found["status"] == NOT_CONVERGED


def test_pairs_triples_and_fours_are_counted_apart():
    def trial(kind, right):
        marks = {"several_all": right, "several_share": [1.0 if right else 0.5], "no_verdict": False}
        return {"truth": kinds.SAME_MODEL, "kind": kind, "marks": marks}

    found = sheet([trial(TWO, True), trial(THREE, False), trial(FOUR, True)])
    assert [found[f"several_all_of_{n}"]["rate"] for n in ("two", "three", "four")] == [1.0, 0.0, 1.0]
    assert found["several_share"]["rate"] == pytest.approx(2.5 / 3) and found["no_verdict"]["of"] == 0


def test_flights_that_show_nothing_are_drawn_anew_and_do_not_end_the_sheet(monkeypatch, turbojet):
    refused = []

    def conceal(engine, trial, rng):
        refused.append(trial)
        if len(refused) < 3:
            raise NothingVisibleError("nothing shows")
        return trial

    monkeypatch.setattr(sealing, "conceal_several", conceal)
    found = draw_truth(turbojet, SEED, 7, (kinds.SAME_MODEL,), (THREE,))
    assert len(refused) == 3 and found is refused[-1] and found.trial == 7
    assert len({t.noise_seed for t in refused}) == 3  # each time all is another


def test_an_engine_that_never_shows_anything_is_told(monkeypatch, turbojet):
    def conceal(engine, trial, rng):
        raise NothingVisibleError("nothing shows")

    monkeypatch.setattr(sealing, "conceal_several", conceal)
    with pytest.raises(NothingVisibleError, match="nothing shows"):
        draw_truth(turbojet, SEED, 7, (kinds.SAME_MODEL,), (THREE,))
