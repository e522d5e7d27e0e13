"""The average of all smooth curves of a variable, or of sums of one of each of two, is a formula that follows them."""

from __future__ import annotations

import concealed
import numpy as np
import pytest

from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.additive import Additive, additive_of
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.linear import evidence_of_all
from enginediag_cli.mismatch.laws.polynomials import Polynomials
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import KnownVariable, known_variables
from enginediag_cli.mismatch.laws.steps import bends_of
from enginediag_cli.physics.law import Expression


class Ground:
    """Flights in which nothing is missing, and what a place says of a curve that a fit carries there."""

    def __init__(self) -> None:
        given = concealed.evidence(concealed.flights((), np.random.default_rng(1311), count=4, records=60))
        self.found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
        self.projection = Projection(self.found)
        self.place = next(p for p in locations(self.found) if p.name == "hpc.efficiency")
        self.known = {k.variable.name: k for k in known_variables(self.found)}

    def of(self, *names: str) -> list[KnownVariable]:
        return [self.known[n] for n in names]

    def said(self, f: np.ndarray) -> Said:
        """What is carried is added back to what the fit leaves: there is nothing else in these flights."""
        return Said(Carried(self.found, self.projection, self.place, f, 0.0, ()))


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground()


def share(k: KnownVariable) -> np.ndarray:
    """How far along what was flown."""
    return np.asarray((k.values - k.values.min()) / np.ptp(k.values))


def left(found: Additive, f: np.ndarray) -> float:
    """What is not followed, a constant apart, over all."""
    return float(np.std(found.curve - f) / np.std(f))


@pytest.mark.parametrize("waves", [0.5, 1.5])
def test_it_follows_a_wave_of_one_variable(ground: Ground, waves: float) -> None:
    (mach,) = ground.of("mach")
    f = 0.02 * np.sin(2.0 * np.pi * waves * share(mach))
    assert left(additive_of(ground.said(f).kept, [mach]), f) < 0.1


def test_it_follows_a_sum_of_two_which_no_curve_of_either_does(ground: Ground) -> None:
    mach, power = ground.of("mach", "power")
    f = 0.02 * np.sin(3.0 * share(mach)) + 0.02 * share(power) ** 3
    says = ground.said(f).kept
    together = additive_of(says, [mach, power])
    assert left(together, f) < 0.15
    for k in (mach, power):
        alone = additive_of(says, [k])
        assert left(alone, f) > 2.0 * left(together, f) and alone.evidence < together.evidence


@pytest.mark.parametrize("names", [("mach",), ("mach", "power")])
def test_its_formula_is_its_curve_and_nothing_at_the_design_point(ground: Ground, names: tuple[str, ...]) -> None:
    of = ground.of(*names)
    f = 0.02 * np.sum([np.sin(5.0 * share(k)) for k in of], axis=0)
    found = additive_of(ground.said(f).kept, of)
    formula = Expression.parse(found.text)
    told = np.asarray(formula.evaluate({k.variable.name: k.values for k in of}))
    assert told == pytest.approx(found.curve, abs=2e-3 * np.ptp(f))
    there = formula.evaluate({k.variable.name: np.array([k.variable.reference]) for k in of})
    assert abs(float(np.asarray(there)[0])) < 1e-12


def test_steps_and_polynomials_are_as_likely_beforehand_and_it_is_what_both_say(ground: Ground) -> None:
    (mach,) = ground.of("mach")
    says = ground.said(0.02 * np.sin(4.0 * share(mach))).kept
    smooth = Polynomials.of([mach]).at(says, float(np.std(says.f)))
    steps, polynomials = bends_of(says, [mach]).evidence, says.gain + evidence_of_all([smooth])
    assert additive_of(says, [mach]).evidence == pytest.approx(np.logaddexp(steps, polynomials) - np.log(2.0))
