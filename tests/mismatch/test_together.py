"""One effect at several places of one kind by one size: what it does, how it is found and how a file carries it."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan

from enginediag_cli.mismatch.explain.answer import IDENTIFIED
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.refine.refine import _fitted
from enginediag_cli.physics.registry import SharedTerm, candidate_effects, separate_effects, shared_effects
from enginediag_cli.report.tables.explanation_text import headline

TERM, SIZE = "reynolds_turbine_efficiency", 0.12
LIBRARY = {TERM, "reynolds_efficiency", "power_offtake", "guide_vanes", "turbine_tip_clearance"}


def library():
    return [e for e in candidate_effects(turbofan()) if e.term.NAME in LIBRARY]


def both():
    return shared_effects(library(), turbofan().network)[f"{TERM}@hpt"]


def test_places_of_one_kind_are_those_of_one_term_at_like_parts():
    found = {e.label for e in shared_effects(candidate_effects(turbofan()), turbofan().network).values()}
    assert {f"{TERM}@hpt+lpt", "nozzle_discharge@core_nozzle+bypass_nozzle"} <= found
    assert not any("ambient" in label for label in found)


def test_it_is_the_same_effect_at_each_of_them_with_equal_coefficients():
    (name,) = both().amplitudes
    names = [e.amplitudes[0] for e in both().term.effects]
    inputs = {"altitude_m": [9000.0, 3000.0], "mach": [0.7, 0.4], "dT_isa_K": [0.0, 5.0], "Wf_kg_s": [0.6, 0.8]}
    inputs = {c: np.array(v) for c, v in inputs.items()}
    one = turbofan().replace_effects([both()]).predict(inputs, {name: SIZE}, wrt=(name,))
    apart = turbofan().replace_effects(list(both().term.effects)).predict(inputs, dict.fromkeys(names, SIZE), wrt=names)
    assert np.allclose(one.y, apart.y, rtol=1e-13)
    assert np.allclose(one.jacobian[..., 0], apart.jacobian.sum(axis=-1), rtol=1e-9, atol=1e-12)


@cache
def found():
    concealed = [(TERM, place, {"exponent": SIZE}) for place in ("hpt", "lpt")]
    recorded = flights(carried(*concealed), np.random.default_rng(31))
    return Search(evidence(recorded), library()).run()


@pytest.mark.slow
def test_one_size_is_found_where_one_acts_at_both_places():
    a = found()
    assert a.status == IDENTIFIED
    (o,) = a.explanations[0].options
    assert isinstance(o.hypothesis.effects[0].term, SharedTerm) and o.label == f"{TERM}@hpt+lpt"
    (c,) = a.explanations[0].coefficients
    assert abs(c.value - SIZE) < 3.0 * c.standard_error


@pytest.mark.slow
def test_a_file_states_it_at_each_place():
    (o,) = found().explanations[0].options
    stated = separate_effects(o.hypothesis.effects[0])
    assert [e.label for e in stated] == [f"{TERM}@hpt", f"{TERM}@lpt"]
    assert separate_effects(stated[0]) == (stated[0],)


@pytest.mark.parametrize("size", [0.05, 0.2])
def test_sizes_at_the_places_are_what_the_one_is(size):
    stated = separate_effects(replace(both(), values={"exponent": size}))
    assert [dict(e.values) for e in stated] == [{"exponent": size}] * 2


@pytest.mark.slow
def test_refine_fits_one_size_and_states_it_at_each_place():
    (o,) = found().explanations[0].options
    (e,) = o.hypothesis.effects
    (name,) = e.amplitudes
    trial = SimpleNamespace(coefficients={name: (SIZE, 0.01)})
    fitted, errors = _fitted([e], trial)
    assert [(f.label, f.values["exponent"]) for f in fitted] == [(f"{TERM}@hpt", SIZE), (f"{TERM}@lpt", SIZE)]
    assert errors == {f"{TERM}.hpt.exponent": 0.01, f"{TERM}.lpt.exponent": 0.01}


@pytest.mark.slow
def test_it_is_told_with_its_places():
    assert "at HPT and LPT (reynolds_turbine_efficiency@hpt+lpt)" in headline(found().explanations[0])
