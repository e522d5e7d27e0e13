"""The component types of the network. A new type is a class beside its relatives and one line here."""

from __future__ import annotations

from enginediag_cli.engine.components.base import Actuator, Component, Unknown
from enginediag_cli.engine.components.combustion import Afterburner, Burner, WaterInjection
from enginediag_cli.engine.components.nozzles import CondiNozzle, Exhaust, Nozzle
from enginediag_cli.engine.components.passages import (
    Ambient,
    Bleed,
    Duct,
    Inlet,
    Intercooler,
    Mixer,
    Recuperator,
    RecuperatorHotSide,
    Splitter,
)
from enginediag_cli.engine.components.shaft_loads import Gearbox, Load, Propeller
from enginediag_cli.engine.components.turbomachinery import Compressor, Turbine

_TYPES: tuple[type[Component], ...] = (
    Ambient,
    Inlet,
    Compressor,
    Splitter,
    Bleed,
    Duct,
    Intercooler,
    Recuperator,
    WaterInjection,
    Burner,
    Afterburner,
    Turbine,
    RecuperatorHotSide,
    Mixer,
    Nozzle,
    CondiNozzle,
    Exhaust,
    Load,
    Gearbox,
    Propeller,
)
COMPONENTS: dict[str, type[Component]] = {c.TYPE: c for c in _TYPES}

__all__ = ["COMPONENTS", "Actuator", "Component", "Unknown"]
