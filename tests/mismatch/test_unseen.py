"""What cannot be seen is told by the kind of effect that was looked for; what never varies is no curve."""

from __future__ import annotations

import numpy as np
import pytest
from test_aircraft import case

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.explain.curves import fitted_curves
from enginediag_cli.mismatch.explain.floor_cost import VISIBLE
from enginediag_cli.mismatch.explain.unseen import unseen_effects
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.freeform import free_form
from enginediag_cli.mismatch.fit.identified import driver_values
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.finding import Switch
from enginediag_cli.physics.registry import effect
from enginediag_cli.report.tables.explanation_text import curve_in_words
from enginediag_cli.report.tables.formulas import moment


@pytest.fixture(scope="module")
def fit():
    """A fit of two engines to flights with a bleed that switches, the map of places, and the nuisance."""
    found, along = case()[:2]
    projection = Projection(found)
    return found, along, projection, free_form(found, projection, driver_values(found.evidence, found.theta))


def test_a_place_that_is_off_in_every_record_alike_is_fitted_by_one_number(fit):
    found, along, projection, cells = fit
    constant = [c for c in cells if c.driver.driver == CONSTANT and c.surprise > 0.0][:2]
    assert constant
    for c in fitted_curves(found, projection.objective, constant, along):
        assert c.dof == 1
        assert not c.converged or c.gain > 0.0
        if c.converged:
            assert np.ptp(c.change) == pytest.approx(0.0, abs=1e-12) and c.change[0] != 0.0
            told = curve_in_words(c)
            assert "in every record" in told and "1 coefficient)" in told and "goes from" not in told


def test_the_size_from_which_a_switched_effect_would_be_seen_falls_with_the_square_root_of_what_is_known(fit):
    found, _, projection, _ = fit
    bleed = effect(found.evidence.engine, "customer_bleed", "hpc")
    base = HypothesisFit((), found, projection)
    (one,) = unseen_effects(base, [effect_option(bleed)], [bleed.label])
    assert 0.0 < one.switching < 0.1
    assert unseen_effects(base, [effect_option(bleed)], []) == []
    assert VISIBLE == 25.0


def test_a_moment_is_told_by_the_clock_where_there_is_one_that_runs_forward():
    timed = Flight("a", "", {"time_s": np.array([3.0, 13.5, 24.0])})
    assert timed.moment(1) == "13.5 s"
    assert Flight("a", "", {"x": np.zeros(3)}).moment(1) == "record 2"
    assert Flight("a", "", {"time_s": np.array([3.0, 3.0, 4.0])}).moment(1) == "record 2"
    assert moment(Switch("a", 4, True, 1.0, 10.0, 20.5)) == "between 10 and 20.5 s"
    assert moment(Switch("a", 4, True, 1.0)) == "at record 5"
    narrowed = Switch("a", 4, True, 1.0, 10.0, 20.5, 12.34, 15.01)
    assert moment(narrowed) == "between 12.3 and 15.1 s (95 %)"
    assert narrowed.between == (12.34, 15.01)
