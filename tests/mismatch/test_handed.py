"""Fits that other processes have made are those that one would have made, and go on as these do."""

from __future__ import annotations

import concealed
import numpy as np
import pytest

from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.at_place import said_at_places
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.scan import Scan, formulas_of, known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.parallel import CAN_FORK, use_processes

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="processes cannot begin as copies on this system")

CONCEALED = ("reynolds_efficiency", "hpc", {"exponent": 0.2})


def _fits() -> Fits:
    """Of flights with a Reynolds number effect on the HPC, and all that the library has to explain it."""
    (effect,) = concealed.carried(CONCEALED)
    given = concealed.evidence(concealed.flights((effect,), np.random.default_rng(17), count=3, records=25))
    fits = Fits(given)
    found = identify_with(given, NULL_HYPOTHESIS, fits.along)
    fits.look_from(HypothesisFit((), found, Projection(found)))
    return fits


@pytest.fixture(scope="module", autouse=True)
def started() -> None:
    """The engine that these tests share fits its start once, to whatever is solved first."""
    _fits().refit([()])


def _same(a: HypothesisFit, b: HypothesisFit) -> None:
    assert a.label == b.label and a.converged == b.converged and a.objective == b.objective
    assert a.coefficients == b.coefficients and a.intervals == b.intervals
    assert np.array_equal(a.projection.residual, b.projection.residual)
    assert np.array_equal(a.found.problem.measured, b.found.problem.measured, equal_nan=True)


@pytest.mark.parametrize("jobs", [2, 3])
def test_sets_are_fitted_side_by_side_as_one_process_fits_them(jobs: int) -> None:
    told = []
    for n in (1, jobs):
        fits = _fits()
        sets = [(o,) for o in fits.library if o.component == "hpc" and o.kind == "effect"][:5]
        with use_processes(n):
            trials = fits.refit([*sets, (*sets[0], *sets[1])])
        assert trials is not None
        # what begins at these fits begins where they have ended
        left = remainder(trials[0], fits.library, fits.along_drivers)
        told.append((trials, fits.rejected, [(s.option.label, s.score.statistic) for s in left.scores]))
    (one, rejected, left), (other, rejected_too, left_too) = told
    for a, b in zip(one, other, strict=True):
        _same(a, b)
    assert rejected == rejected_too and left == left_too


def test_a_trial_of_another_process_has_the_options_and_the_evidence_that_are_here() -> None:
    fits = _fits()
    sets = [(o,) for o in fits.library if o.component == "hpc" and o.kind == "effect"][:3]
    with use_processes(2):
        trials = fits.refit(sets)
    assert trials is not None and len(trials) == len(sets)
    for t in trials:
        assert t.found.evidence is fits.evidence
        own = next(o for (o,) in sets if o.label == t.label)
        # an effect that is tried at some size may have been begun at another one
        assert t.options[0] is own or t.options[0].hypothesis.effects[0].term is own.hypothesis.effects[0].term


def test_places_say_the_same_whoever_asks_them() -> None:
    told = []
    for jobs in (1, 2):
        fits = _fits()
        found, engine = fits.base.found, fits.evidence.engine
        known = [k for k in known_variables(found) if k.variable.name in ("reynolds_index", "power")]
        where = [p for p in locations(found) if p.name in ("hpc.efficiency", "hpc.flow_capacity")]
        laws = list(formulas_of([known[0]], known))
        scan = Scan(tuple(scored(found, fits.base.projection, where, laws, 0.0)), tuple(known))
        fitted = []
        for place in where:
            law = proposal(next(c for c in scan.candidates if c.location is place), engine)
            (trial,) = fits.refit([(law.option,)]) or []
            fitted.append(Fitted.to(fits.base, (law,), trial))
        with use_processes(jobs):
            said = said_at_places(fits.base, scan, fitted)
        assert {here.place for here in said} == {p.name for p in where}
        # variables are those of each place's own fit, one object for all that is said there
        for here in said:
            assert {k.variable.name for k in here.says.known} == {k.variable.name for k in known}
            # what has not moved is the very object that was handed over
            pairs = zip(here.says.known, known, strict=True)
            assert all(k is own or not np.array_equal(k.values, own.values) for k, own in pairs)
            own = set(map(id, here.says.known))
            assert {id(k) for s in here.smooth for k in s.of} <= own
            assert {id(k) for b in here.bends.values() for k in b.of} <= own
        told.append(said)
    for a, b in zip(*told, strict=True):
        assert [(s.names, s.evidence) for s in a.smooth] == [(s.names, s.evidence) for s in b.smooth]
        assert [(c.formula.what, c.weight) for c in a.refined] == [(c.formula.what, c.weight) for c in b.refined]
        assert np.array_equal(a.says.any.pull, b.says.any.pull) and a.says.gain == b.says.gain
