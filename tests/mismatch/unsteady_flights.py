"""Flights of the shipped turbofan at 1 Hz in which the engine is moved about and a bleed switches at known times.

Nothing here is what the search assumes: readings lag behind the power lever each by its own time and size, drift like a
random walk that forgets, and the valve takes its time on a ramp or a decay. Records are averaged over 10 s where fuel
flow is steady, and only these are told to the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from concealed import carried, evidence, turbofan

from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.freeform import of_effect
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, IdentifiedHypothesis, identify_with
from enginediag_cli.mismatch.fit.identified import nuisance as along_of
from enginediag_cli.mismatch.unrecorded.finding import HiddenFinding, Switch
from enginediag_cli.mismatch.unrecorded.switched import switched_effect, switched_trials
from enginediag_cli.recordings.masking import SteadySettings, average_windows, find_failures
from enginediag_cli.recordings.table import Recording

BLEED = ("customer_bleed", "hpc")
WINDOW_S = 10.0
LENGTH_S = 3000
STEADY = SteadySettings(window_s=10.0, gap_s=3.0, spread={"Wf_kg_s": 0.01}, dwell_s=30.0, dwell={"Wf_kg_s": 0.03})
"""Of a fuel flow of 0.4 to 1 kg/s."""


@dataclass(frozen=True)
class Truth:
    """A search that has found the states: what it is given, what it has found, all records, and the true times of the
    changes by flight."""

    evidence: Dataset
    finding: HiddenFinding
    refitted: IdentifiedHypothesis
    raw: dict[tuple[str, str], dict[str, np.ndarray]]
    times: dict[str, np.ndarray]


def lever(rng: np.random.Generator) -> np.ndarray:
    """Share of full power, (LENGTH_S,): held for 20 to 150 s, then moved within 2 to 40 s."""
    t, at, power = [0.0], 0.0, [rng.uniform(0.5, 0.9)]
    while at < LENGTH_S:
        at += rng.uniform(20.0, 150.0)
        t.append(at)
        power.append(power[-1])
        at += rng.uniform(2.0, 40.0)
        t.append(at)
        power.append(float(np.clip(power[-1] + rng.normal(0.0, 0.12), 0.45, 0.95)))
    return np.interp(np.arange(LENGTH_S), t, power)


def lagged(x: np.ndarray, time_s: float) -> np.ndarray:
    """First-order response of a column (n,) at 1 Hz."""
    found, k = x.copy(), 1.0 - np.exp(-1.0 / max(time_s, 1e-3))
    for i in range(1, len(x)):
        found[i] = found[i - 1] + k * (x[i] - found[i - 1])
    return found


def valve(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """How far it is open, (LENGTH_S,), closed at first: on a ramp of 1 to 6 s, or decaying with 0.5 to 5 s."""
    t, on = np.arange(LENGTH_S, dtype=float), np.zeros(LENGTH_S)
    for k, at in enumerate(times):
        ramp = np.clip((t - at) / rng.uniform(1.0, 6.0), 0.0, 1.0)
        decay = np.where(t > at, -np.expm1(-np.maximum(t - at, 0.0) / rng.uniform(0.5, 5.0)), 0.0)
        on += (1.0 - 2.0 * (k % 2)) * (ramp if rng.uniform() < 0.5 else decay)
    return on


def one_flight(
    label: str, times: np.ndarray, amount: float, rng: np.random.Generator
) -> tuple[Flight, dict[str, np.ndarray]]:
    """Steady windows and all records of a flight."""
    engine, n = turbofan(), LENGTH_S
    t = np.arange(n, dtype=float)
    altitude = np.clip(rng.uniform(3000.0, 9000.0) + np.cumsum(lagged(rng.normal(0.0, 12.0, n), 60.0)), 1000.0, 10500.0)
    columns = {
        "altitude_m": altitude,
        "mach": 0.35 + 0.4 * altitude / 11500.0,
        "dT_isa_K": np.full(n, rng.normal(0, 5)),
    }
    power = lever(rng)
    columns["Wf_kg_s"] = engine.power_from_fraction(power, columns)
    off, on = (
        (engine.replace_effects(carried((*BLEED, {"fraction": amount}))) if x else engine).predict(columns)
        for x in (0, 1)
    )
    assert off.ok.all() and on.ok.all()
    open_ = valve(times, rng)[:, None]
    y = off.y + open_ * (on.y - off.y)
    for j, c in enumerate(off.columns):
        sigma = engine.sensors[c].noise_sigma
        behind = lagged(power, rng.uniform(2.0, 15.0)) - power
        walk = lagged(rng.normal(0.0, 1.0, n), 40.0) * 4.0
        columns[c] = y[:, j] + sigma * (rng.normal(0.0, 1.0, n) + walk + rng.normal(0.0, 150.0) * behind)
    failed = find_failures(Recording({"time_s": t, **columns}), STEADY)
    kept, _ = average_windows(Recording({"time_s": t, **columns, "valve": open_[:, 0]}), WINDOW_S, failed)
    return Flight(label, "", dict(kept.columns)), {"time_s": t, **columns}


def flown(rng: np.random.Generator, *, flights: int = 2, changes: int = 8, amount: float = 0.02) -> Truth:
    """Flights in each of which the bleed is switched `changes` times, every other time while the lever is moved or
    soon after, as it comes; states of steady windows told by the truth, but where it changes within one."""
    found, raw, times, states = [], {}, {}, []
    for k in range(flights):
        label = f"flight {k + 1}"
        own = np.sort(rng.uniform(0.0, 1.0, changes)) * (LENGTH_S - 200.0 - 150.0 * changes)
        times[label] = own + 100.0 + 150.0 * np.arange(changes)
        flight, raw[label, ""] = one_flight(label, times[label], amount, rng)
        states.append(flight.columns.pop("valve"))  # type: ignore[attr-defined]
        found.append(flight)
    told = evidence(found)
    along = along_of(told)
    base = identify_with(told, NULL_HYPOTHESIS, along)
    on = np.concatenate(states)
    trial = switched_trials([switched_effect(carried((*BLEED, {"fraction": amount}))[0])], on > 0.5, base, along)[0]
    assert trial.converged
    switches, first = [], 0
    for flight, s in zip(found, states, strict=True):
        t = flight.columns["time_s"]
        sure = np.flatnonzero(np.abs(s - 0.5) > 0.45)
        for a, b in pairwise(sure):
            if (s[a] > 0.5) != (s[b] > 0.5):
                switches.append(Switch(flight.label, int(b), bool(s[b] > 0.5), 1.0, float(t[a]), float(t[b])))
        first += len(t)
    none, every = np.zeros(first), np.arange(first)
    place = of_effect(carried((*BLEED, {"fraction": amount}))[0])
    finding = HiddenFinding(
        place, "1", "states", 1.0, 0.0, every, none, none, none, 1, states=on, is_switch=True, switches=tuple(switches)
    )
    return Truth(told, finding, trial.found, raw, times)
