"""What an engine remembers of a recording: any record finds its own past, whoever is asked for beside it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine import solver
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect

CONFIGS = Path(__file__).resolve().parents[3] / "configs"


@pytest.fixture(autouse=True)
def tightly_solved(monkeypatch):
    """Solves go to rounding, so that differences of them are not differences of their tolerance."""
    monkeypatch.setattr(solver, "TOLERANCE", 3e-13)


@cache
def engine_of(name):
    return load_engine(CONFIGS / f"{name}.yaml")


def moving(name, **effects):
    """An engine that carries effects `term__site` with their values."""
    engine = engine_of(name)
    return engine.with_effects([effect(engine, *label.split("__"), values) for label, values in effects.items()])


def flight(engine, n=80, seed=0):
    """Inputs of a recording with steps and ramps of power, unevenly sampled, and its time."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, n))
    fraction = np.interp(time, [0, 15, 16, 35, 50, 51, 200], [0.5, 0.5, 0.85, 0.85, 0.6, 0.75, 0.75])
    low = {c: 0.5 * sum(engine.envelope[c]) for c in engine.inputs if c in engine.envelope}
    columns = {c: np.full(n, low[c]) for c in engine.inputs if c in low}
    if "altitude_m" in columns:
        columns |= {"altitude_m": np.full(n, 1000.0), "mach": np.full(n, 0.3), "dT_isa_K": np.zeros(n)}
    columns[engine.power_setting] = engine.power_from_fraction(fraction, columns)
    return {"time_s": time, **columns}


def on_tape(engine, columns):
    return {c: v for c, v in columns.items() if c in engine.inputs} | {MOMENT: engine.tapes.add(columns)}


MOVING = {
    "load_rate_limit": ("micro_gas_turbine", {"load_rate_limit__generator": {"rise": 30.0, "fall": 20.0}}),
    "load_control_lag": ("micro_gas_turbine", {"load_control_lag__generator": {"time_constant": 7.0}}),
    "load_second_order_lag": ("micro_gas_turbine", {"load_second_order_lag__generator": {"first": 7.0, "second": 3.0}}),
    "load_control_delay": ("micro_gas_turbine", {"load_control_delay__generator": {"delay": 3.3}}),
    "fuel_control_lag": ("turbojet", {"fuel_control_lag__burner": {"time_constant": 3.0}}),
    "fuel_rate_limit": ("turbojet", {"fuel_rate_limit__burner": {"rise": 30.0, "fall": 20.0}}),
    "probe_lag": ("citation_jt15d", {"probe_lag__T5": {"time_constant": 4.0}}),
    "heat_soak": ("citation_jt15d", {"heat_soak__hpt": {"exchange": 0.03, "time_constant": 20.0}}),
    "clock_shift": ("citation_jt15d", {"clock_shift__Wf": {"delay": 0.7}}),
    "rotor_inertia": ("citation_jt15d", {"rotor_inertia__lp": {"inertia": 0.3}}),
}


def test_names():
    for name in ("turbojet", "citation_jt15d"):
        e = engine_of(name)
        from enginediag_cli.physics.registry import candidates
        print(name, e.inputs, list(e.sensors), [c.label for c in candidates(e) if MOMENT in c.term.INPUTS])
