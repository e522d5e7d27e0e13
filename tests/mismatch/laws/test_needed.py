"""Whether a law is needed is asked of what it changes, not of a size that its width makes doubtful."""

from __future__ import annotations

import concealed
import numpy as np

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.needed import not_needed
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import formulas, known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

CLEAR = 8.0
"""−ln p of a size that is needed."""


def _step_of(slope: float) -> tuple[HypothesisFit, HypothesisFit]:
    """The fit without and with a smooth step at the HPC, where the truth is a straight line of this slope."""
    engine = concealed.turbofan()
    acts = LawPlace("hpc.efficiency", "hpc", "", True)
    a = Coefficient("a", "1", "slope", lower=-1.0, upper=1.0, sigma=0.05, typical=slope)
    law = Law("truth", acts, Expression.parse("a * (reynolds_index - 1)"), formula_variables(engine.network), (a,))
    truth = [Effect(law, acts.site, {"a": slope})] if slope else []
    given = concealed.evidence(concealed.flights(truth, np.random.default_rng(1101), count=4, records=40))
    along = nuisance(given)
    found = identify_with(given, NULL_HYPOTHESIS, along)
    base = HypothesisFit((), found, Projection(found))
    hpc = [w for w in locations(found) if w.name == "hpc.efficiency"]
    known = [k for k in known_variables(found) if k.variable.name == "reynolds_index"]
    steps = [f for f in formulas(known) if f.form.name == "step"]
    best = scored(found, base.projection, hpc, steps, 0.0)[0]
    return base, attempt([proposal(best, given.engine).option], found, along)


def test_a_clear_law_is_needed_though_its_size_and_width_are_not_known_apart() -> None:
    base, trial = _step_of(0.06)
    (size,) = trial.options[0].hypothesis.sizes
    value, error = trial.coefficients[size]
    assert trial.converged and base.objective - trial.objective > 100.0
    assert abs(value / error) < 4.0  # a straight line is a step of any size that is wide enough
    assert not_needed(trial, CLEAR) == ""


def test_where_there_is_none_it_is_not_needed() -> None:
    _, trial = _step_of(0.0)
    assert not_needed(trial, CLEAR) == trial.options[0].label
