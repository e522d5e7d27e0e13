"""Candidates are told apart on few of many records, and fits to all go on from there."""

from __future__ import annotations

import numpy as np
import pytest
from concealed import carried, evidence, flights

from enginediag_cli.mismatch.explain.worth_fitting import worth_fitting
from enginediag_cli.mismatch.fit import identified
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import effect_option


@pytest.fixture(scope="module")
def base():
    concealed = ("reynolds_efficiency", "hpc", {"exponent": 0.12})
    e = evidence(flights(carried(concealed), np.random.default_rng(4), count=4, records=40))
    along = nuisance(e)
    return identify_with(e, NULL_HYPOTHESIS, along), along


def options(*names):
    return [(effect_option(e),) for e in carried(*((n, at, {}) for n, at in names))]


def test_what_is_plainly_worse_on_few_records_is_not_fitted_to_all_and_the_rest_ends_where_it_would(base, monkeypatch):
    found, along = base
    right, wrong = options(("reynolds_efficiency", "hpc"), ("inlet_ram_recovery", "inlet"))
    whole = attempt(right, found, along)
    monkeypatch.setattr(identified, "FEW", 60)
    near, behind = worth_fitting([right, wrong], found, along)
    assert [o[0].label for o, _ in near] == [right[0].label]
    assert [o[0].label for o, _ in behind] == [wrong[0].label] and behind[0][1] > 30.0
    again = attempt(right, found, along, near[0][1])
    assert near[0][1] is not None and again.converged
    assert np.isclose(again.objective, whole.objective, atol=0.05)
    name = whole.hypothesis.names[0]
    assert abs(again.coefficients[name][0] - whole.coefficients[name][0]) < 0.1 * whole.coefficients[name][1]
