"""What the one search makes of recordings of a simulator that is not ours (pyCycle 4.4), concealed and injected.

    python tests/verification/pycycle_injected.py [--seed 0] [CASE ...]

prints a row for each case: recordings of that simulator as they are (`nominal` is the null, `concealed_1` … hold what
`answers/` says), and its nominal recording with an effect put in by the ratio of two predictions of our
model. Sensor noise is added afterwards. Values "at random" are drawn anew for every record.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from pycycle_concealed import FLIGHTS, columns, engine

from enginediag_cli.discrepancy.explain import search_and_refit
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight, Noise, Settings
from enginediag_cli.validation.injected import HEADER, Amplitude, InjectedEffect, table_row

AS_RECORDED = ("nominal", "concealed_1", "concealed_2", "concealed_3", "concealed_4")
COLD_K = 258.0


def at_random(size: float, seed: int = 5) -> Amplitude:
    """Uniform within ± size, a value for every record."""
    return lambda c: size * np.random.default_rng(seed).uniform(-1.0, 1.0, len(c["mach"]))


def slope(size: float, column: str = "N1_rpm") -> Amplitude:
    """Along a column, ± size at both ends of its range."""

    def amplitude(c: Mapping[str, np.ndarray]) -> np.ndarray:
        x = c[column]
        return size * (2.0 * (x - x.min()) / np.ptp(x) - 1.0)

    return amplitude


def cold_bleed(c: Mapping[str, np.ndarray]) -> np.ndarray:
    """2 % below COLD_K of static temperature."""
    altitude = np.minimum(c["altitude_m"], 11000.0)
    return np.where(288.15 - 0.0065 * altitude + c["dT_isa_K"] < COLD_K, 0.02, 0.0)


def slow_and_powerful(c: Mapping[str, np.ndarray]) -> np.ndarray:
    """1.5 % less at low Mach and high power."""
    return np.where((c["mach"] < 0.5) & (c["N1_rpm"] > np.median(c["N1_rpm"])), -0.015, 0.0)


def cases(of: Engine) -> dict[str, list[InjectedEffect]]:
    """What is put in, by the name of a case."""
    cooling = [p for p in of.parameters.values() if p.quantity == "fraction" and not p.switches and p.nominal > 0.0]
    cooling = [p for p in cooling if p.family == "design"]
    heat = next(p for p in of.parameters.values() if p.quantity == "lower_heating_value_J_kg")
    place: Callable[[str, Amplitude], InjectedEffect] = lambda n, a: InjectedEffect(a, parameter=n)  # noqa: E731
    return {
        "cooling at random, 15 %": [place(p.name, at_random(0.15 * p.nominal)) for p in cooling],
        "heating value at random, 1 %": [place(heat.name, at_random(0.01 * heat.nominal))],
        "ram recovery at random, 1 %": [place("inlet.pressure_recovery", at_random(0.01))],
        "bleed 2 % below 258 K": [InjectedEffect(cold_bleed, "customer_bleed", "hpc")],
        "fan efficiency, low Mach and high power": [place("fan.efficiency", slow_and_powerful)],
        "HPC map slope along speed, 3 %": [
            place("hpc.efficiency", slope(0.03)),
            place("hpc.flow_capacity", slope(0.03)),
        ],
    }


def dataset(of: Engine, recorded: Mapping[str, np.ndarray], seed: int) -> Dataset:
    """Noise added, records dealt to flights in turn."""
    noisy, rng = dict(recorded), np.random.default_rng(seed)
    for c in of.sensors:
        noisy[c] = recorded[c] + of.sensors[c].noise_sigma * rng.standard_normal(len(recorded[c]))
    flights = tuple(Flight(f"{k + 1}", "", {c: v[k::FLIGHTS] for c, v in noisy.items()}) for k in range(FLIGHTS))
    nuisance = {n: 0.02 for n in of.monitored} | {f"sensor.{s.quantity}.scale": 0.002 for s in of.sensors.values()}
    return Dataset(of, flights, Noise({c: s.noise_sigma for c, s in of.sensors.items()}), Settings(nuisance))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("cases", nargs="*")
    asked = parser.parse_args()
    print(HEADER, flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        of = engine(Path(scratch))
        put_in: dict[str, list[InjectedEffect]] = {name: [] for name in AS_RECORDED} | cases(of)
        for name in asked.cases or put_in:
            recorded = columns(name if name in AS_RECORDED else "nominal")
            for e in put_in[name]:
                for c, r in e.ratio(of, recorded).items():
                    recorded[c] = recorded[c] * r
            print(table_row(name, search_and_refit(dataset(of, recorded, asked.seed))), flush=True)


if __name__ == "__main__":
    main()
