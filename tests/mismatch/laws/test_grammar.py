"""The forms of laws, each of them: one that is added to FORMS is held to the same facts."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from enginediag_cli.engine.dual import Dual, value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.filters import FilterClock
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.laws.grammar import FORMS, Form
from enginediag_cli.mismatch.laws.past import past_along
from enginediag_cli.mismatch.laws.proposed import proposed
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, KnownVariable, formulas
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import Law, formula_variables, parse_unit

TURBOFAN = Path(__file__).parents[3] / "configs" / "turbofan.yaml"
EACH = pytest.mark.parametrize("form", FORMS, ids=[f.name for f in FORMS])


@cache
def _turbofan() -> Engine:
    return load_engine(TURBOFAN)


def _known(records: int = 200) -> list[KnownVariable]:
    """Two ratios and one variable as it stands, once a minute."""
    clock = FilterClock(60.0 * np.arange(records), np.arange(records) == 0)
    r = np.random.default_rng(1)
    variables = formula_variables(_turbofan().network)
    ranges = {"power": (0.6, 1.1), "reynolds_index": (0.3, 1.2), "mach": (0.0, 0.8)}
    return [KnownVariable(variables[n], r.uniform(*at, records), k, clock) for k, (n, at) in enumerate(ranges.items())]


@cache
def _every_formula() -> tuple[Formula, ...]:
    return tuple(formulas(_known()))


def _formulas(form: Form) -> list[Formula]:
    return [f for f in _every_formula() if f.form is form]


def _values(formula: Formula, at: np.ndarray) -> dict[str, np.ndarray | float]:
    """Of all its letters where its variables (N, 1 or 2) are `at`."""
    known = zip("xy", formula.of, strict=False)
    letters: dict[str, np.ndarray | float] = {n: at[:, k] for k, (n, _) in enumerate(known)}
    letters |= {f"{n}0": k.variable.reference for n, k in zip("xy", formula.of, strict=False)}
    return letters | dict(formula.shape) | {"a": 1.0}


@EACH
def test_a_form_is_nothing_at_the_design_point_and_finite_far_around_it(form: Form) -> None:
    r = np.random.default_rng(2)
    for f in _formulas(form):
        reference = np.array([[k.variable.reference for k in f.of]])
        assert np.allclose(form.expression.evaluate(_values(f, reference)), 0.0, atol=1e-12)
        # a fifth to five times what the design point has, and a fifth of the range beyond what the records have
        wide = np.array([k.variable.reference for k in f.of]) * np.exp(r.uniform(-1.6, 1.6, (500, len(f.of))))
        around = [r.uniform(k.values.min() - 0.1, k.values.max() + 0.1, 500) for k in f.of]
        for at in (np.where(wide > 0.0, wide, 0.4), np.column_stack(around)):
            assert np.isfinite(form.expression.evaluate(_values(f, at))).all(), f.shape


@EACH
def test_its_derivatives_are_those_of_differences(form: Form) -> None:
    at = np.random.default_rng(3).uniform(0.6, 1.4, (50, 2))
    for f in _formulas(form)[:40]:
        values = _values(f, at)
        own = [n for n in sorted(form.expression.names) if not n.endswith("0")]
        given = {
            n: Dual(np.broadcast_to(values[n], 50), np.eye(len(own))[k][:, None] * np.ones(50))
            for k, n in enumerate(own)
        }
        found = form.expression.evaluate({**values, **given})
        assert isinstance(found, Dual)
        for k, n in enumerate(own):
            h = 1e-5 * max(1e-3, float(np.max(np.abs(values[n]))))
            low, high = (value(form.expression.evaluate({**values, n: values[n] + s * h})) for s in (-1, 1))
            size = max(1e-3, float(np.max(np.abs(found.d[k]))))
            assert np.allclose(found.d[k], (high - low) / (2 * h), rtol=1e-5, atol=1e-5 * size), n


@EACH
def test_it_has_no_kink_and_no_unit(form: Form) -> None:
    assert form.name.isidentifier()
    assert "max" not in form.text and "min" not in form.text
    units = dict.fromkeys(form.expression.names, parse_unit("1")) | {s.letter: parse_unit(s.unit) for s in form.shapes}
    assert form.expression.unit(units) == {}


@EACH
def test_its_tries_lie_within_its_bounds_and_so_does_the_middle_of_its_prior(form: Form) -> None:
    x = _known()[0].values
    for s in form.shapes:
        low, high = s.bounds(x)
        assert low < min(s.tries(x)) and max(s.tries(x)) < high
        assert low < s.centre(x) < high and s.sigma(x) > 0.0


@EACH
@pytest.mark.parametrize("at", ["hpc.efficiency", "sensor.T45.bias", "interduct.pressure_loss"])
def test_a_formula_that_was_found_stands_in_an_engine_file_as_the_same_numbers(form: Form, at: str) -> None:
    engine = _turbofan()
    formula = _formulas(form)[-1]
    parameter = engine.parameters[at]
    place = Location(at, at, parameter.component, scale=0.01)
    law = proposed(Candidate(place, formula, 0.02, 1.0, 1.0, 0.0), parameter, "found")
    fitted = {c.name: c.typical for c in law.term.COEFFICIENTS}
    written = law_entry(replace(law, values=fitted))
    text = TURBOFAN.read_text() + "\n" + yaml.safe_dump({"physics": [written]})
    (read,) = load_engine(EngineDescription(str(TURBOFAN), text, {})).effects
    assert isinstance(read.term, Law) and isinstance(law.term, Law)
    own = {c.name: c for c in read.term.COEFFICIENTS}
    for c in law.term.COEFFICIENTS:
        assert (own[c.name].free, own[c.name].lower) == (c.free, pytest.approx(c.lower, rel=1e-5))
    names = {k.variable.name: k.values for k in formula.of}
    sizes = {c.name: read.values[c.name] for c in read.term.COEFFICIENTS}
    of_file = read.term.expression.evaluate({**names, **sizes}, past_along(formula.of[0].clock))
    assert np.allclose(of_file, 0.02 * formula.curve, rtol=1e-4, atol=1e-6 * np.std(formula.curve))
