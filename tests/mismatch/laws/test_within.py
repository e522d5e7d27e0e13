"""Physics forbids laws that no air, duct or shaft obeys: humidity beyond saturation is no place for a large law."""

from __future__ import annotations

import concealed
import numpy as np
import pytest
from scipy.stats import norm

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.fitted import Fitted, ln_within
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.laws.scan import Candidate, formulas, known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.mismatch.laws.within import Room
from enginediag_cli.physics.law import Expression, Law, LawPlace, effect_place, formula_variables
from enginediag_cli.physics.registry import effect

BEYOND_SATURATED = 20.0
"""Slope of relative humidity along the inlet temperature over its reference: it would change by more than 1.5."""


def _searched(acts: LawPlace, slope: float):
    """The base of flights with a law in proportion to inlet temperature, and that law as it is scored at each place."""
    engine = concealed.turbofan()
    a = Coefficient("a", "1", "slope", lower=-np.inf, upper=np.inf, sigma=1.0, typical=slope)
    known = formula_variables(engine.network)
    law = Law("truth", acts, Expression.parse("a * (inlet_temperature - 1)"), known, (a,))
    truth = Effect(law, acts.site, {"a": slope})
    given = concealed.evidence(concealed.flights((truth,), np.random.default_rng(1100), count=4, records=40))
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    of = [k for k in known_variables(found) if k.variable.name == "inlet_temperature"]
    linear = [f for f in formulas(of) if f.form.name == "linear"]
    base = HypothesisFit((), found, Projection(found))
    return base, {c.location.name: c for c in scored(found, base.projection, locations(found), linear, 0.0)}


def _fitted(base: HypothesisFit, candidate: Candidate) -> tuple[Fitted, float]:
    """The law fitted, and its evidence by readings alone."""
    law = proposal(candidate, base.found.evidence.engine)
    trial = attempt([law.option], base.found, nuisance(base.found.evidence))
    return Fitted.to(base, (law,), trial), evidence_of(base, trial, candidate.prior)


@pytest.fixture(scope="module")
def of_humidity():
    return _searched(effect_place(effect(concealed.turbofan(), "humidity", "ambient")), BEYOND_SATURATED)


def test_air_is_no_more_than_saturated(of_humidity):
    base, at = of_humidity
    fitted, by_readings = _fitted(base, at["humidity@ambient"])
    (size,) = (v for n, (v, _) in fitted.trial.coefficients.items() if n.endswith(".a"))
    span = abs(size) * float(np.ptp(at["humidity@ambient"].formula.curve))
    assert span > 1.5
    assert fitted.evidence < by_readings - 3.0


def test_what_stays_within_pays_nothing():
    base, at = _searched(LawPlace("hpc.efficiency", "hpc", "", True), 0.15)
    fitted, by_readings = _fitted(base, at["hpc.efficiency"])
    assert fitted.evidence == by_readings


def test_a_linear_score_says_what_the_fit_says(of_humidity):
    base, at = of_humidity
    fitted, _ = _fitted(base, at["humidity@ambient"])
    c = at["humidity@ambient"]
    room, ends = Room.at(base.found, c.location), np.array([c.formula.curve.min(), c.formula.curve.max()])
    by_score = float(room.of_curves(c.amplitude, ends - c.formula.curve.mean(), c.statistic))
    assert by_score == pytest.approx(ln_within(fitted.laws, fitted.trial), rel=0.3)


def test_by_how_much_is_a_matter_of_standard_errors():
    known, unknown = Room(-0.2, 0.1, 0.0), Room(-0.2, 0.1, np.inf)
    low, high = -0.05, 0.16
    ends, squares = np.array([low, high]), (1.0 / 0.25) ** 2  # a standard error is a quarter of the size
    up = (high - 0.1) / (0.25 * high)
    assert float(known.of_curves(1.0, ends, squares)) == pytest.approx(np.log(2.0 * norm.sf(up)))
    # of what the engine does not carry nothing tells the level: 0.21 is less than 0.3 from end to end
    assert float(unknown.of_curves(1.0, ends, squares)) == 0.0
    assert float(unknown.of_curves(2.0, ends, squares)) == pytest.approx(np.log(2.0 * norm.sf(0.12 / (0.25 * 0.42))))


def test_units_do_not_matter():
    ends = np.array([-0.05, 0.16])
    shares = float(Room(-0.2, 0.1, 0.03).of_curves(1.0, ends, 30.0))
    percent = float(Room(-20.0, 10.0, 3.0).of_curves(1.0, 100.0 * ends, 30.0))
    assert shares == pytest.approx(percent) and shares < 0.0


def test_a_law_turned_round_meets_the_other_bound():
    ends = np.array([-0.05, 0.16])
    assert float(Room(-0.1, 0.3, 0.0).of_curves(1.0, ends, 30.0)) == 0.0
    assert float(Room(-0.1, 0.3, 0.0).of_curves(-1.0, ends, 30.0)) < 0.0
