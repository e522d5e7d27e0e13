"""Where something is missing that remembers, `locate` says that it goes with how power has changed."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.drivers import LAGGING, RATE
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.load import build_dataset
from enginediag_cli.mismatch.locate.locate import locate
from enginediag_cli.mismatch.locate.moving_drivers import moving_drivers
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.shipped import shipped

RECORDS = 240


def flights(engine, truth, *, seed, interval=1.0, past=True):
    """Three recordings of steps and ramps of power at sea level; `past`: their records know what was before."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(3):
        time = interval * np.arange(float(RECORDS))
        corners = np.sort(rng.uniform(0.0, time[-1], 8))
        still = {
            "altitude_m": np.full(RECORDS, 1000.0 * k),
            "mach": np.full(RECORDS, 0.2),
            "dT_isa_K": np.zeros(RECORDS),
        }
        power = engine.power_from_fraction(np.interp(time, corners, rng.uniform(0.3, 1.0, 8)), still)
        columns = {"time_s": time, **still, engine.power_setting: power}
        inputs = {c: v for c, v in columns.items() if c in engine.inputs}
        y = truth.predict({**inputs, MOMENT: truth.tapes.add(columns)}).y
        for j, (c, sensor) in enumerate(engine.sensors.items()):
            columns[c] = y[:, j] + rng.normal(0.0, sensor.noise_sigma, RECORDS)
        if past:
            columns[MOMENT] = engine.tapes.add(columns)
        found.append(Flight(f"flight {k + 1}", "", columns))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("term", "site", "values", "place"),
    [
        ("probe_lag", "T5", {"time_constant": 5.0}, "sensor.T5"),
        ("heat_soak", "turbine", {"exchange": 0.03, "time_constant": 25.0}, ""),
    ],
)
def test_what_remembers_is_located_by_how_power_has_changed(term, site, values, place):
    engine = load_engine(shipped("turbojet.yaml"))
    truth = engine.replace_effects([effect(engine, term, site, values)])
    found = locate(build_dataset(engine, flights(engine, truth, seed=1)))
    assert found.mismatch
    first = found.places[0]
    assert first.cell.driver.driver in (RATE, LAGGING)
    assert not place or first.cell.location.component == place


def test_steady_records_have_no_such_drivers():
    engine = load_engine(shipped("turbojet.yaml"))
    assert moving_drivers(build_dataset(engine, flights(engine, engine, seed=2, past=False))) == []
    assert moving_drivers(build_dataset(engine, flights(engine, engine, seed=2, interval=30.0))) == []
    assert {d.driver for d in moving_drivers(build_dataset(engine, flights(engine, engine, seed=2)))} == {
        RATE,
        LAGGING,
    }
