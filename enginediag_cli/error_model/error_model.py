"""What an identification says about the error of its model, for everything downstream."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from enginediag_cli.engine.mismatch_block import MISMATCH
from enginediag_cli.error_model.curves import MapCurves
from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.error_model.points import OperatingPoints, PointErrorModel


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
