"""What deterioration takes of a temperature margin: the hottest recorded temperature of burnt gas, at given thrust.

With T the temperature, F the thrust (or the power that is delivered) and u the power setting, at a reference condition

    dT/dθ at given F = T_θ − T_u F_θ / F_u

so that what components have lost adds up as it does in the engine: kelvins of margin.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.detection.trend_of_files import Series
from enginediag_cli.engine.wiring import hot_columns
from enginediag_cli.engine.wrapped import WrappedModel
from enginediag_cli.residuals.monitor import Monitor

POINTS = 200
"""Operating points of identification among which the hottest is taken."""
DELIVERED = ("Fn_N", "power_W")
"""What an engine is there for, in the order in which it is asked: thrust, else power of the loads."""


@dataclass(frozen=True)
class MarginScale:
    """column: of the hottest recorded temperature, "" where none is recorded; sensor: name of its bias; slope:
    parameter → K per unit of the parameter; nominal_K: of a healthy engine at the reference; at: the reference
    condition, column → value; held: what was kept, "Fn_N", "power_W" or the power setting; reason: why there is none.
    """

    column: str = ""
    sensor: str = ""
    slope: dict[str, float] = field(default_factory=dict)
    nominal_K: float = float("nan")
    at: dict[str, float] = field(default_factory=dict)
    held: str = ""
    reason: str = ""

    @property
    def condition(self) -> str:
        """The reference condition as text."""
        return ", ".join(f"{c} {v:.6g}" for c, v in self.at.items()) + (f", at given {self.held}" if self.held else "")


def margin_scale(series: Series, among: Collection[str] = ()) -> MarginScale:
    """The scale of the engine that a series is of; among: columns one of which it is, where that is wished."""
    monitor = series.monitor
    if monitor is None or monitor.envelope is None:
        return MarginScale(reason="statistics without their engine do not tell what a change means for temperatures")
    engine: Any = monitor.engine
    while isinstance(engine, WrappedModel):
        engine = engine.model
    declared = getattr(engine, "declared", None)
    hot = set(hot_columns(declared["components"])) if declared else set()
    columns = [c for c in monitor.sensors if c in engine.sensors and _reads_only(engine.sensors[c], hot)]
    columns = [c for c in columns if not among or c in among]
    if not columns:
        return MarginScale(reason="no temperature of burnt gas is recorded")
    try:
        return _at_the_hottest(monitor, engine, columns)
    except KeyError as error:
        return MarginScale(reason=f"the reference condition cannot be computed: {error.args[0]}")


def _reads_only(sensor: Any, hot: set[str]) -> bool:
    return sensor.over is None and set(sensor.reads) <= hot


def _at_the_hottest(monitor: Monitor, engine: Any, columns: list[str]) -> MarginScale:
    points = np.asarray(monitor.envelope.points)
    some = np.unique(np.linspace(0, len(points) - 1, POINTS).round().astype(int))
    inputs = {c: points[some, i] for i, c in enumerate(monitor.envelope.inputs)}
    base = {name: float(v) for name, v in monitor.base.items() if name in engine.parameters}
    found = engine.predict(inputs, base, sensors=columns)
    y = np.where(found.ok[:, None], found.y, -np.inf)
    row, best = np.unravel_index(int(np.argmax(y)), y.shape)
    if not np.isfinite(y[row, best]):
        return MarginScale(reason="the engine computes none of the operating points of its identification")
    column = columns[best]
    at = {c: float(v[row]) for c, v in inputs.items()}
    setting = engine.power_setting
    delivers = [c for c in DELIVERED if c in engine.model_columns and c != setting]
    names = [n for n in monitor.monitored if n in engine.parameters and not monitor.meaning[n].of_instrument]
    asked = (column, *delivers[:1])
    here = engine.predict({c: np.array([v]) for c, v in at.items()}, base, sensors=asked, wrt=(*names, setting))
    J = np.asarray(here.jacobian[0])
    slope, held = J[0, :-1], setting
    if delivers and J[1, -1]:
        slope, held = slope - J[0, -1] * J[1, :-1] / J[1, -1], delivers[0]
    if not np.all(np.isfinite(slope)):
        return MarginScale(reason="the engine has no derivatives at the reference condition")
    sensor = next((p.name for p in engine.sensors[column].parameters() if p.quantity == "bias"), "")
    slopes = dict(zip(names, slope.tolist(), strict=True))
    return replace(MarginScale(column, sensor, slopes, float(here.y[0, 0]), at), held=held)
