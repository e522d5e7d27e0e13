"""What an identification says about the error of its model, for everything downstream."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from enginediag_cli.engine.mismatch_block import MISMATCH
from enginediag_cli.error_model.curves import MapCurves
from enginediag_cli.error_model.modelled import MapErrorModel


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
    deviation of each amount. What the amounts are, and how well they are known, stands among the estimates."""

    stated: float
    curves: tuple[MapCurves, ...]
    sizes: Mapping[str, float]

    def of(self, engine: Any) -> MapErrorModel:
        """The engine with amounts of map error among its parameters."""
        return MapErrorModel(engine, self.curves, self.sizes)
