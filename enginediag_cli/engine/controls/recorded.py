"""An actuator whose position the recording holds."""

from __future__ import annotations

from collections.abc import Mapping

from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.controls.control import Control, Derived


class Recorded(Control):
    """x = the input column, in the actuator's unit."""

    def __init__(self, name: str, actuator: Actuator, column: str):
        super().__init__(name, actuator)
        self.column = column

    def inputs(self) -> dict[str, float | None]:
        return {self.column: None}

    def position(self) -> Mapping[str, Derived]:
        return {self.actuator.name: lambda e: e[self.column]}
