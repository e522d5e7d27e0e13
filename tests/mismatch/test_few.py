"""Sets of options are sought on few of many records, and all of them judge what is named."""

from functools import cache

import numpy as np
import pytest
from concealed import carried, evidence, flights
from test_several_causes import LOAD, REYNOLDS, library, stepped

from enginediag_cli.mismatch.explain import few as searched
from enginediag_cli.mismatch.explain.answer import IDENTIFIED
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.few import Few
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets
from enginediag_cli.mismatch.explain.members import identity
from enginediag_cli.mismatch.fit.options import stepping
from enginediag_cli.mismatch.fit.share import every_so_often

SINCE = 2
"""Flight, from 0, from which on T45 reads wrong."""


@cache
def search():
    recorded = stepped(flights(carried(REYNOLDS, LOAD), np.random.default_rng(7021)), "T45_K", 0.006, SINCE)
    return Search(evidence(recorded), library())


@pytest.fixture
def quarter(monkeypatch):
    monkeypatch.setattr(searched, "ENOUGH", search().evidence.records // 4)


def test_of_every_fourth_record_noise_is_as_alike_as_four_records_apart():
    e = evidence(flights(carried(REYNOLDS), np.random.default_rng(7022)), rho=0.8)
    few = every_so_often(e, e.records // 4)
    assert few.records == pytest.approx(e.records / 4, abs=len(e.flights))
    assert all(r == pytest.approx(0.8**4) for r in few.noise.rho.values())


@pytest.mark.slow
def test_causes_that_few_records_show_are_named_by_what_all_say_of_them(quarter):
    answer = search().run()
    assert answer.status == IDENTIFIED
    best = answer.explanations[0]
    assert {identity(o) for o in best.options} == {
        ("reynolds_efficiency@hpc",),
        ("power_offtake@hp",),
        ("sensor.T45.scale",),
    }
    trial = search().fitted[best.label]
    assert trial.found.evidence.records == search().evidence.records
    found = {c.name: c for c in best.coefficients}
    for name, value in (("reynolds_efficiency.hpc.exponent", 0.1), ("power_offtake.hp.fraction", 0.006)):
        assert abs(found[name].value - value) < 3.0 * found[name].standard_error


@pytest.mark.slow
def test_a_change_of_few_records_begins_on_all_with_the_same_record(quarter):
    search().run()
    few = Few.of(search())
    assert few.fits is not few.whole
    change = next(o for o in few.fits.library if o.target is not None and o.target.name == "sensor.T45.scale")
    first = sum(len(f) for f in few.fits.evidence.flights[:SINCE])
    (trial,) = few.fits.refit([(stepping(change, few.fits.evidence, first + 3),)])
    on_all = few.on_all(trial)
    assert on_all.label == trial.label and on_all.converged
    label = few.whole.evidence.flights[SINCE].label
    assert on_all.label.endswith(label) and on_all.found.evidence is few.whole.evidence


@pytest.mark.slow
def test_a_free_curve_of_few_records_is_along_the_same_driver_on_all(quarter):
    search().run()
    few = Few.of(search())
    sets = FittedSets(few.fits, many=True)
    offer = sets.unlisted(few.fits.base)[0]
    (trial,) = few.fits.refit([(offer.option,)])
    on_all = few.on_all(trial, sets.unlisted)
    assert on_all.label == trial.label
    assert all(len(c) == few.whole.evidence.records for c in on_all.hypothesis.curves.values())
