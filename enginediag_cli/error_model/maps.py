"""An engine whose component maps may be wrong: the errors as parameters, and the curves along which they vary.

A map error of a machine is a sum of smooth curves (`MapCurves`) of its map coordinates. With x the corrected speed and
r the position beyond its regression on x, both centred and scaled once, at training,

    φ_1…3 = √(2j + 1) P_j(x),  j = 1…3        φ_4,5 = √(2j + 1) P_j(r),  j = 1, 2        for |x|, |r| ≤ 1,

P_j Legendre polynomials: unit mean square over the range that training covered. Beyond it they stay as at its end,
since what training found says nothing there, and

    φ_6 = EDGE sign(x) (|x| − 1)₊        φ_7 = EDGE sign(r) (|r| − 1)₊

begin, of which training knows next to nothing. So an answer at an operating point outside training is not shifted but
uncertain, up to END, where these curves stay as well. A constant is the health parameter itself.

Within the range training may have gaps, a climb and a descent without the cruise between them. Three curves along speed
would span such a gap as if nothing could bend there, however large they may be: nearly certain, and wrong. Finer ones,

    φ_8,9 = FINER √(2j + 1) P_j(x),  j = 4, 5

are determined where training has records and stay uncertain in a gap.

The map coordinates of a machine say where on its map it runs:

    compressor   ln(N/√T_in),  ln(W_in √T_in / P_in)
    turbine      ln(N/√T_in),  ln(P_in / P_out)

Source: corrected quantities as in any component map, J. Kurzke and I. Halliwell, Propulsion and Power (2018), part D.

Operating points that recur (`PointErrorModel`) have one error for each reading and point. Records of a fleet at a few
conditions say where the model's error lies there, to the scatter of one reading over the
root of their number. What no error of the maps can be is then

    y_s = Φ_s(u, θ) + d_s,c(u),     d_sc ~ N(0, s_s²),

with c(u) the operating point at which a record is. It is the same when a window is judged, and cancels there, as far as
it is known; counted as noise it would hide what changes, and what engines differ by. Records at none of the points have
one such error in common, of which training knows nothing but its size.

`MapErrorModel` adds the map errors to Φ, as parameters like any other:

    y = Φ(u, θ) + Σ_q ∂Φ/∂θ_q Σ_j a_qj φ_j(ξ_c)        ∂y/∂a_qj = ∂Φ/∂θ_q φ_j(ξ_c)

with θ_q the efficiency or flow capacity of machine c, ξ_c its map coordinates and a the amounts `map_error.<q>.<j>`.
ξ_c and ∂Φ/∂θ_q are those of the engine as its file describes it, whatever θ is: the derivatives are then exact, at
faulted coordinates an error of the maps cannot pass for the fault, and an identification does not chase columns that
move with what it finds. A prediction returns them as `frozen`; giving them back with the record saves time.

`ErrorModel` is what an identification says about the error of its model, for every later step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.declaration import MISMATCH
from enginediag_cli.engine.engine import Prediction
from enginediag_cli.engine.wrapped import PredictionRequest, WrappedModel
from enginediag_cli.parameters import Parameter

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
EDGE_CURVES = [SPEED_DEGREE + POSITION_DEGREE, SPEED_DEGREE + POSITION_DEGREE + 1]
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

    def evaluate(self, coordinates: np.ndarray) -> np.ndarray:
        """Values (N, CURVES) at coordinates (N, 2); 0 where one is missing."""
        x = (coordinates[:, 0] - self.centre[0]) / self.reach[0]
        u = (coordinates[:, 1] - self.centre[1]) / self.reach[1]
        x = np.clip(np.nan_to_num(x), -END, END)
        r = np.clip(np.nan_to_num(u - np.polynomial.polynomial.polyval(x, self.line)), -END, END)
        along = _legendre_curves(x, FINER_DEGREE)
        smooth, finer = along[:, :SPEED_DEGREE], FINER * along[:, SPEED_DEGREE:]
        parts = (smooth, _legendre_curves(r, POSITION_DEGREE), _edge_curve(x), _edge_curve(r), finer)
        there = np.isfinite(coordinates).all(axis=1)
        return np.where(there[:, None], np.column_stack(parts), 0.0)

    def to_mapping(self) -> dict[str, list[float]]:
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


def _legendre_curves(x: np.ndarray, degree: int) -> np.ndarray:
    values = legendre.legvander(np.clip(x, -1.0, 1.0), degree)[:, 1:]
    return np.asarray(values * np.sqrt(2 * np.arange(1, degree + 1) + 1))


def _edge_curve(x: np.ndarray) -> np.ndarray:
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


def turbomachines(engine: Any) -> tuple[Machine, ...]:
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


def machine_columns(machines: Iterable[Machine]) -> tuple[str, ...]:
    """Model columns that the coordinates of all of them are made from, each once."""
    return tuple(dict.fromkeys(c for m in machines for c in m.columns))


def map_coordinates(
    engine: Any, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Coordinates (N, 2) of every machine of an engine by its name, NaN where there is no prediction."""
    machines = turbomachines(engine)
    if not machines:
        return {}
    columns = machine_columns(machines)
    p = engine.predict(inputs, parameters, sensors=(), also=columns)
    values = dict(zip(columns, np.where(p.ok[:, None], p.also, np.nan).T, strict=True))
    return {m.name: m.coordinates(values) for m in machines}


POINT_FAMILY = "point_error"
"""Family of what the model misses at operating points."""


@dataclass(frozen=True)
class OperatingPoints:
    """Boxes of the inputs: `low` and `high` (k, d) of k operating points, column by column of `inputs`."""

    inputs: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray

    def __len__(self) -> int:
        return len(self.low)

    def assign(self, inputs: Mapping[str, Any]) -> np.ndarray:
        """Number of the point at which each record is, (N,) int, k where it is at none."""
        u = np.column_stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(inputs[c], float)) for c in self.inputs)))
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        distance = np.max(np.abs(u[:, None, :] - middle) / half, axis=2)
        return np.where(np.nanmin(distance, axis=1, initial=np.inf) <= 1.0, distance.argmin(axis=1), len(self))


class PointErrorModel(WrappedModel):
    """`model` with what it misses at operating points among its parameters; `sizes`: column → standard deviation."""

    def __init__(self, model: Any, points: OperatingPoints, sizes: Mapping[str, float]):
        self.points, self.sizes = points, dict(sizes)
        self.groups = {s: tuple(f"{POINT_FAMILY}.{s}.{c + 1}" for c in range(len(points) + 1)) for s in sizes}
        self._place = {name: (s, c) for s, names in self.groups.items() for c, name in enumerate(names)}
        super().__init__(model, {name: self._parameter(name, s, c) for name, (s, c) in self._place.items()})

    def _parameter(self, name: str, sensor: str, c: int) -> Parameter:
        where = f"at operating point {c + 1}" if c < len(self.points) else "elsewhere"
        words = f"what the model misses of {sensor} {where}"
        return Parameter(
            name, POINT_FAMILY, 0.0, -np.inf, np.inf, self.sizes[sensor], "", words, sensor, "error", words, where
        )

    def _predict(self, request: PredictionRequest) -> Any:
        """Each reading moved by what the model misses of it at the record's operating point."""
        amounts, wrt = {name: float(value) for name, value in request.own.items()}, request.wrt
        along = tuple(n for n in wrt if n not in self._place)
        p = self._predict_inner(request, wrt=along)
        if len(along) == len(wrt) and not any(amounts.values()):
            return p
        at, y = self.points.assign(request.inputs), p.y.copy()
        at = np.broadcast_to(at, len(y))
        table = np.zeros((len(self.points) + 1, y.shape[1]))
        J = np.zeros((*y.shape, len(wrt)))
        column = {s: j for j, s in enumerate(p.columns)}
        for name, value in amounts.items():
            s, c = self._place[name]
            if s in column:
                table[c, column[s]] = value
        J[:, :, [i for i, n in enumerate(wrt) if n not in self._place]] = p.jacobian
        for i, name in enumerate(wrt):
            s, c = self._place.get(name, ("", 0))
            if s in column:
                J[:, column[s], i] = at == c
        return replace(p, y=y + table[at], jacobian=J, wrt=wrt)


def resize_point_errors(model: PointErrorModel, sizes: Mapping[str, float]) -> PointErrorModel:
    """The same with other sizes."""
    return PointErrorModel(model.model, model.points, sizes)


FAMILY = "map_error"
"""Family of the amounts by which maps are wrong."""


def map_error_name(target: str, j: int) -> str:
    """Name of the j-th amount, from 1, of the map quantity `target`."""
    return f"{FAMILY}.{target}.{j}"


@dataclass(frozen=True)
class ModelledPrediction(Prediction):
    """A prediction; `frozen`: columns (N,) by name that fix the errors of the maps as they are taken here."""

    frozen: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class _MapErrorGroup:
    """The amounts of one map quantity: what they multiply, and their names."""

    machine: Machine
    curves: MapCurves
    target: str
    names: tuple[str, ...]


class MapErrorModel(WrappedModel):
    """`model` with amounts of map error among its parameters; `sizes`: target → standard deviation of each amount."""

    def __init__(self, model: Any, curves: Sequence[MapCurves], sizes: Mapping[str, float]):
        known = {m.name: m for m in turbomachines(model)}
        self.curves, self.sizes = tuple(curves), dict(sizes)
        self._groups = [
            _MapErrorGroup(known[c.machine], c, target, tuple(map_error_name(target, j + 1) for j in range(CURVES)))
            for c in curves
            for target in (known[c.machine].parameter(q) for q in QUANTITIES)
            if target in sizes and target in model.parameters
        ]
        amounts = [(n, self._parameter(model, g, n, j)) for g in self._groups for j, n in enumerate(g.names)]
        super().__init__(model, dict(amounts))

    def _parameter(self, model: Any, g: _MapErrorGroup, name: str, j: int) -> Parameter:
        p = model.parameters[g.target]
        words = f"error {j + 1} of the map of {p.words}"
        size = self.sizes[g.target]
        return Parameter(name, FAMILY, 0.0, -np.inf, np.inf, size, "1", words, p.component, p.quantity, words, p.part)

    @property
    def targets(self) -> tuple[str, ...]:
        """Parameters whose maps may be wrong."""
        return tuple(g.target for g in self._groups)

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Target → names of its amounts."""
        return {g.target: g.names for g in self._groups}

    def _predict(self, request: PredictionRequest) -> Any:
        """Readings moved by the errors of the maps, which the inputs bring along frozen or which are taken here."""
        amounts = {g.target: np.array([float(request.own.get(n, 0.0)) for n in g.names]) for g in self._groups}
        along = tuple(n for n in request.wrt if n not in self.own)
        if len(along) == len(request.wrt) and not any(a.any() for a in amounts.values()):
            return self._predict_inner(request)
        inputs = request.inputs
        columns = tuple(self.model.sensors) if request.sensors is None else tuple(request.sensors)
        taken = self._frozen_names(columns)
        plain = {c: v for c, v in inputs.items() if c not in taken}
        brought = self.has_frozen_columns(inputs, columns)
        options = dict(request.options)
        if brought:
            frozen = {name: inputs[name] for name in taken}
        else:
            frozen, x = self._compute_frozen(plain, columns)
            if x is not None:  # the machines run near to where they do without errors
                options.setdefault("start", x)
        p = self._predict_inner(request, inputs=plain, sensors=columns, wrt=along, options=options)
        return _add_map_errors(p, self._groups, amounts, request.wrt, frozen)

    def has_frozen_columns(self, inputs: Mapping[str, Any], sensors: Sequence[str]) -> bool:
        """Whether records bring along how errors of the maps act on these sensors."""
        return self._frozen_names(sensors).keys() <= inputs.keys()

    @property
    def amounts(self) -> tuple[str, ...]:
        """Names of all amounts, those of one group after the other."""
        return tuple(self.own)

    def largest_effects(self, frozen: Mapping[str, np.ndarray], sensors: Sequence[str]) -> list[np.ndarray]:
        """Sensitivities (N, m, k) of the sensors to `amounts` for each curve alone, where it is largest.

        Together they span what errors of the maps can do at any operating point: a worn machine runs off the line on
        which training saw it, and there curves come in combinations that neither training nor any other point shows.
        """
        n = len(next(iter(frozen.values())))
        effects = [np.column_stack([frozen[_effect(g.target, c)] for c in sensors]) for g in self._groups]
        found = []
        for j, largest in enumerate(LARGEST):
            alone = np.zeros((n, len(sensors), len(self._groups), CURVES))
            alone[:, :, :, j] = largest * np.stack(effects, axis=2)
            found.append(alone.reshape(n, len(sensors), len(self._groups) * CURVES))
        return found

    def effects(self, frozen: Mapping[str, np.ndarray], sensors: Sequence[str]) -> np.ndarray:
        """Sensitivities (N, m, k) of the sensors to `amounts`, from frozen columns."""
        of_maps, curves = self.factors(frozen, sensors)
        found = of_maps[:, :, :, None] * curves[:, None]
        return np.asarray(found.reshape(*of_maps.shape[:2], -1))

    def factors(self, frozen: Mapping[str, np.ndarray], sensors: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """What `effects` are products of: sensitivities (N, m, G) of the sensors to each of G map quantities, and the
        values (N, G, CURVES) of its curves, from frozen columns."""
        n = len(next(iter(frozen.values())))
        curves = _evaluate_curves(self._groups, frozen, n)
        of_maps = np.empty((n, len(sensors), len(self._groups)))
        for i, g in enumerate(self._groups):
            for s, sensor in enumerate(sensors):
                of_maps[:, s, i] = frozen[_effect(g.target, sensor)]
        return of_maps, np.stack([curves[g.machine.name] for g in self._groups], axis=1)

    def effects_along(
        self, frozen: Mapping[str, np.ndarray], sensors: Sequence[str], directions: np.ndarray
    ) -> np.ndarray:
        """`effects` @ directions (k, r), (N, m, r): of each map the curves first, which are fewer than the sensors."""
        of_maps, curves = self.factors(frozen, sensors)
        by_map = directions.reshape(len(self._groups), CURVES, -1)
        steps = np.empty((*curves.shape[:2], directions.shape[1]))
        for i, own in enumerate(by_map):
            steps[:, i] = curves[:, i] @ own
        return np.asarray(of_maps @ steps)

    def _frozen_names(self, sensors: Sequence[str]) -> dict[str, None]:
        """Names of the frozen columns, in their order."""
        return dict.fromkeys(name for g in self._groups for name in _frozen_columns(g, sensors))

    def excitation(self, frozen: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Root mean square over the records of the curve of each amount, from frozen columns (N,)."""
        curves = _evaluate_curves(self._groups, frozen, len(next(iter(frozen.values()), ())))
        rms = {machine: np.sqrt(np.mean(values**2, axis=0)).tolist() for machine, values in curves.items()}
        return {name: size for g in self._groups for name, size in zip(g.names, rms[g.machine.name], strict=True)}

    def coordinates(self, frozen: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Map coordinates (N, 2) of each machine, from frozen columns."""
        return _frozen_coordinates(self._groups, frozen, len(next(iter(frozen.values()), ())))

    def frozen(self, inputs: Mapping[str, Any], sensors: Sequence[str], **options: Any) -> dict[str, np.ndarray]:
        """Frozen columns (N,) by name of all map errors at these records, 0 where there is no prediction; options: of
        the model's prediction."""
        taken = self._frozen_names(sensors)
        return self._compute_frozen({c: v for c, v in inputs.items() if c not in taken}, sensors, **options)[0]

    def _compute_frozen(
        self, plain: Mapping[str, Any], sensors: Sequence[str], **options: Any
    ) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
        """`frozen` of inputs without any, and the engine's unknowns there, where it gives them."""
        also = machine_columns(g.machine for g in self._groups)
        p = self.model.predict(plain, {}, sensors=tuple(sensors), wrt=self.targets, also=also, **options)
        values = dict(zip(also, p.also.T, strict=True))
        found: dict[str, np.ndarray] = {}
        for k, g in enumerate(self._groups):
            found.update(zip(g.machine.coordinate_columns, g.machine.coordinates(values).T, strict=True))
            found.update(zip((_effect(g.target, c) for c in sensors), p.jacobian[:, :, k].T, strict=True))
        found = {name: np.where(p.ok & np.isfinite(v), v, 0.0) for name, v in found.items()}
        return found, getattr(p, "x", None)


def _effect(target: str, sensor: str) -> str:
    """Column of the sensitivity of a sensor to what a map gives."""
    return f"{target} on {sensor}"


def _frozen_columns(g: _MapErrorGroup, sensors: Sequence[str]) -> tuple[str, ...]:
    return (*g.machine.coordinate_columns, *(_effect(g.target, c) for c in sensors))


def _columns(at: list[int]) -> slice | list[int]:
    """The same columns, as a slice where they follow each other: an array takes them several times as fast."""
    together = at == list(range(at[0], at[0] + len(at))) if at else False
    return slice(at[0], at[0] + len(at)) if together else at


def _evaluate_curves(
    groups: Sequence[_MapErrorGroup], frozen: Mapping[str, np.ndarray], n: int
) -> dict[str, np.ndarray]:
    """Machine → values (n, CURVES) of its curves at the frozen coordinates."""
    curves = {g.machine.name: g.curves for g in groups}
    return {name: curves[name].evaluate(at) for name, at in _frozen_coordinates(groups, frozen, n).items()}


def _frozen_coordinates(
    groups: Sequence[_MapErrorGroup], frozen: Mapping[str, np.ndarray], n: int
) -> dict[str, np.ndarray]:
    """Machine → its frozen coordinates (n, 2)."""
    return {
        machine.name: np.column_stack([np.broadcast_to(frozen[c], (n,)) for c in machine.coordinate_columns])
        for machine in {g.machine.name: g.machine for g in groups}.values()
    }


def _add_map_errors(
    p: Prediction,
    active: Sequence[_MapErrorGroup],
    amounts: Mapping[str, np.ndarray],
    wrt: tuple[str, ...],
    frozen: Mapping[str, np.ndarray],
) -> ModelledPrediction:
    """The prediction with the errors of the maps, and its sensitivities to `wrt`."""
    n, m = p.y.shape
    y, J = p.y.copy(), np.empty((n, m, len(wrt)))
    position = {name: i for i, name in enumerate(p.wrt)}
    where = {name: i for i, name in enumerate(wrt)}
    shared = [name for name in wrt if name in position]
    J[:, :, _columns([where[n] for n in shared])] = p.jacobian[:, :, _columns([position[n] for n in shared])]
    curves = _evaluate_curves(active, frozen, n)
    for g in active:
        phi = curves[g.machine.name]
        effect = np.column_stack([np.broadcast_to(frozen[_effect(g.target, c)], (n,)) for c in p.columns])
        if amounts[g.target].any():
            y += effect * (phi @ amounts[g.target])[:, None]
        columns = [j for j, name in enumerate(g.names) if name in where]
        J[:, :, _columns([where[g.names[j]] for j in columns])] = effect[:, :, None] * phi[:, None, _columns(columns)]
    kept = {f.name: getattr(p, f.name) for f in fields(Prediction)}
    return ModelledPrediction(**{**kept, "y": y, "jacobian": J, "wrt": wrt}, frozen=frozen)


def stated_map_accuracy(engine: Any) -> float:
    """Relative accuracy of the component maps as the engine file states it; its default where it does not, and 0 for a
    model without an engine file."""
    declared = getattr(engine, "declared", None)
    if declared is None:
        return 0.0
    default = next(f.default for f in MISMATCH.fields if f.name == "map_accuracy")
    return float((declared.get("mismatch") or {}).get("map_accuracy", default))


@dataclass(frozen=True)
class ErrorModel:
    """`stated`: accuracy of the maps as the engine file has it, a share; `curves`: by which functions each machine's
    maps may be wrong, frozen at training; `sizes`: map quantity (the health parameter that multiplies it) → standard
    deviation of each amount. `points`: operating points flown again and again, None where there were none, and
    `misses`: column → standard deviation of what the model misses there. What the amounts are, and how well they are
    known, stands among the estimates."""

    stated: float
    curves: tuple[MapCurves, ...]
    sizes: Mapping[str, float]
    points: OperatingPoints | None = None
    misses: Mapping[str, float] = field(default_factory=dict)

    def wrap(self, engine: Any) -> MapErrorModel:
        """The engine with amounts of map error, and what it misses at points, among its parameters."""
        inner = engine if self.points is None else PointErrorModel(engine, self.points, self.misses)
        return MapErrorModel(inner, self.curves, self.sizes)
