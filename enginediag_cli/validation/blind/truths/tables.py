"""Truth engines on tables: the model's maps sampled, made wrong, and written as map files beside an engine file.

A compressor's table holds flow, pressure ratio and efficiency on speed lines and R-lines, R = 2 + 2 (x − 1) / width of
the flow coefficient x of `compressor_map`; a turbine's, flow and efficiency against speed and pressure ratio. Flow and
efficiency of every table are multiplied by 1 + error of a `Distortion` each, that of efficiency half as large (a
turbine's flow along speed alone), and read back by parabolas between the lines. The design point stays as it was. Gas
properties are taken at the design inlet, as map files do, and that is one more difference.

What a health parameter means stays the model's meaning: less efficiency is less pressure at the same work, where an
engine file's table has more work at the same pressure. Otherwise a truth with one parameter changed would be one with
two in the model's words.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MethodType
from typing import Any

import numpy as np

from enginediag_cli.config.document import Node, dump, load_document
from enginediag_cli.engine.atmosphere import P_ISA, T_ISA
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import exp, log, sqrt
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.maps import compressor_map, turbine_map
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.blind.truths.distortion import Range, draw_distortion

ENGINE_FILE = "truth.yaml"
EFFICIENCY = 0.5
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


def tabulated(
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
    document = {k: v for k, v in _plain(load_document(engine.path)).items() if k not in LEFT_OUT}
    declared = {entry["name"]: entry for entry in document["components"]}
    for c in turbomachines:
        entry, file = declared[c.name], f"{c.name}.csv"
        entry.pop("map", None)
        where = (state, speed[c.values["shaft"]], (size, rng), folder / file)
        told = _compressor(c, *where) if isinstance(c, Compressor) else _turbine(c, *where)
        entry["table"] = {"file": file, "interpolation": "quadratic", **told}
    path = folder / ENGINE_FILE
    path.write_text(dump(document), encoding="utf-8")
    return _with_the_models_meaning(load_engine(path))


def _columns(engine: Engine, c: Compressor | Turbine) -> tuple[str, ...]:
    """Model columns that say where in its map the component runs."""
    start, end = c.values["from"], c.values["to"]
    label = engine.network.shafts[c.values["shaft"]]["speed_label"]
    return f"T{start}_K", f"P{start}_Pa", f"W{start}_kg_s", f"P{end}_Pa", f"{label}_rpm"


def _plain(node: Node) -> Any:
    """The values of a document without their places."""
    if node.is_mapping:
        return {key: _plain(child) for key, child in node.value.items()}
    return [_plain(child) for child in node.value] if node.is_list else node.value


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
    where = Range(n, x, (1.0, 1.0))
    flow_error, efficiency_error = (draw_distortion(where, part * size, rng) for part in (1.0, EFFICIENCY))
    speeds, positions = _grid(n, SPEEDS, 1.0), _grid(x, POSITIONS, 1.0)
    speeds, positions = speeds[speeds > 0.1], positions[positions > 0.1]
    N, X = np.meshgrid(speeds, positions, indexing="ij")
    W = X * N ** shape["flow_speed_exponent"]
    work, loss = (np.asarray(v) for v in compressor_map.work_and_loss(N, W, c.design_loss, dict(shape)))
    level, efficiency = N ** shape["work_speed_exponent"], c.values["isentropic_efficiency"]
    usable = np.all(work - loss > LEAST_IDEAL * level, axis=0)
    speeds, positions, N, X, W = speeds, positions[usable], N[:, usable], X[:, usable], W[:, usable]
    ideal = (work - loss)[:, usable] / efficiency  # relative to design
    ratio = (1.0 + ideal * (c.values["pressure_ratio"] ** AIR_EXPONENT - 1.0)) ** (1.0 / AIR_EXPONENT)
    eta = (1.0 - loss / work)[:, usable] * (1.0 + efficiency_error.at(N, X))
    width = float(np.ptp(positions))
    rline = 2.0 + 2.0 * (X - 1.0) / width
    _write(
        path,
        ("Nc_map", "Rline", "Wc_map", "PR_map", "eff_map"),
        (N, rline, W * (1.0 + flow_error.at(N, X)), ratio, eta),
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
    flow_error = draw_distortion(Range(n, np.ones(1), (1.0, 1.0)), size, rng)
    efficiency_error = draw_distortion(Range(n, ratio, (1.0, design)), EFFICIENCY * size, rng)
    speeds, ratios = _grid(n, SPEEDS, 1.0), _grid(ratio, POSITIONS, design)
    speeds, ratios = speeds[speeds > 0.1], ratios[ratios > 1.02]
    N, R = np.meshgrid(speeds, ratios, indexing="ij")
    flow = np.asarray(turbine_map.relative_capacity(np.log(R), N, float(np.log(design)), shape))
    drop = (1.0 - R**-GAS_EXPONENT) / (1.0 - design**-GAS_EXPONENT)
    eta = np.asarray(turbine_map.relative_efficiency(N / np.sqrt(drop), shape)) * c.values["isentropic_efficiency"]
    _write(
        path,
        ("Nc_map", "PR_map", "Wp_map", "eff_map"),
        (N, R, flow * (1.0 + flow_error.at(N, np.ones(1))), eta * (1.0 + efficiency_error.at(N, R))),
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


def _with_the_models_meaning(truth: Engine) -> Engine:
    for c in truth.network.components:
        if isinstance(c, Compressor) and c.table is not None:
            c.evaluate = MethodType(_at_the_same_work, c)  # type: ignore[method-assign]
    return truth


def _at_the_same_work(c: Compressor, e: Evaluation) -> None:
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
    phi = e.gas.at_enthalpy(inlet.h + ideal * e[f"{c.name}.efficiency"], inlet.mixture)[1]
    c._deliver(e, inlet, rise, exp((phi - inlet.phi) / inlet.R))
