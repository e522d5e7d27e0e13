from __future__ import annotations

import numpy as np
import pytest
from simulation_toy import ToyEngine

from enginediag_cli.simulation.flights import default_plan, generate_flights, outside_envelope


@pytest.mark.parametrize(
    "envelope",
    [{"altitude_m": (0.0, 12500.0), "mach": (0.0, 0.88)}, {"altitude_m": (0.0, 9500.0), "mach": (0.0, 0.62)}],
)
def test_default_flights_stay_in_the_envelope_of_fast_and_slow_aircraft(envelope):
    engine = ToyEngine()
    engine.envelope = envelope
    conditions = generate_flights(default_plan(engine), engine, np.random.default_rng(0), flights=20)
    assert outside_envelope(engine, conditions) == {}
    assert conditions.columns["mach"].max() > 0.9 * min(0.8, envelope["mach"][1])


def test_an_engine_without_altitude_runs_on_the_ground():
    class GroundEngine(ToyEngine):
        inputs = ("ambient_temperature_K", "ambient_pressure_Pa", "Wf_kg_s")

        def power_from_fraction(self, fraction, inputs):
            return fraction * inputs["ambient_pressure_Pa"] / 101325.0

    engine = GroundEngine()
    columns = generate_flights(default_plan(engine), engine, np.random.default_rng(0)).columns
    assert set(columns) == {"flight", "time_s", "phase", *engine.inputs}
    assert len(columns["time_s"]) == 30 * 24
    assert 250.0 < columns["ambient_temperature_K"].min() and columns["ambient_temperature_K"].max() < 320.0
    assert np.all(np.abs(columns["ambient_pressure_Pa"] - 101325.0) < 4000.0)
