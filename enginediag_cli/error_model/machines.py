"""Map coordinates of the turbomachines of an engine: where on its map each one runs.

    compressor   ln(N/√T_in),  ln(W_in √T_in / P_in)
    turbine      ln(N/√T_in),  ln(P_in / P_out)

Source: corrected quantities as in any component map, J. Kurzke and I. Halliwell, Propulsion and Power (2018), part D.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.turbine import Turbine

QUANTITIES = ("efficiency", "flow_capacity")
"""What a map gives, and what the health parameters of a machine multiply."""


@dataclass(frozen=True)
class Machine:
    """A compressor or turbine and the model columns from which its coordinates are made. `position`: W and P of the
    inlet of a compressor, P of inlet and outlet of a turbine. `shapes`: names of the parameters that say of which shape
    its map is."""

    name: str
    speed: str
    temperature: str
    position: tuple[str, str]
    compressor: bool
    shapes: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Model columns that `coordinates` reads."""
        return (self.speed, self.temperature, *self.position)

    @property
    def coordinate_columns(self) -> tuple[str, str]:
        """Columns under which coordinates that were computed before travel with a record."""
        return f"{self.name} ln corrected speed", f"{self.name} ln map position"

    def coordinates(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Corrected speed and position (N, 2), in logarithms, from the columns (N,); NaN where one is missing."""
        root = np.sqrt(values[self.temperature])
        first, second = (values[c] for c in self.position)
        with np.errstate(all="ignore"):
            position = np.log(first * root / second) if self.compressor else np.log(first / second)
            return np.column_stack([np.log(values[self.speed] / root), position])

    def differentials(self, log: Mapping[str, np.ndarray]) -> np.ndarray:
        """Derivatives (2, …) of both coordinates from those of the logarithms of the columns."""
        root = 0.5 * log[self.temperature]
        first, second = (log[c] for c in self.position)
        return np.stack([log[self.speed] - root, first - second + (root if self.compressor else 0.0)])

    def parameter(self, quantity: str) -> str:
        """Name of the health parameter that multiplies what the map gives."""
        return f"{self.name}.{quantity}"


def machines_of(engine: Any) -> tuple[Machine, ...]:
    """Turbomachines of an engine in the order of its gas path; none for a model without components."""
    network = getattr(engine, "network", None)
    if network is None:
        return ()
    label = {name: s["speed_label"] for name, s in network.shafts.items()}
    found = []
    for c in network.components:
        if isinstance(c, Compressor | Turbine):
            a, b = c.values["from"], c.values["to"]
            compressor = isinstance(c, Compressor)
            position = (f"W{a}_kg_s", f"P{a}_Pa") if compressor else (f"P{a}_Pa", f"P{b}_Pa")
            shapes = tuple(f"{c.name}.{quantity}" for quantity in c.map_shapes)
            speed = f"{label[c.values['shaft']]}_rpm"
            found.append(Machine(c.name, speed, f"T{a}_K", position, compressor, shapes))
    return tuple(found)


def columns_of(machines: Iterable[Machine]) -> tuple[str, ...]:
    """Model columns that the coordinates of all of them are made from, each once."""
    return tuple(dict.fromkeys(c for m in machines for c in m.columns))


def map_coordinates(
    engine: Any, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Coordinates (N, 2) of every machine of an engine by its name, NaN where there is no prediction."""
    machines = machines_of(engine)
    if not machines:
        return {}
    columns = columns_of(machines)
    p = engine.predict(inputs, parameters, sensors=(), also=columns)
    values = dict(zip(columns, np.where(p.ok[:, None], p.also, np.nan).T, strict=True))
    return {m.name: m.coordinates(values) for m in machines}
