"""Two engines of one aircraft with a common bleed that switches: one grid of times, one state for both."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from concealed import turbofan

from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Settings
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.unrecorded.aircraft import Grid, grid_of
from enginediag_cli.mismatch.unrecorded.hidden import hidden_amplitudes
from enginediag_cli.mismatch.unrecorded.whitened_rows import basis
from enginediag_cli.physics.registry import effect

RECORDS, BLEED = 60, "customer_bleed.hpc.fraction"


def flown(fraction, *, dropped=(), apart=0.0, seed=1):
    """Two recordings of an aircraft with two engines at powers of their own. `fraction`: of the bleed; `dropped`:
    records that the second engine lacks; `apart`: by how much its altitude is another, a share."""
    e, rng = turbofan(), np.random.default_rng(seed)
    truth = e.replace_effects([effect(e, "customer_bleed", "hpc")])
    health = [{n: 1 + 0.005 * rng.standard_normal() for n in e.monitored} for _ in range(2)]
    flights, states = [], []
    for f in range(2):
        state = np.zeros(RECORDS)
        state[20 + 5 * f : 38 + 5 * f] = 1.0
        states.append(state)
        t = np.linspace(0, 1, RECORDS)
        altitude = np.interp(t, [0, 0.3, 0.7, 1], [3000, 10_000, 10_500, 4000]) + rng.normal(0, 60, RECORDS)
        air = {"altitude_m": altitude, "mach": 0.3 + 0.5 * altitude / 12_000, "dT_isa_K": np.full(RECORDS, 4.0 * f)}
        for k in range(2):
            u = {c: v * (1 + apart * k) if c == "altitude_m" else v for c, v in air.items()}
            share = np.clip(np.interp(t, [0, 0.3, 0.7, 1], [1, 0.8, 0.75, 0.5]) + rng.normal(0, 0.05, RECORDS), 0.4, 1)
            u[e.power_setting] = e.power_from_fraction(share, u)
            p = truth.predict(u, {**health[k], BLEED: fraction * state})
            assert p.ok.all()
            sigma = np.array([s.noise_sigma for s in e.sensors.values()])
            y = p.y + sigma * rng.standard_normal(p.y.shape)
            columns = {"time_s": 10.0 * np.arange(RECORDS), **u, **dict(zip(p.columns, y.T, strict=True))}
            keep = np.array([i not in dropped or k == 0 for i in range(RECORDS)])
            columns = {c: v[keep] for c, v in columns.items()}
            flights.append(Flight(f"flight {f} engine {k}", str(k), columns, f"flight{f}.csv"))
    return flights, states


def fitted(flights):
    e = turbofan()
    noise = Noise({c: s.noise_sigma for c, s in e.sensors.items()})
    evidence = Dataset(e, tuple(flights), noise, Settings({n: 0.02 for n in e.monitored}, map_accuracy=0.0))
    along = nuisance(evidence)
    return identify_with(evidence, NULL_HYPOTHESIS, along), along


@cache
def case():
    flights, states = flown(0.008, dropped=(7, 30))
    found, along = fitted(flights)
    assert found.converged
    return found, along, states


def test_engines_that_fly_together_lie_side_by_side_on_one_grid_of_times():
    found, _, _ = case()
    grid = grid_of(found)
    assert (grid.rows, grid.seats) == (2 * RECORDS, 2)
    time = np.concatenate([f.columns["time_s"] for f in found.evidence.flights])
    flight = np.repeat([0, 0, 1, 1], [len(f) for f in found.evidence.flights])
    np.testing.assert_array_equal(grid.at, flight * RECORDS + time / 10.0)
    np.testing.assert_array_equal(grid.gap, np.tile(np.r_[0.0, np.ones(RECORDS - 1)], 2))


def test_a_record_that_one_engine_lacks_is_empty_in_its_columns_alone():
    found, _, _ = case()
    grid = grid_of(found)
    laid = grid.laid(np.ones((len(grid.at), 3)))
    assert laid.shape == (2 * RECORDS, 6)
    for flight in range(2):
        for k in range(RECORDS):
            row = laid[flight * RECORDS + k]
            assert row[:3].all() and bool(row[3:].all()) == (k not in (7, 30))
    common = np.arange(2 * RECORDS, dtype=float)
    np.testing.assert_array_equal(grid.folded(common[grid.at]), common)
    np.testing.assert_array_equal(basis(Projection(found)).of_records(common), common[grid.at])


def test_a_bleed_that_switches_for_both_engines_has_one_state_and_it_is_the_right_one():
    found, along, states = case()
    findings = hidden_amplitudes(found, Projection(found), rng=np.random.default_rng(2), along=along)
    first = findings[0]
    assert first.location.name == "customer_bleed@hpc" and first.significant and first.is_switch
    on = first.states > 0.5
    time = np.concatenate([f.columns["time_s"] for f in found.evidence.flights])[first.number]
    owner = np.repeat(np.arange(4), [len(f) for f in found.evidence.flights])[first.number]
    for flight in range(2):
        of = [dict(zip(time[owner == k], on[owner == k], strict=True)) for k in (2 * flight, 2 * flight + 1)]
        shared = of[0].keys() & of[1].keys()
        assert len(shared) == RECORDS - 2 and all(of[0][t] == of[1][t] for t in shared)
        assert np.mean([s == (states[flight][int(t / 10)] > 0.5) for t, s in of[0].items()]) > 0.95


@pytest.mark.parametrize("change", ["other air", "other file", "no time", "same engine"])
def test_flights_that_are_not_of_one_aircraft_have_no_grid(change):
    flights, _ = flown(0.0, apart=0.05 if change == "other air" else 0.0)
    flights = flights[:2]
    second = flights[1]
    if change == "other file":
        flights[1] = Flight(second.label, second.engine, second.columns, "elsewhere.csv")
    if change == "no time":
        columns = {c: v for c, v in second.columns.items() if c != "time_s"}
        flights[1] = Flight(second.label, second.engine, columns, second.file)
    if change == "same engine":
        flights[1] = Flight(second.label, flights[0].engine, second.columns, second.file)
    assert grid_of(fitted(flights)[0]) is None


def test_a_flight_without_a_companion_keeps_its_own_rows():
    flights, _ = flown(0.0)
    grid = grid_of(fitted(flights[:3])[0])
    assert (grid.rows, grid.seats) == (2 * RECORDS, 2)
    assert not grid.seat[2 * RECORDS :].any()
    np.testing.assert_array_equal(grid.at[2 * RECORDS :], RECORDS + np.arange(RECORDS))


def test_rows_without_a_grid_are_the_records_themselves():
    one = Grid(np.arange(4), np.zeros(4, int), 4, 1, np.zeros(4))
    values = np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(one.laid(values), values)
