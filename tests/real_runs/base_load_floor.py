"""How well anything that knows outside air and TIT alone can predict a year of base load of the power plant.

    python tests/real_runs/base_load_floor.py

Polynomials of outside temperature, pressure and TIT, fitted to the steady base-load hours of 2011, on those of 2012.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from ground_recordings import CONFIGS, public_data

from enginediag_cli.recordings.recorder_file import load_recorder

KNOWN = ("ambient_temperature_K", "ambient_pressure_Pa", "T4_K")
READ = {"P3_Pa": "CDP", "T5_K": "TAT", "power_W": "TEY"}
FULL_K, BELOW_K = 1372.45, 822.15


def base_load(year: int) -> dict[str, np.ndarray]:
    """Steady hours at full TIT with the exhaust below what its control would hold."""
    recorder = load_recorder(CONFIGS / "recorders" / "uci_gas_turbine.yaml")
    [mapped] = recorder.read(public_data("uci_gas_turbine") / f"gt_{year}.csv")
    columns = {c: mapped.recording[c] for c in (*KNOWN, *READ)}
    rows = (columns["T4_K"] > FULL_K) & (columns["T5_K"] < BELOW_K)
    return {c: v[rows] for c, v in columns.items()}


def main() -> None:
    train, unseen = base_load(2011), base_load(2012)
    scale = {c: (train[c].mean(), train[c].std()) for c in KNOWN}

    def powers(hours: dict[str, np.ndarray], degree: int) -> np.ndarray:
        z = [(hours[c] - m) / s for c, (m, s) in scale.items()]
        products = [[z[i] for i in t] for n in range(1, degree + 1) for t in combinations_with_replacement(range(3), n)]
        return np.column_stack([np.ones(len(z[0])), *(np.prod(p, axis=0) for p in products)])

    for degree in (1, 2, 3):
        told = []
        for column, name in READ.items():
            fit = np.linalg.lstsq(powers(train, degree), train[column], rcond=None)[0]
            rms = float(np.sqrt(np.mean((unseen[column] - powers(unseen, degree) @ fit) ** 2)))
            told.append(
                f"{name} {rms:.2f} K" if column == "T5_K" else f"{name} {100 * rms / unseen[column].mean():.2f} %"
            )
        print(f"degree {degree}: {', '.join(told)} ({len(unseen['T4_K'])} hours of 2012)")


if __name__ == "__main__":
    main()
