"""Counting answers, and the intervals of rates."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import binom

from enginediag_cli.trials.rates import clopper_pearson
from enginediag_cli.trials.studies.answers import Answers
from enginediag_cli.trials.studies.tally import EDGES, Tally, tally

CHANGES = np.array([[0.0, -0.01, 0.0], [0.0, 0.0, 0.0], [0.02, 0.0, 0.01], [0.01, 0.0, 0.0]])
ANSWERS = Answers(
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
    silent = Answers(np.zeros(4, bool), np.zeros(4, bool), CHANGES != 0, np.full(4, 0.9))
    x = tally(CHANGES, silent, 0.0, 0)
    assert (x.judged, x.exact, x.contained, x.isolated, x.bins.sum()) == (0, 0, 0, 0, 0)


def test_tallies_of_parts_add_up_to_the_tally_of_the_whole_and_survive_json():
    def part(rows):
        return tally(CHANGES[rows], Answers(*(getattr(ANSWERS, n)[rows] for n in vars(ANSWERS))), 1.0, 0)

    whole = tally(CHANGES, ANSWERS, 2.0, 0)
    added = part(slice(0, 1)) + Tally.from_json(json.loads(json.dumps(part(slice(1, 4)).as_json())))
    assert added.as_json() == whole.as_json()


def test_a_method_that_names_no_parameters_is_not_called_exact():
    x = tally(CHANGES, Answers(ANSWERS.judged, ANSWERS.detected, None, np.full(4, np.nan)), 0.0, 0)
    assert not x.isolates and (x.exact, x.contained, x.detected) == (0, 0, 3)


@pytest.mark.parametrize("hits, n", [(3, 40), (39, 40), (20, 40)])
def test_the_interval_is_where_the_binomial_tails_are_one_fortieth(hits, n):
    low, high = clopper_pearson(hits, n)
    assert binom.sf(hits - 1, n, low) == pytest.approx(0.025)
    assert binom.cdf(hits, n, high) == pytest.approx(0.025)


def test_the_interval_of_none_and_of_all_is_one_sided():
    assert clopper_pearson(0, 100) == (0.0, pytest.approx(1 - 0.025**0.01))
    assert clopper_pearson(100, 100) == (pytest.approx(0.025**0.01), 1.0)
