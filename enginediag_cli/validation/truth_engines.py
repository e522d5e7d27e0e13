"""Truth engines that are not the model. Nothing of this file is in the registry of effects: no search can find it.

**Map errors.** Every turbomachine's flow capacity and efficiency are changed by a smooth factor of its corrected speed
n = (N/√T)/(N/√T)_design and, for compressors, of its corrected flow w = W√T/P over that of the design point:

    1 + s·[a₁ sin(2π f (n − 1) + φ) + a₂ tanh((n − n₀)/0.08) + a₃ (w − n)/0.1] − (the same at the design point)

with a ~ N(0, 1)/√(3/2), s = 0.3 % (flow) and 0.15 % (efficiency); turbines, which have no such w, have the slope
a₃ (n − 1)/0.1 in its place. Cooling and bleed fractions of the core flow change by up to ±0.8 % of the core flow in
total, and the gas constant by up to ±0.05 %, as that much water in the air makes it: R = R_air (1 + 0.608 w).

**Tables.** The model's maps are sampled, distorted, and written as map files beside an engine file. A compressor's
table has flow, pressure ratio and efficiency on speed lines and R-lines, R = 2 + 2 (x − 1) / width of the flow
coefficient x; a turbine's, flow and efficiency against speed and pressure ratio. Flow and
efficiency of every table are multiplied by 1 + error of a `Distortion` each, that of efficiency half as large (a
turbine's flow along speed alone), and interpolated by parabolas. The design point is unchanged. Gas properties are
taken at the design inlet, as map files do, which is one more difference. A health parameter keeps the model's meaning:
less efficiency is less pressure at the same work, where an engine file's table has more work at the same pressure.
Otherwise a truth with one changed parameter would be one with two in the model's terms.

**Distortion.** A smooth error that no polynomial of low order describes. Over a map's coordinates u (speed) and v
(position on the speed line), both 0 to 1 where the engine flies, or over a wider range where it hardly moves,

    error = Σ_k a_k sin(2π f_k (u cos ψ_k + v sin ψ_k) + φ_k) + b |u − u₀| + c_j sin(πv)

with waves k of random length and direction, a kink where the flow regime of the blades changes, and a waviness c_j of
each measured speed line j, linear between lines: rigs measure maps line by line. The value at the design point is
subtracted, since an engine is built to its design point, and the rest is scaled so that its root mean square about its
mean, over that range, is the size wanted: the map's *shape* is wrong by that much.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MethodType
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.document import Node, dump, load_document
from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine
from enginediag_cli.engine.dual import Value, chain, exp, log, sqrt, value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import P_ISA, T_ISA, Evaluation
from enginediag_cli.engine.maps import relative_capacity, relative_efficiency, work_and_loss
from enginediag_cli.engine.term import Coefficient, Effect, Place, Site, Term
from enginediag_cli.physics.engine_file import load_engine

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


FLOW, EFFICIENCY = 0.003, 0.0015
"""s of the equation above: what a map of the same type is usually known to."""
COOLING, GAS_CONSTANT = 0.008, 0.0005
"""Largest change of the cooling and bleed flows, as a share of the core flow, and of the gas constant."""
WATER = 0.608  # ∂ln R/∂w of humid air, w in kg per kg of dry air
WIDTH, SPREAD = 0.08, 0.1
"""Of the kink in n, and of the working line in w − n: scales in the equation above."""


@dataclass(frozen=True)
class MapErrors:
    """What is wrong with the model, as effects to carry, parameters to change and water in the air [kg/kg]."""

    effects: tuple[Effect, ...]
    parameters: Mapping[str, float]
    water: float


def draw_map_errors(engine: Engine, rng: np.random.Generator) -> MapErrors:
    """Map errors of every turbomachine, cooling and gas of one truth engine."""
    found = []
    for c in engine.network.components:
        if isinstance(c, Compressor | Turbine):
            for quantity, size in (("flow_capacity", FLOW), ("efficiency", EFFICIENCY)):
                found.append(_draw_map_error(c.name, quantity, size, rng))
    fractions = [
        n for n, p in engine.parameters.items() if p.family == "design" and p.quantity == "fraction" and p.nominal > 0
    ]
    total = sum(engine.parameters[n].nominal for n in fractions)
    change = rng.uniform(-COOLING, COOLING)
    parameters = {n: engine.parameters[n].nominal * (1.0 + change / total) for n in fractions}
    return MapErrors(tuple(found), parameters, float(rng.uniform(-GAS_CONSTANT, GAS_CONSTANT)) / WATER)


def _draw_map_error(component: str, quantity: str, size: float, rng: np.random.Generator) -> Effect:
    wave, kink, twist = size * rng.standard_normal(3) / np.sqrt(1.5)
    term = MapError(
        quantity,
        ErrorShape(
            float(wave),
            float(rng.uniform(1.5, 4.0)),
            float(rng.uniform(0.0, 2.0 * np.pi)),
            float(kink),
            float(rng.uniform(0.75, 1.0)),
            float(twist),
        ),
    )
    return Effect(term, Site(component, component, (f"{component}.{quantity}",)), {"present": 1.0})


@dataclass(frozen=True)
class ErrorShape:
    """a₁, f, φ, a₂, n₀, a₃ of the equation above, the a with s in them."""

    wave: float
    frequency: float
    phase: float
    kink: float
    middle: float
    twist: float

    def evaluate(self, n: Value, position: Value) -> Value:
        """The error at a corrected speed over that of the design point; `position` is 0 there."""
        turn = 2.0 * np.pi * self.frequency
        angle, rise = turn * (value(n) - 1.0) + self.phase, np.tanh((value(n) - self.middle) / WIDTH)
        at_design = self.wave * np.sin(self.phase) + self.kink * np.tanh((1.0 - self.middle) / WIDTH)
        curve = self.wave * np.sin(angle) + self.kink * rise - at_design
        slope = self.wave * turn * np.cos(angle) + self.kink * (1.0 - rise**2) / WIDTH
        return chain(curve, (slope, n)) + position * (self.twist / SPREAD)


class MapError(Term):
    """A smooth factor on one health parameter of a turbomachine."""

    TITLE = "Map error"
    STATEMENT = "The component's map is a little different from the model's."
    EQUATION = "factor = 1 + error(n, w)"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (Coefficient("present", "1", "1 where the error is there", upper=1.0, sigma=1.0, typical=1.0),)
    REFERENCE = "none: drawn"

    def __init__(self, quantity: str, shape: ErrorShape):
        self.NAME = f"map_error_{quantity}"
        self.quantity, self.shape = quantity, shape

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Compressor | Turbine):
                yield Site(c.name, c.name, (f"{c.name}.{self.quantity}",))

    def install(self, at: Place) -> None:
        c = at.component
        assert c is not None
        station, shaft = c.values["from"], c.values["shaft"]

        def speed(e: Evaluation) -> Value:
            return e.shaft(shaft).speed_rpm / sqrt(e.flows[station].T)

        def flow(e: Evaluation) -> Value:
            f = e.flows[station]
            return f.W * sqrt(f.T) / f.P

        n_design, w_design = scalar(speed(at.design)), scalar(flow(at.design))

        def factor(e: Evaluation, x: Value) -> Value:
            n = speed(e) * (1.0 / n_design)
            compressor = isinstance(c, Compressor)
            position = flow(e) * (1.0 / w_design) - n if compressor else n - 1.0
            return x * (1.0 + self.shape.evaluate(n, position))

        at.change_leaf(f"{c.name}.{self.quantity}", factor)


WAVES = 3
"""Enough that no two components are wrong in the same way."""
FREQUENCY = (0.3, 1.2)
"""Waves over the range that is flown, from and to: from a bend to a full swing."""
KINK, WAVINESS = 1.0, 0.35
"""Standard deviations of b and of c_j, where those of the a_k are 1. Judgement: a kink as large as a wave, and speed
lines that scatter by a third of it."""
LINES = 9
"""Speed lines that have a waviness of their own: as many as a rig measures between idle and full speed."""


LEAST_WIDTH = 0.3
"""Of either range, over the design value: an error does not swing within a few per cent of speed."""
GRID = 21
"""Values of u and of v at which the size of an error is measured."""


@dataclass(frozen=True)
class FlownRange:
    """Where an engine flies in a map: `speed` and `position` of the points flown (N,), and of the design point."""

    speed: np.ndarray
    position: np.ndarray
    design: tuple[float, float]

    def scaled(self, speed: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """u and v of the equation above, of the shape of both together."""
        found = []
        for x, own, design in zip((speed, position), (self.speed, self.position), self.design, strict=True):
            width = max(float(np.ptp(own)), LEAST_WIDTH * design)
            found.append((np.asarray(x, float) - 0.5 * (own.min() + own.max())) / width + 0.5)
        u, v = np.broadcast_arrays(*found)
        return u, v


@dataclass(frozen=True)
class Distortion:
    """A drawn error: `at` gives it as a share. Amplitudes are those before scaling, `factor` and `shift` scale."""

    range: FlownRange
    waves: np.ndarray
    middle: float
    kink: float
    lines: np.ndarray
    factor: float = 1.0
    shift: float = 0.0

    def evaluate(self, speed: np.ndarray, position: np.ndarray) -> np.ndarray:
        """The error at points of the map, of the shape of both coordinates together."""
        return self.evaluate_scaled(*self.range.scaled(speed, position))

    def evaluate_scaled(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The same at scaled coordinates."""
        a, f, psi, phi = self.waves
        along = u[..., None] * np.cos(psi) + v[..., None] * np.sin(psi)
        raw = np.sum(a * np.sin(2.0 * np.pi * f * along + phi), axis=-1)
        raw = raw + self.kink * np.abs(u - self.middle)
        raw = raw + np.interp(u, np.linspace(0.0, 1.0, LINES), self.lines) * np.sin(np.pi * np.clip(v, 0.0, 1.0))
        return np.asarray(self.factor * raw - self.shift)


def draw_distortion(where: FlownRange, size: float, rng: np.random.Generator) -> Distortion:
    """An error whose shape has the root mean square `size`, as a share, over the range that is flown."""
    waves = np.stack(
        [
            rng.standard_normal(WAVES),
            rng.uniform(*FREQUENCY, WAVES),
            rng.uniform(0.0, 2.0 * np.pi, WAVES),
            rng.uniform(0.0, 2.0 * np.pi, WAVES),
        ]
    )
    plain = Distortion(
        where,
        waves,
        float(rng.uniform(0.2, 0.8)),
        float(KINK * rng.standard_normal()),
        WAVINESS * rng.standard_normal(LINES),
    )
    spread = float(np.std(plain.evaluate_scaled(*np.meshgrid(*[np.linspace(0.0, 1.0, GRID)] * 2))))
    factor = size / max(spread, 1e-9)
    at_design = float(plain.evaluate(np.array(where.design[0]), np.array(where.design[1])))
    return Distortion(where, waves, plain.middle, plain.kink, plain.lines, factor, factor * at_design)


ENGINE_FILE = "truth.yaml"
TABLE_EFFICIENCY = 0.5
"""Error of efficiency over that of flow, as in truths with map errors."""
SPEEDS, POSITIONS = 15, 13
"""Grid values of a table: as many speed lines as map files of engine programs have, and R-lines or pressure ratios."""
MARGIN = 0.25
"""Of the range that is flown, added on either side, so that worn engines and other days stay on the map."""
LEAST_IDEAL = 0.05
"""Least isentropic work of a table point over that of design at the same speed: below is no compressor."""
AIR_EXPONENT, GAS_EXPONENT = 1.0 / 3.5, 0.25
"""(γ − 1)/γ of air, and of hot gas with γ = 1.33."""
LEFT_OUT = ("identification", "mismatch", "start")
"""Parts of an engine file that say how it is identified: the truth is not."""

State = Mapping[str, np.ndarray]
"""Columns (N,) of the model where the engine flies."""
Errors = tuple[float, np.random.Generator]
"""Size of the errors, and what they are drawn from."""


def tabulate_engine(
    engine: Engine, flown: Mapping[str, np.ndarray], size: float, rng: np.random.Generator, folder: Path
) -> Engine:
    """The engine on tables whose shapes are wrong by `size`, written into `folder` and read back.

    flown: inputs (N,) that say where in its maps the engine flies. Raises ConfigError as `load_engine` does.
    """
    turbomachines = [c for c in engine.network.components if isinstance(c, Compressor | Turbine) and c.table is None]
    wanted = dict.fromkeys(column for c in turbomachines for column in _columns(engine, c))
    p = engine.predict(dict(flown), sensors=tuple(wanted))
    state = dict(zip(p.columns, p.y[p.ok].T, strict=True))
    speed = {name: state[f"{s['speed_label']}_rpm"] for name, s in engine.network.shafts.items()}
    document = {k: v for k, v in _plain_values(load_document(engine.path)).items() if k not in LEFT_OUT}
    declared = {entry["name"]: entry for entry in document["components"]}
    for c in turbomachines:
        entry, file = declared[c.name], f"{c.name}.csv"
        entry.pop("map", None)
        where = (state, speed[c.values["shaft"]], (size, rng), folder / file)
        drawn = _compressor(c, *where) if isinstance(c, Compressor) else _turbine(c, *where)
        entry["table"] = {"file": file, "interpolation": "quadratic", **drawn}
    path = folder / ENGINE_FILE
    path.write_text(dump(document), encoding="utf-8")
    return _keep_efficiency_meaning(load_engine(path))


def _columns(engine: Engine, c: Compressor | Turbine) -> tuple[str, ...]:
    """Model columns that say where in its map the component runs."""
    start, end = c.values["from"], c.values["to"]
    label = engine.network.shafts[c.values["shaft"]]["speed_label"]
    return f"T{start}_K", f"P{start}_Pa", f"W{start}_kg_s", f"P{end}_Pa", f"{label}_rpm"


def _plain_values(node: Node) -> Any:
    """The values of a document without their places."""
    if node.is_mapping:
        return {key: _plain_values(child) for key, child in node.value.items()}
    return [_plain_values(child) for child in node.value] if node.is_list else node.value


def _grid(values: np.ndarray, count: int, through: float) -> np.ndarray:
    """Values over a range with its margin, one of them `through`, the design point."""
    low, high = min(values.min(), through), max(values.max(), through)
    margin = MARGIN * (high - low) + 0.02 * abs(through)
    grid = np.linspace(low - margin, high + margin, count)
    grid[np.argmin(np.abs(grid - through))] = through
    return np.asarray(grid)


def _compressor(c: Compressor, state: State, speed: np.ndarray, errors: Errors, path: Path) -> dict[str, float]:
    """Writes the table; what the engine file says of it. Pressure ratio by Δh_s = c_p T (PR^((γ−1)/γ) − 1)."""
    at = c.values["from"]
    theta = state[f"T{at}_K"] / T_ISA
    n = speed / np.sqrt(theta) / c.speed_scale
    w = state[f"W{at}_kg_s"] * np.sqrt(theta) / (state[f"P{at}_Pa"] / P_ISA) / c.flow_scale
    shape = c.values["map"]
    x = w / n ** shape["flow_speed_exponent"]
    size, rng = errors
    where = FlownRange(n, x, (1.0, 1.0))
    flow_error, efficiency_error = (draw_distortion(where, part * size, rng) for part in (1.0, TABLE_EFFICIENCY))
    speeds, positions = _grid(n, SPEEDS, 1.0), _grid(x, POSITIONS, 1.0)
    speeds, positions = speeds[speeds > 0.1], positions[positions > 0.1]
    N, X = np.meshgrid(speeds, positions, indexing="ij")
    W = X * N ** shape["flow_speed_exponent"]
    work, loss = (np.asarray(v) for v in work_and_loss(N, W, c.design_loss, dict(shape)))
    level, efficiency = N ** shape["work_speed_exponent"], c.values["isentropic_efficiency"]
    usable = np.all(work - loss > LEAST_IDEAL * level, axis=0)
    speeds, positions, N, X, W = speeds, positions[usable], N[:, usable], X[:, usable], W[:, usable]
    ideal = (work - loss)[:, usable] / efficiency  # relative to design
    ratio = (1.0 + ideal * (c.values["pressure_ratio"] ** AIR_EXPONENT - 1.0)) ** (1.0 / AIR_EXPONENT)
    eta = (1.0 - loss / work)[:, usable] * (1.0 + efficiency_error.evaluate(N, X))
    width = float(np.ptp(positions))
    rline = 2.0 + 2.0 * (X - 1.0) / width
    _write(
        path,
        ("Nc_map", "Rline", "Wc_map", "PR_map", "eff_map"),
        (N, rline, W * (1.0 + flow_error.evaluate(N, X)), ratio, eta),
    )
    return {"design_speed": 1.0, "design_rline": 2.0, "pressure_ratio_scale": 1.0, "efficiency_scale": 1.0}


def _turbine(c: Turbine, state: State, speed: np.ndarray, errors: Errors, path: Path) -> dict[str, float]:
    """Writes the table; what the engine file says of it. Ideal drop by Δh_s = c_p T (1 − PR^(−(γ−1)/γ))."""
    start, end = c.values["from"], c.values["to"]
    n = speed / np.sqrt(state[f"T{start}_K"]) / c.speed_scale
    ratio = state[f"P{start}_Pa"] / state[f"P{end}_Pa"]
    shape, design = dict(c.values["map"]), c.design_ratio
    size, rng = errors
    # near choking a flow that varies with pressure ratio by itself would have several solutions
    flow_error = draw_distortion(FlownRange(n, np.ones(1), (1.0, 1.0)), size, rng)
    efficiency_error = draw_distortion(FlownRange(n, ratio, (1.0, design)), TABLE_EFFICIENCY * size, rng)
    speeds, ratios = _grid(n, SPEEDS, 1.0), _grid(ratio, POSITIONS, design)
    speeds, ratios = speeds[speeds > 0.1], ratios[ratios > 1.02]
    N, R = np.meshgrid(speeds, ratios, indexing="ij")
    flow = np.asarray(relative_capacity(np.log(R), N, float(np.log(design)), shape))
    drop = (1.0 - R**-GAS_EXPONENT) / (1.0 - design**-GAS_EXPONENT)
    eta = np.asarray(relative_efficiency(N / np.sqrt(drop), shape)) * c.values["isentropic_efficiency"]
    _write(
        path,
        ("Nc_map", "PR_map", "Wp_map", "eff_map"),
        (N, R, flow * (1.0 + flow_error.evaluate(N, np.ones(1))), eta * (1.0 + efficiency_error.evaluate(N, R))),
    )
    return {
        "design_speed": 1.0,
        "design_pressure_ratio": float(design),
        "pressure_ratio_scale": 1.0,
        "efficiency_scale": 1.0,
    }


def _write(path: Path, header: Sequence[str], columns: Sequence[np.ndarray]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([[repr(float(v)) for v in row] for row in zip(*(c.ravel() for c in columns), strict=True)])


def _keep_efficiency_meaning(truth: Engine) -> Engine:
    for c in truth.network.components:
        if isinstance(c, Compressor) and c.table is not None:
            c.evaluate = MethodType(_evaluate_at_same_work, c)  # type: ignore[method-assign]
    return truth


def _evaluate_at_same_work(c: Compressor, e: Evaluation) -> None:
    """A compressor's table with the model's efficiency parameter: the table's work, and of it less as pressure."""
    assert c.table is not None
    inlet = e.flows[c.values["from"]]
    root = sqrt(inlet.T * (1.0 / T_ISA))
    n = e.shaft(c.values["shaft"]).speed_rpm / root * (1.0 / c.speed_scale)
    (wc, pr, eta), outside = c.table.lookup(n, e[f"{c.name}.rline"])
    e.mark_outside(c.name, outside)
    corrected_flow = inlet.W * root / (inlet.P * (1.0 / P_ISA))
    e.balances[f"{c.name} flow"] = corrected_flow / (wc * c.flow_scale * e[f"{c.name}.flow_capacity"]) - 1.0
    ideal = inlet.expanded_enthalpy(-log(1.0 + (pr - 1.0) * c.ratio_scale)) - inlet.h
    rise = ideal / (eta * c.efficiency_scale)
    phi = e.gas.temperature_from_enthalpy(inlet.h + ideal * e[f"{c.name}.efficiency"], inlet.mixture)[1]
    c._deliver(e, inlet, rise, exp((phi - inlet.phi) / inlet.R))
