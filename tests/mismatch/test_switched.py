"""Which listed effect was switched on and off, on the shipped turbofan, and what an installation's limits do."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed import evidence, turbofan

from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.load import build_dataset
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.unrecorded.hidden import hidden_amplitudes
from enginediag_cli.mismatch.unrecorded.switched import STATE, effects_that_switch, with_state_column
from enginediag_cli.physics.registry import candidate_effects, coefficient_limits, effect

SIZE = 0.02


def flight(label, bleed, state, rng):
    """Climb, cruise and descent of a healthy engine that carries the bleed; its state is in no column."""
    engine, n = turbofan(), len(state)
    altitude = np.interp(np.arange(n), [0, 15, 45, n], [2000, 10000, 11000, 3000]) + rng.normal(0, 100, n)
    columns = {"altitude_m": altitude, "mach": 0.35 + 0.45 * altitude / 11500, "dT_isa_K": np.full(n, rng.normal(0, 8))}
    columns["Wf_kg_s"] = engine.power_from_fraction(rng.uniform(0.4, 0.9, n), columns)
    p = engine.replace_effects([bleed]).predict({**columns, STATE: state})
    assert p.ok.all()
    noise = [engine.sensors[c].noise_sigma for c in p.columns]
    readings = p.y + rng.standard_normal(p.y.shape) * noise
    return Flight(label, "", {**columns, **dict(zip(p.columns, readings.T, strict=True))})


@cache
def case():
    """Anti-ice bleed of 2 % on in the middle third of every flight, and the search at the fit without it."""
    rng = np.random.default_rng(5)
    state = np.zeros(60)
    state[20:40] = 1.0
    bleed = replace(effect(turbofan(), "anti_ice_bleed", "hpc", {"fraction": SIZE}), switch=STATE)
    given = evidence([flight(f"flight {k + 1}", bleed, state, rng) for k in range(3)])
    along = nuisance(given)
    found = identify_with(given, NULL_HYPOTHESIS, along)
    base = HypothesisFit((), found, Projection(found))
    findings = hidden_amplitudes(found, base.projection, rng=rng, along=along)
    return base, along, findings, np.tile(state, 3)


def test_the_bleed_that_was_switched_fits_best_of_those_at_the_same_place():
    base, along, findings, state = case()
    told = effects_that_switch(findings, list(candidate_effects(turbofan())), base, along)
    assert told is not None
    finding, trials = told
    assert finding.location.name == trials[0].label == "anti_ice_bleed@hpc"
    assert {"customer_bleed@hpc", "interstage_bleed@hpc"} <= {t.label for t in trials}
    assert ((finding.states > 0.5) == (state[finding.number] > 0.5)).mean() > 0.95
    value, error = trials[0].coefficients["anti_ice_bleed.hpc.fraction"]
    assert abs(value - SIZE) < 3.0 * error


def test_no_effect_is_told_when_none_in_the_library_acts_there():
    base, along, findings, _ = case()
    assert effects_that_switch(findings, [effect(turbofan(), "humidity", "ambient")], base, along) is None


def test_states_stand_in_a_column_of_every_flight():
    base, _, _, state = case()
    there = with_state_column(base.found.evidence, state)
    assert np.array_equal(np.concatenate([f.columns[STATE] for f in there.flights]), state)


def with_limits(values):
    engine = turbofan()
    declared = {
        **engine.declared,
        "mismatch": {"nuisance": [], "prior_sigma": {}, "map_accuracy": 0.0, "noise": "specified", "limits": values},
    }
    return type(engine)(engine.network, declared, engine.path)


def test_a_limit_of_the_installation_is_the_upper_bound_of_the_coefficient():
    engine = with_limits({"power_offtake.hp.fraction": 0.006})
    assert coefficient_limits(engine) == {"power_offtake.hp.fraction": 0.006}
    (p,) = effect(engine, "power_offtake", "hp").parameters()
    assert p.upper == 0.006
    (p,) = effect(turbofan(), "power_offtake", "hp").parameters()
    assert p.upper > 0.006


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"power_offtake.hp.fractoin": 0.006}, "power_offtake.hp.fraction"),
        ({"power_offtake.hp.fraction": -0.1}, "below 0"),
    ],
)
def test_a_limit_that_makes_no_sense_is_refused(values, told):
    base, _, _, _ = case()
    with pytest.raises(DataError, match=told):
        build_dataset(with_limits(values), base.found.evidence.flights)
