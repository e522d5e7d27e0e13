"""Smooth functions of a machine's map coordinates, by which its map may be wrong.

With x the corrected speed and r the position beyond its regression on x, both centred and scaled once, at training,

    φ_1…3 = √(2j + 1) P_j(x),  j = 1…3        φ_4,5 = √(2j + 1) P_j(r),  j = 1, 2        for |x|, |r| ≤ 1,

P_j Legendre polynomials: unit mean square over the range that training covered. Beyond it they stay as at its end,
since what training found says nothing there, and

    φ_6 = EDGE sign(x) (|x| − 1)₊        φ_7 = EDGE sign(r) (|r| − 1)₊

begin, of which training knows next to nothing: an answer at an operating point that it did not see is not shifted but
wide by itself, up to END, where they stay, too. A constant is the health parameter itself.

Within the range training may have gaps, a climb and a descent without the cruise between them. Three curves along speed
would span such a gap as if nothing could bend there, however large they may be: nearly certain, and wrong. Finer ones,

    φ_8,9 = FINER √(2j + 1) P_j(x),  j = 4, 5

are fixed where training has been and leave open what it does not say of a gap.

Map coordinates of the turbomachines of an engine: where on its map each one runs.

    compressor   ln(N/√T_in),  ln(W_in √T_in / P_in)
    turbine      ln(N/√T_in),  ln(P_in / P_out)

Source: corrected quantities as in any component map, J. Kurzke and I. Halliwell, Propulsion and Power (2018), part D.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.turbine import Turbine

SPEED_DEGREE, POSITION_DEGREE = 3, 2
"""Degrees of what a map may err by along speed and across it: shapes that a map's author gets wrong. Judgement; the
blind trials' map errors are of other shapes on purpose."""
FINER_DEGREE = 5
"""Degree of the finest curve along speed: it swings once within an idle, a climb or a cruise."""
FINER = 0.5
"""Standard deviation of the finer curves' amounts over that of the others: a map is rather wrong at large than wavy.
Judgement; as large as the others they answer as rightly, and cost a little power."""
CURVES = FINER_DEGREE + POSITION_DEGREE + 2
"""Functions of one map quantity of one machine."""
BEYOND = [SPEED_DEGREE + POSITION_DEGREE, SPEED_DEGREE + POSITION_DEGREE + 1]
"""Which of them begin where training ends."""
FREEDOMS = 1 + SPEED_DEGREE + POSITION_DEGREE
"""Operating points at which a map quantity may have any errors at all: its constant and the curves within the range but
the finer ones."""
LEAST_REACH = 0.05
"""Half range of a logarithmic coordinate below which a map is not known to bend: within five per cent of speed or flow
an error of its shape is a constant and a slope."""
COVERED = (0.01, 0.99)
"""Shares of the training records between which lies the range that they cover."""
EDGE = 10.0
"""Growth of an error beyond the range, per half range: a third of what the polynomials would do at their end."""
END = 1.6
"""Scaled coordinate beyond which the curves stay: an error of 0.3 % there may be one of 2 %, as wrong as maps ever
are."""
LARGEST = np.concatenate(
    [
        np.sqrt(2.0 * np.array([*range(1, SPEED_DEGREE + 1), *range(1, POSITION_DEGREE + 1)]) + 1.0),
        [EDGE * (END - 1.0)] * 2,
        FINER * np.sqrt(2.0 * np.arange(SPEED_DEGREE + 1, FINER_DEGREE + 1) + 1.0),
    ]
)
"""Largest value (CURVES,) of each function, wherever a machine runs."""


@dataclass(frozen=True)
class MapCurves:
    """Frozen curves of one machine: `centre` and `reach` (2,) of its coordinates, and `line` (4,), the coefficients of
    the regression of the scaled position on powers 0…3 of the scaled speed."""

    machine: str
    centre: tuple[float, float]
    reach: tuple[float, float]
    line: tuple[float, ...]

    def at(self, coordinates: np.ndarray) -> np.ndarray:
        """Values (N, CURVES) at coordinates (N, 2); 0 where one is missing."""
        x = (coordinates[:, 0] - self.centre[0]) / self.reach[0]
        u = (coordinates[:, 1] - self.centre[1]) / self.reach[1]
        x = np.clip(np.nan_to_num(x), -END, END)
        r = np.clip(np.nan_to_num(u - np.polynomial.polynomial.polyval(x, self.line)), -END, END)
        along = _within(x, FINER_DEGREE)
        smooth, finer = along[:, :SPEED_DEGREE], FINER * along[:, SPEED_DEGREE:]
        parts = (smooth, _within(r, POSITION_DEGREE), _beyond(x), _beyond(r), finer)
        there = np.isfinite(coordinates).all(axis=1)
        return np.where(there[:, None], np.column_stack(parts), 0.0)

    def as_mapping(self) -> dict[str, list[float]]:
        """The numbers as plain values."""
        return {"centre": list(self.centre), "reach": list(self.reach), "line": list(self.line)}

    @staticmethod
    def from_mapping(machine: str, values: Mapping[str, list[float]]) -> MapCurves:
        """Curves of `as_mapping`."""
        return MapCurves(machine, *(tuple(values[k]) for k in ("centre", "reach", "line")))  # type: ignore[arg-type]


def learn_curves(machine: str, coordinates: np.ndarray) -> MapCurves | None:
    """Curves whose range is that of the coordinates (N, 2) of training; None where no record has any."""
    seen = coordinates[np.isfinite(coordinates).all(axis=1)]
    if not len(seen):
        return None
    low, high = np.quantile(seen, COVERED, axis=0)
    centre, reach = (low + high) / 2, np.maximum((high - low) / 2, LEAST_REACH)
    x, u = ((seen - centre) / reach).T
    powers = np.vander(x, SPEED_DEGREE + 1, increasing=True)
    # held a little: at one operating point nothing but the constant is determined
    held = np.concatenate([powers, 0.1 * np.eye(SPEED_DEGREE + 1)])
    line = np.linalg.lstsq(held, np.append(u, np.zeros(SPEED_DEGREE + 1)), rcond=None)[0]
    left = u - powers @ line
    own = float(max(np.quantile(np.abs(left), COVERED[1]), LEAST_REACH / reach[1]))
    # positions are measured in what they have beyond the line
    return MapCurves(
        machine,
        (float(centre[0]), float(centre[1])),
        (float(reach[0]), float(reach[1] * own)),
        tuple(float(c) / own for c in line),
    )


def _within(x: np.ndarray, degree: int) -> np.ndarray:
    values = legendre.legvander(np.clip(x, -1.0, 1.0), degree)[:, 1:]
    return np.asarray(values * np.sqrt(2 * np.arange(1, degree + 1) + 1))


def _beyond(x: np.ndarray) -> np.ndarray:
    return EDGE * (x - np.clip(x, -1.0, 1.0))


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
