"""An engine whose maps may be wrong: what the error model adds to Φ, as parameters like any other.

    y = Φ(u, θ) + Σ_q ∂Φ/∂θ_q Σ_j a_qj φ_j(ξ_c)        ∂y/∂a_qj = ∂Φ/∂θ_q φ_j(ξ_c)

with θ_q the efficiency or flow capacity of machine c, ξ_c its map coordinates and a the amounts `map_error.<q>.<j>`.
ξ_c and ∂Φ/∂θ_q are those of the engine as its file describes it, whatever θ is: the derivatives are then exact, at
faulted coordinates an error of the maps cannot pass for the fault, and an identification does not chase columns that
move with what it finds. A prediction hands them over as `frozen`; who gives them back with the record saves time.

What an identification says about the error of its model, for everything downstream.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from enginediag_cli.engine.blocks import MISMATCH
from enginediag_cli.engine.engine import Prediction
from enginediag_cli.engine.wrapped import Question, WrappedModel
from enginediag_cli.error_model.curves import CURVES, LARGEST, QUANTITIES, Machine, MapCurves, columns_of, machines_of
from enginediag_cli.error_model.points import OperatingPoints, PointErrorModel
from enginediag_cli.parameters import Parameter

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
class _Group:
    """The amounts of one map quantity: what they multiply, and their names."""

    machine: Machine
    curves: MapCurves
    target: str
    names: tuple[str, ...]


class MapErrorModel(WrappedModel):
    """`model` with amounts of map error among its parameters; `sizes`: target → standard deviation of each amount."""

    def __init__(self, model: Any, curves: Sequence[MapCurves], sizes: Mapping[str, float]):
        known = {m.name: m for m in machines_of(model)}
        self.curves, self.sizes = tuple(curves), dict(sizes)
        self._groups = [
            _Group(known[c.machine], c, target, tuple(map_error_name(target, j + 1) for j in range(CURVES)))
            for c in curves
            for target in (known[c.machine].parameter(q) for q in QUANTITIES)
            if target in sizes and target in model.parameters
        ]
        amounts = [(n, self._parameter(model, g, n, j)) for g in self._groups for j, n in enumerate(g.names)]
        super().__init__(model, dict(amounts))

    def _parameter(self, model: Any, g: _Group, name: str, j: int) -> Parameter:
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

    def _answer(self, asked: Question) -> Any:
        """Readings moved by the errors of the maps, which the inputs bring along frozen or which are taken here."""
        amounts = {g.target: np.array([float(asked.own.get(n, 0.0)) for n in g.names]) for g in self._groups}
        along = tuple(n for n in asked.wrt if n not in self.own)
        if len(along) == len(asked.wrt) and not any(a.any() for a in amounts.values()):
            return self._ask(asked)
        inputs = asked.inputs
        columns = tuple(self.model.sensors) if asked.sensors is None else tuple(asked.sensors)
        taken = self._taken(columns)
        plain = {c: v for c, v in inputs.items() if c not in taken}
        brought = self.brought(inputs, columns)
        options = dict(asked.options)
        if brought:
            frozen = {name: inputs[name] for name in taken}
        else:
            frozen, x = self._frozen(plain, columns)
            if x is not None:  # the machines run near to where they do without errors
                options.setdefault("start", x)
        p = self._ask(asked, inputs=plain, sensors=columns, wrt=along, options=options)
        return _with_errors(p, self._groups, amounts, asked.wrt, frozen)

    def brought(self, inputs: Mapping[str, Any], sensors: Sequence[str]) -> bool:
        """Whether records bring along how errors of the maps act on these sensors."""
        return self._taken(sensors).keys() <= inputs.keys()

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
        curves = _curves_at(self._groups, frozen, n)
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

    def _taken(self, sensors: Sequence[str]) -> dict[str, None]:
        """Names of the frozen columns, in their order."""
        return dict.fromkeys(name for g in self._groups for name in _frozen_columns(g, sensors))

    def excitation(self, frozen: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Root mean square over the records of the curve of each amount, from frozen columns (N,)."""
        curves = _curves_at(self._groups, frozen, len(next(iter(frozen.values()), ())))
        rms = {machine: np.sqrt(np.mean(values**2, axis=0)).tolist() for machine, values in curves.items()}
        return {name: size for g in self._groups for name, size in zip(g.names, rms[g.machine.name], strict=True)}

    def coordinates(self, frozen: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Map coordinates (N, 2) of each machine, from frozen columns."""
        return _coordinates_at(self._groups, frozen, len(next(iter(frozen.values()), ())))

    def frozen(self, inputs: Mapping[str, Any], sensors: Sequence[str], **options: Any) -> dict[str, np.ndarray]:
        """Frozen columns (N,) by name of all map errors at these records, 0 where there is no prediction; options: of
        the model's prediction."""
        taken = self._taken(sensors)
        return self._frozen({c: v for c, v in inputs.items() if c not in taken}, sensors, **options)[0]

    def _frozen(
        self, plain: Mapping[str, Any], sensors: Sequence[str], **options: Any
    ) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
        """`frozen` of inputs without any, and the engine's unknowns there, where it tells them."""
        also = columns_of(g.machine for g in self._groups)
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


def _frozen_columns(g: _Group, sensors: Sequence[str]) -> tuple[str, ...]:
    return (*g.machine.coordinate_columns, *(_effect(g.target, c) for c in sensors))


def _columns(at: list[int]) -> slice | list[int]:
    """The same columns, as a slice where they follow each other: an array takes them several times as fast."""
    together = at == list(range(at[0], at[0] + len(at))) if at else False
    return slice(at[0], at[0] + len(at)) if together else at


def _curves_at(groups: Sequence[_Group], frozen: Mapping[str, np.ndarray], n: int) -> dict[str, np.ndarray]:
    """Machine → values (n, CURVES) of its curves at the frozen coordinates."""
    curves = {g.machine.name: g.curves for g in groups}
    return {name: curves[name].at(at) for name, at in _coordinates_at(groups, frozen, n).items()}


def _coordinates_at(groups: Sequence[_Group], frozen: Mapping[str, np.ndarray], n: int) -> dict[str, np.ndarray]:
    """Machine → its frozen coordinates (n, 2)."""
    return {
        machine.name: np.column_stack([np.broadcast_to(frozen[c], (n,)) for c in machine.coordinate_columns])
        for machine in {g.machine.name: g.machine for g in groups}.values()
    }


def _with_errors(
    p: Prediction,
    active: Sequence[_Group],
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
    curves = _curves_at(active, frozen, n)
    for g in active:
        phi = curves[g.machine.name]
        effect = np.column_stack([np.broadcast_to(frozen[_effect(g.target, c)], (n,)) for c in p.columns])
        if amounts[g.target].any():
            y += effect * (phi @ amounts[g.target])[:, None]
        asked = [j for j, name in enumerate(g.names) if name in where]
        J[:, :, _columns([where[g.names[j]] for j in asked])] = effect[:, :, None] * phi[:, None, _columns(asked)]
    kept = {f.name: getattr(p, f.name) for f in fields(Prediction)}
    return ModelledPrediction(**{**kept, "y": y, "jacobian": J, "wrt": wrt}, frozen=frozen)


def map_accuracy_of(engine: Any) -> float:
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

    def of(self, engine: Any) -> MapErrorModel:
        """The engine with amounts of map error, and what it misses at points, among its parameters."""
        inner = engine if self.points is None else PointErrorModel(engine, self.points, self.misses)
        return MapErrorModel(inner, self.curves, self.sizes)
