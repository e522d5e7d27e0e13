"""At which operating point, at which power, and in which columns a gain is told."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.start import correction, total_ratios

THRUST, POWER = "Fn_N", "power_W"
"""What is held, in this order of preference from the last: the power of all loads, else net thrust."""
FUELS = ("Wf_total_kg_s", "Wf_kg_s")
"""Columns of fuel flow, all burners together first."""
DESIGN, RATING, RECORDED = "design point", "rating at the design condition", "mean recorded conditions"


@dataclass(frozen=True)
class Reference:
    """Inputs of one operating point, among them the power setting of a healthy engine; held: model column that is the
    same before and after; temperature: hottest recorded turbine temperature, or, with `recorded` false, the model's
    behind the last turbine; fuel: column of the fuel flow; words: which operating point it is."""

    inputs: Mapping[str, float]
    held: str
    temperature: str
    fuel: str
    words: str
    recorded: bool = True

    @property
    def columns(self) -> tuple[str, str, str]:
        """Of what is held, of the temperature and of the fuel."""
        return self.held, self.temperature, self.fuel


def plain_engine(model: Any) -> Engine | None:
    """The engine inside a model that wraps it; None where there is none."""
    while not isinstance(model, Engine):
        if not hasattr(model, "model"):
            return None
        model = model.model
    return model


def reference_of(engine: Engine, base: Mapping[str, float], recorded: Mapping[str, float]) -> Reference | None:
    """The design point; where that is not known or cannot be computed, the rating in the design point's flight
    condition, or else the mean of what was recorded, column -> value. base: parameters of the healthy engine. None
    where none of these is known or the engine gives neither thrust nor power."""
    columns = engine.model_columns
    held = next((c for c in (POWER, THRUST) if c in columns), None)
    fuel = next((c for c in FUELS if c in columns), None)
    if held is None or fuel is None:
        return None
    values = {n: v for n, v in base.items() if n in engine.parameters}
    behind, hot = f"T{engine.network.last_turbine_exit}_K", _hot_sensors(engine)
    for words, inputs in _candidates(engine, recorded):
        answer = engine.predict(inputs, values, sensors=(held, fuel, *hot))
        if answer.ok[0] and answer.y[0, 0] > 0:
            temperature = hot[int(np.argmax(answer.y[0, 2:]))] if hot else behind
            return Reference(inputs, held, temperature, fuel, words, recorded=bool(hot))
    return None


def _candidates(engine: Engine, recorded: Mapping[str, float]) -> Iterator[tuple[str, dict[str, float]]]:
    """Operating points that may serve, the best first: words, and all inputs of the engine."""
    condition, network = _design_condition(engine), engine.network
    if condition is not None:
        known = {**engine.optional_inputs, **condition}
        setting = np.asarray(network.design_setting * correction(network.power_setting, *total_ratios(known)), float)
        if network.demand is not None:
            setting = network.demand.set_point(setting)
        yield DESIGN, {**condition, engine.power_setting: float(np.ravel(setting)[0])}
        if engine.power_range is not None:
            rating = engine.power_from_fraction(1.0, known)
            yield RATING, {**condition, engine.power_setting: float(np.ravel(rating)[0])}
    if all(c in recorded for c in engine.inputs):
        yield RECORDED, {c: recorded[c] for c in engine.inputs}


def _design_condition(engine: Engine) -> dict[str, float] | None:
    """Inputs but the power setting at the design point; None where one of them has no value there."""
    network, found = engine.network, {}
    for column in engine.inputs:
        if column == engine.power_setting:
            continue
        if column in network.speed_columns:
            found[column] = float(network.shafts[network.speed_columns[column]]["design_speed_rpm"])
        elif column in network.design:
            found[column] = float(network.design[column])
        else:
            return None
    return found


def _hot_sensors(engine: Engine) -> tuple[str, ...]:
    """Sensors that read temperatures behind the burner."""
    hot: set[str] = set()
    behind = False
    for c in engine.network.components:
        behind = behind or isinstance(c, Burner)
        if behind:
            hot |= {f"T{c.values[end]}_K" for end in ("to", "rotor_inlet_station") if c.values.get(end)}
    return tuple(c for c, s in engine.sensors.items() if not s.over and s.reads.keys() <= hot)
