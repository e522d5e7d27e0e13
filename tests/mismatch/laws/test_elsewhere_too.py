"""One formula at several machines: with the place that it has, the others are found, and its size is right again."""

from __future__ import annotations

import concealed
import numpy as np
import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.elsewhere_too import elsewhere_too
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.laws.scan import formulas, known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables


def _truth(place: str, slope: float) -> Effect:
    engine = concealed.turbofan()
    acts = LawPlace(f"{place}.efficiency", place, "", True)
    a = Coefficient("a", "1", "slope", lower=-1.0, upper=1.0, sigma=0.05, typical=slope)
    law = Law("truth", acts, Expression.parse("a * ln(reynolds_index)"), formula_variables(engine.network), (a,))
    return Effect(law, acts.site, {"a": slope})


def _searched(*truths: Effect):
    """The base, the fitted law of the logarithm at the HPC, and what is found beside it."""
    given = concealed.evidence(concealed.flights(truths, np.random.default_rng(1100), count=4, records=40))
    along = nuisance(given)
    found = identify_with(given, NULL_HYPOTHESIS, along)
    base = HypothesisFit((), found, Projection(found))
    where = locations(found)
    known = [k for k in known_variables(found) if k.variable.name == "reynolds_index"]
    law = next(f for f in formulas(known) if f.form.name == "logarithm")
    hpc = [w for w in where if w.name == "hpc.efficiency"]
    first = proposal(scored(found, base.projection, hpc, [law], 0.0)[0], given.engine)
    trial = attempt([first.option], found, along)
    further = elsewhere_too([first], trial, where)
    both = None if further is None else attempt([first.option, further.option], found, along)
    return base, trial, further, both


def _slope(trial: HypothesisFit, place: str) -> tuple[float, float]:
    return next(v for n, v in trial.coefficients.items() if f".{place}." in n)


def test_the_other_machine_is_found_and_the_first_ones_slope_is_right_again() -> None:
    base, trial, further, both = _searched(_truth("hpc", 0.04), _truth("lpt", 0.04))
    assert further is not None and further.candidate.location.name == "lpt.efficiency"
    assert further.candidate.formula.form.name == "logarithm" and both.converged
    for place in ("hpc", "lpt"):
        slope, error = _slope(both, place)
        assert abs(slope - 0.04) < 3.0 * error
    assert evidence_of(base, both, further.candidate.prior) > evidence_of(base, trial, 0.0) + 3.0


def test_it_costs_no_more_than_the_choice_among_places_of_the_quantity() -> None:
    _, _, further, _ = _searched(_truth("hpc", 0.04), _truth("lpt", 0.04))
    machines = [n for n in concealed.turbofan().monitored if n.endswith(".efficiency")]
    assert further.candidate.prior == pytest.approx(-np.log(len(machines) - 1), abs=0.3)


def test_where_one_machine_has_it_no_other_is_named() -> None:
    base, trial, further, both = _searched(_truth("hpc", 0.04))
    told = further is not None and both.converged
    assert not told or evidence_of(base, both, further.candidate.prior) < evidence_of(base, trial, 0.0) + 1.0
