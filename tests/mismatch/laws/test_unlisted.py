"""Curves that no list holds are likely before anything is fitted, and nothing is where nothing is missing."""

from __future__ import annotations

import concealed
import numpy as np
import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.scan import known_variables, scanned
from enginediag_cli.mismatch.laws.unlisted import any_curve_at_all
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

TWO_WAVES = "a * mach * (mach - 0.25) * (mach - 0.4) * (mach - 0.55) * (mach - 0.7) * (mach - 0.85)"


def looked(*effects: Effect) -> tuple[float, float]:
    """ln evidence of any smooth curve, and of the best listed form by score."""
    given = concealed.evidence(concealed.flights(effects, np.random.default_rng(1301), count=4, records=40))
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    projection = Projection(found)
    listed = scanned(found, projection).candidates[0].weight
    return any_curve_at_all(found, projection, known_variables(found)), listed


@pytest.mark.slow
def test_a_wave_that_no_form_has_is_plainly_likelier_as_any_curve() -> None:
    acts, a = (
        LawPlace("hpc.efficiency", "hpc", "", True),
        Coefficient("a", "1", "size", lower=-900.0, upper=900.0, sigma=100.0, typical=200.0),
    )
    mach = {"mach": formula_variables(concealed.turbofan().network)["mach"]}
    law = Law("truth", acts, Expression.parse(TWO_WAVES), mach, (a,))
    smooth, listed = looked(Effect(law, acts.site, {"a": 200.0}))
    assert smooth > listed + 10.0 and smooth > 30.0


def test_where_nothing_is_missing_no_curve_is_likely() -> None:
    smooth, _ = looked()
    assert smooth < 0.0
