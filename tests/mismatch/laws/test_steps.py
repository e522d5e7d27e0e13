"""A smooth curve of steps is a law that engine files carry, 0 at the design point and constant where nobody flew."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import concealed
import numpy as np
import pytest

from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import known_variables
from enginediag_cli.mismatch.laws.steps import (
    ALONE,
    BESIDE,
    TOGETHER,
    Bends,
    as_curve,
    as_surface,
    bends_of,
    steps_over,
)
from enginediag_cli.physics.engine_file import law_entry
from enginediag_cli.validation.formula_marks import build_formulas

COUNT, HERE = 8, -3.0


@pytest.fixture(scope="module")
def ground():
    given = concealed.evidence(concealed.flights((), np.random.default_rng(1310), count=2, records=30))
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    place = next(p for p in locations(found) if p.name == "hpc.efficiency")
    return given.engine, place, {k.variable.name: k for k in known_variables(found)}


def _laws(ground, of, prior=0.0):
    """A curve of eight steps of one variable, or a surface of two."""
    engine, place, _ = ground
    if len(of) == 1:
        return as_curve(place, Bends((of[0],), (COUNT,), 0.01, 0.0, 0.0), prior, HERE, engine)
    return as_surface(place, of, 0.01, prior, HERE, engine)


def _summed(laws, x, sizes):
    total = 0.0
    for effect in laws:
        values = {c.name: s for c, s in zip(effect.term.COEFFICIENTS, sizes, strict=False)}
        total = total + np.asarray(effect.term.expression.evaluate({**x, **values}), float)
    return total


@pytest.mark.parametrize("names", [("mach",), ("power", "mach")])
def test_it_is_nothing_at_the_design_point_and_constant_beyond_what_was_flown(ground, names):
    known = ground[2]
    laws = [e for p in _laws(ground, [known[n] for n in names]) for e in p.option.hypothesis.effects]
    sizes = np.random.default_rng(1).normal(0.0, 0.01, 2 * COUNT)
    at_design = {n: np.array([known[n].variable.reference]) for n in names}
    assert np.abs(_summed(laws, at_design, sizes)).max() < 1e-15
    far = {n: known[n].values.max() + np.ptp(known[n].values) * np.array([4.0, 40.0]) for n in names}
    inside = _summed(laws, {n: known[n].values for n in names}, sizes)
    assert np.ptp(_summed(laws, far, sizes)) < 1e-6 * np.ptp(inside)


@pytest.mark.parametrize("names", [("mach",), ("power", "mach")])
def test_an_engine_file_carries_it_as_laws(ground, names):
    engine, _, known = ground
    coefficients = steps_over(known["mach"], COUNT).shape[1] if len(names) == 1 else 2 * BESIDE + TOGETHER**2
    proposals = _laws(ground, [known[n] for n in names])
    effects = [e for p in proposals for e in p.option.hypothesis.effects]
    assert sum(len(e.term.COEFFICIENTS) for e in effects) == coefficients
    assert all(a.label != b.label for a, b in combinations(effects, 2))
    built = build_formulas(engine, [law_entry(e) for e in effects])
    assert built is not None
    x = {n: known[n].values for n in names}
    sizes = np.random.default_rng(2).normal(0.0, 0.01, 2 * COUNT)
    assert np.array_equal(_summed(effects, x, sizes), _summed(built, x, sizes))


def test_steps_reach_the_ends_of_what_was_flown(ground):
    """One record in fifty lies as far out again as all others reach: what a curve does there is followed, too."""
    mach = ground[2]["mach"]
    x = np.concatenate([np.linspace(0.4, 0.8, 98), [1.0, 1.2]])
    steps = steps_over(replace(mach, values=x), ALONE[-1])
    growth = np.expm1(4.0 * (x - 0.4))
    assert steps.shape[1] <= ALONE[-1] + 2 * (ALONE[-1] // 3)
    left = growth - steps @ np.linalg.lstsq(steps, growth, rcond=None)[0]
    assert np.abs(left).max() < 0.01 * np.ptp(growth)


def test_only_the_first_law_bears_the_prior_of_place_and_variables(ground):
    known = ground[2]
    proposals = _laws(ground, [known["power"], known["mach"]], -7.0)
    assert [p.candidate.prior for p in proposals] == [-7.0 + HERE, *[0.0] * (len(proposals) - 1)]
    assert [p.candidate.formula.prior for p in proposals] == [-7.0, *[0.0] * (len(proposals) - 1)]


def test_long_names_make_no_formula_that_cannot_be_read(ground):
    known = ground[2]
    for name, other in combinations(known.values(), 2):
        for p in _laws(ground, [name, other]):
            assert len(next(iter(p.option.hypothesis.effects)).term.expression.text) <= 700
    for name in known.values():
        assert as_curve(ground[1], Bends((name,), (ALONE[-1],), 0.01, 0.0, 0.0), 0.0, 0.0, ground[0])
    variable = replace(known["power"].variable, name="a_name_that_goes_on_and_on_" * 12)
    assert _laws(ground, [replace(known["power"], variable=variable)]) == ()


def test_as_many_steps_are_taken_as_a_curve_bends():
    """Half a wave of a variable takes few, two and a half waves many; the evidence is of all that were tried."""
    given = concealed.evidence(concealed.flights((), np.random.default_rng(1311), count=4, records=60))
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    place = next(p for p in locations(found) if p.name == "hpc.efficiency")
    mach = next(k for k in known_variables(found) if k.variable.name == "mach")
    u = (mach.values - mach.values.min()) / np.ptp(mach.values)
    counts = []
    for waves in (0.5, 2.5):
        # what a fit carries is added back to what it leaves: there is nothing else in these flights
        carried = Carried(found, Projection(found), place, 0.02 * np.sin(2.0 * np.pi * waves * u), 0.0, ())
        bends = bends_of(Said(carried).kept, [mach])
        assert bends.choice <= 0.0
        counts += bends.counts
    assert counts[0] <= 6 and counts[1] >= 11
