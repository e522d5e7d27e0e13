"""Residuals record by record, as columns: what the charts of records read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.presentation.charts.model import Origin


@dataclass(frozen=True)
class Records:
    """Of one engine, in order: `sigmas` and `residual` (n,) by sensor column, in standard deviations of its noise and
    in its unit; `inputs` (n,) by column; `time_s` (n,), NaN where not known; the flight, file and line of each.

    `altitude` and `power`: the inputs that say how high and how hard the engine runs, "" where not known.
    """

    files: Sequence[str]
    lines: Sequence[int]
    flights: Sequence[str]
    time_s: np.ndarray
    sigmas: Mapping[str, np.ndarray]
    residual: Mapping[str, np.ndarray]
    inputs: Mapping[str, np.ndarray] = field(default_factory=dict)
    altitude: str = ""
    power: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def since(self, file: str, flight: str) -> Records:
        """From the first record of a flight on; all of them where it is not among these."""
        places = list(zip(self.files, self.flights, strict=True))
        first = places.index((file, flight)) if (file, flight) in places else 0
        return replace(
            self,
            files=self.files[first:],
            lines=self.lines[first:],
            flights=self.flights[first:],
            time_s=self.time_s[first:],
            sigmas={name: values[first:] for name, values in self.sigmas.items()},
            residual={name: values[first:] for name, values in self.residual.items()},
            inputs={name: values[first:] for name, values in self.inputs.items()},
        )

    def origin(self, k: int) -> Origin:
        return Origin(self.files[k], str(self.lines[k]))

    def stretches(self) -> list[tuple[str, np.ndarray]]:
        """Flights, or files where flights are not told, with the places of their records."""
        names = [f"flight {flight}" if flight else file for flight, file in zip(self.flights, self.files, strict=True)]
        keys = list(zip(self.files, names, strict=True))
        return [(key[1], np.array([k for k, other in enumerate(keys) if other == key])) for key in dict.fromkeys(keys)]

    def farthest(self, most: int) -> list[str]:
        """Sensors whose residuals lie farthest from nominal in the last stretch, farthest first."""
        _, last = self.stretches()[-1]
        means = {name: abs(mean_of(values[last])) for name, values in self.sigmas.items()}
        return sorted(means, key=lambda name: -means[name])[:most]


def mean_of(values: np.ndarray) -> float:
    """Of those that are there; 0 of none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else 0.0
