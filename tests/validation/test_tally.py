"""Counting answers, and the intervals of rates."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import binom

from enginediag_cli.validation.studies import EDGES, MethodAnswers, Tally, tally
from enginediag_cli.validation.trials import clopper_pearson, design_effect, exact_rate, rate

CHANGES = np.array([[0.0, -0.01, 0.0], [0.0, 0.0, 0.0], [0.02, 0.0, 0.01], [0.01, 0.0, 0.0]])
ANSWERS = MethodAnswers(
    judged=np.array([True, True, True, False]),
    detected=np.array([True, True, True, True]),
    isolated=np.array([[0, 1, 0], [0, 0, 0], [1, 1, 1], [1, 0, 0]], bool),
    probability=np.array([0.9, 0.97, 0.5, np.nan]),
)


def test_each_count_is_what_its_name_says():
    x = tally(CHANGES, ANSWERS, 2.0, 7)
    assert (x.repetitions, x.judged, x.unchanged, x.detected, x.false_alarms) == (4, 3, 1, 3, 1)
    assert (x.exact, x.contained, x.right_size, x.isolated) == (2, 3, 2, 4)
    assert x.counts.tolist() == [1, 2, 1] and x.counts_contained.tolist() == [1, 2, 1]
    assert x.bins[:, 0].sum() == 3 and x.bins[:, 1].sum() == 2
    assert x.bins[np.digitize(0.5, EDGES) - 1].tolist() == [1, 0, 0.5]


def test_a_window_without_verdict_is_never_right():
    silent = MethodAnswers(np.zeros(4, bool), np.zeros(4, bool), CHANGES != 0, np.full(4, 0.9))
    x = tally(CHANGES, silent, 0.0, 0)
    assert (x.judged, x.exact, x.contained, x.isolated, x.bins.sum()) == (0, 0, 0, 0, 0)


def test_tallies_of_parts_add_up_to_the_tally_of_the_whole_and_survive_json():
    def part(rows):
        return tally(CHANGES[rows], MethodAnswers(*(getattr(ANSWERS, n)[rows] for n in vars(ANSWERS))), 1.0, 0)

    whole = tally(CHANGES, ANSWERS, 2.0, 0)
    added = part(slice(0, 1)) + Tally.from_json(json.loads(json.dumps(part(slice(1, 4)).to_json())))
    one, other = added.to_json(), whole.to_json()
    assert np.sum(one.pop("blocks"), axis=0).tolist() == other.pop("blocks")[0]  # each batch stays known
    assert one == other
    assert added.counts_by_batch("exact").tolist() == [1, 1]


def test_a_method_that_names_no_parameters_is_not_called_exact():
    x = tally(CHANGES, MethodAnswers(ANSWERS.judged, ANSWERS.detected, None, np.full(4, np.nan)), 0.0, 0)
    assert not x.isolates and (x.exact, x.contained, x.detected) == (0, 0, 3)


@pytest.mark.parametrize("hits, n", [(3, 40), (39, 40), (20, 40)])
def test_the_interval_is_where_the_binomial_tails_are_one_fortieth(hits, n):
    low, high = clopper_pearson(hits, n)
    assert binom.sf(hits - 1, n, low) == pytest.approx(0.025)
    assert binom.cdf(hits, n, high) == pytest.approx(0.025)


def test_independent_blocks_have_no_design_effect_and_shared_rates_have_that_of_kish():
    rng = np.random.default_rng(0)
    counts = np.full(400, 25)
    plain = design_effect(rng.binomial(counts, 0.8), counts)
    assert plain == pytest.approx(1.0, abs=0.25)
    # with rates of blocks of variance v about p: d = 1 + (n − 1) v/(p (1 − p))
    rates = rng.beta(8.0, 2.0, 400)
    shared = design_effect(rng.binomial(counts, rates), counts)
    assert shared == pytest.approx(1.0 + 24.0 / 11.0, rel=0.2)
    assert design_effect([3], [10]) == design_effect([5, 5], [5, 5]) == 1.0


def test_intervals_hold_between_seeds_where_blocks_share_something():
    rng, inside = np.random.default_rng(1), {"blocks": 0, "trials": 0}
    for _ in range(400):
        counts = np.full(40, 25)
        hits = rng.binomial(counts, rng.beta(8.0, 2.0, 40))
        for name, effect in (("blocks", design_effect(hits, counts)), ("trials", 1.0)):
            found = exact_rate(int(hits.sum()), int(counts.sum()), effect)
            inside[name] += found["low"] <= 0.8 <= found["high"]
    assert inside["blocks"] >= 366  # binomial(400, 0.95) is smaller with probability 0.002
    assert inside["trials"] < 330


def test_marks_of_trials_of_one_engine_widen_the_interval():
    marks, groups = [True] * 8 + [False] * 8 + [True] * 8, [0] * 8 + [1] * 8 + [2] * 8
    alone, together = rate(marks), rate(marks, groups)
    assert (alone["count"], alone["of"]) == (together["count"], together["of"]) == (16, 24)
    assert together["low"] < alone["low"] and together["high"] > alone["high"]
    assert rate(marks, range(24)) == pytest.approx(rate(marks), rel=0.05)


def test_the_interval_of_none_and_of_all_is_one_sided():
    assert clopper_pearson(0, 100) == (0.0, pytest.approx(1 - 0.025**0.01))
    assert clopper_pearson(100, 100) == (pytest.approx(0.025**0.01), 1.0)
