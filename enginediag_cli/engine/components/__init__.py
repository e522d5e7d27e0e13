"""The component types of the network; a new one is one file and one line here."""

from __future__ import annotations

from enginediag_cli.engine.components.afterburner import Afterburner
from enginediag_cli.engine.components.ambient import Ambient
from enginediag_cli.engine.components.base import Actuator, Component, Unknown
from enginediag_cli.engine.components.bleed import Bleed
from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.condi_nozzle import CondiNozzle
from enginediag_cli.engine.components.duct import Duct
from enginediag_cli.engine.components.exhaust import Exhaust
from enginediag_cli.engine.components.gearbox import Gearbox
from enginediag_cli.engine.components.inlet import Inlet
from enginediag_cli.engine.components.intercooler import Intercooler
from enginediag_cli.engine.components.load import Load
from enginediag_cli.engine.components.mixer import Mixer
from enginediag_cli.engine.components.nozzle import Nozzle
from enginediag_cli.engine.components.propeller import Propeller
from enginediag_cli.engine.components.recuperator import Recuperator, RecuperatorHotSide
from enginediag_cli.engine.components.splitter import Splitter
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.components.water_injection import WaterInjection

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
