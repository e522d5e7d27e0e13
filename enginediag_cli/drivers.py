"""What a discrepancy may vary with: the value of every driver in every record, and curves along them.

Drivers come from the inputs and from the model's own prediction, never from the readings that are judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.atmosphere import P_ISA, T_ISA
from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.inlet import Inlet
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.similarity import reynolds_index_of

SAME = 0.95
"""Correlation from which two drivers are one: these recordings cannot tell them apart."""

STILL = 1e-6
"""Relative spread below which a driver has not moved."""


@dataclass(frozen=True)
class Driver:
    """`word` of `physics.drivers.DRIVERS`, `name` (the word, with a shaft or nozzle where there are several), and
    the value in every record (N,) in `unit`."""

    word: str
    name: str
    unit: str
    values: np.ndarray

    @property
    def moves(self) -> bool:
        spread = np.nanstd(self.values)
        return bool(spread > STILL * max(1e-300, float(np.nanmean(np.abs(self.values)))))


def drivers(
    engine: Engine,
    inputs: Mapping[str, np.ndarray],
    parameters: Mapping[str, float],
    recorded: Mapping[str, np.ndarray] | None = None,
) -> list[Driver]:
    """Drivers of N records at these parameters, those that move; `recorded` are further columns (N,), such as
    hours or switches, that may drive an effect. Values are NaN where the engine has no prediction."""
    net = engine.network
    s2 = next(c.values["to"] for c in net.components if isinstance(c, Inlet))
    s4 = next(c.values["to"] for c in net.components if isinstance(c, Burner))
    speeds = list(net.speed_columns)
    nozzles = [c for c in engine.model_columns if c.endswith("nozzle_pressure_ratio")]
    s3 = next((c.values["to"] for c in reversed(net.components) if isinstance(c, Compressor)), None)
    others = {"BPR": ("bypass_ratio", "1")} if "BPR" in engine.model_columns else {}
    if s3 is not None:
        others[f"P{s3}_Pa"] = ("compressor_pressure", "Pa")
    inlet, hot = (f"T{s2}_K", f"P{s2}_Pa"), (f"T{s4}_K", f"P{s4}_Pa")
    wanted = tuple(dict.fromkeys((*inlet, *hot, "P0_Pa", *speeds, *nozzles, *others)))
    p = engine.predict(inputs, parameters, sensors=wanted)
    column = dict(zip(wanted, np.where(p.ok[:, None], p.y, np.nan).T, strict=True))
    T2, P2 = column[f"T{s2}_K"], column[f"P{s2}_Pa"]
    found = [
        Driver("ambient_pressure", "ambient_pressure", "ln(p0/p_ISA)", np.log(column["P0_Pa"] / P_ISA)),
        Driver("inlet_temperature", "inlet_temperature", "K", T2),
        Driver("power", "power", "T4/T2", column[f"T{s4}_K"] / T2),
        Driver("reynolds_index", "reynolds_index", "ln RNI", np.log(value(reynolds_index_of(T2, P2)))),
        Driver(
            "reynolds_index",
            "turbine_reynolds_index",
            "ln RNI",
            np.log(value(reynolds_index_of(column[f"T{s4}_K"], column[f"P{s4}_Pa"]))),
        ),
    ]
    if "mach" in inputs:
        found.insert(0, Driver("mach", "mach", "1", np.asarray(inputs["mach"], float)))
    for c in speeds:
        label = c.removesuffix("_rpm")
        found.append(Driver("corrected_speed", f"corrected_{label}", "rpm", column[c] / np.sqrt(T2 / T_ISA)))
        found.append(Driver("shaft_speed", label, "rpm", column[c]))
    for c in nozzles:
        found.append(Driver("nozzle_pressure_ratio", c.removesuffix("_pressure_ratio"), "1", column[c]))
    for c, (word, unit) in others.items():
        found.append(Driver(word, word, unit, column[c]))
    if "humidity_kg_kg" in inputs:
        found.append(Driver("humidity", "humidity", "kg/kg", np.asarray(inputs["humidity_kg_kg"], float)))
    for name, values in (recorded or {}).items():
        word = "hours" if name.endswith("_h") else "switch"
        found.append(Driver(word, name, "recorded", np.asarray(values, float)))
    return [d for d in found if d.moves]


def groups(found: Sequence[Driver]) -> list[list[str]]:
    """Names of drivers that these records cannot tell apart, |correlation| > SAME, in the order of the drivers."""
    values = np.array([np.nan_to_num(d.values, nan=float(np.nanmean(d.values))) for d in found])
    r = np.abs(np.atleast_2d(np.corrcoef(values))) if len(found) > 1 else np.ones((1, 1))
    left, result = list(range(len(found))), []
    while left:
        first = left[0]
        same = [k for k in left if r[first, k] > SAME]
        result.append([found[k].name for k in same])
        left = [k for k in left if k not in same]
    return result


def polynomials(values: np.ndarray, degree: int) -> np.ndarray:
    """Curves (N, degree) of unit mean square, orthogonal to a constant and to each other over the records; 0 where
    the value is missing. Fewer columns when the values do not carry that many."""
    good = np.isfinite(values)
    x = values[good] - values[good].mean()
    x = x / max(float(np.abs(x).max(initial=0.0)), 1e-300)
    V = np.vander(x, degree + 1, increasing=True)
    q, r = np.linalg.qr(V)
    keep = np.abs(np.diag(r)) > 1e-6 * np.abs(r[0, 0])
    curves = np.zeros((len(values), int(keep[1:].sum())))
    signs = np.sign(np.diag(r))[1:][keep[1:]]
    curves[good] = q[:, 1:][:, keep[1:]] * signs * np.sqrt(good.sum())
    return curves
