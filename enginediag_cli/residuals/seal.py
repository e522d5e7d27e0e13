"""What binds a row of statistics to how it was made: the nominal and the settings, and a checksum of the row itself."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isnan
from typing import Any

from enginediag_cli.residuals.windows import WindowPlan
from enginediag_cli.safe_text import UNSPEAKABLE

CHECKSUM = "checksum"
"""Column that holds the checksum of the other columns of its row."""
PREFIX = "made:"
"""Begins the columns that say how a row was made, `made:nominal` and so on."""
DIGITS = 16
"""Hexadecimal digits of a checksum: an accident in 10¹⁹ passes."""


@dataclass(frozen=True)
class MadeWith:
    """How statistics were made. nominal: fingerprint of the nominal state and of its engine; reference and last:
    records, 0 for none; recorder: of its file."""

    nominal: str
    window: str = ""
    step: str = ""
    linearise: str = "estimate"
    monitor: str = ""
    reference: str = "0"
    last: str = "0"
    model_error: str = ""
    recorder: str = ""
    engine_instance: str = ""

    def cells(self) -> dict[str, str]:
        """One column per choice."""
        return {f"{PREFIX}{f.name}": getattr(self, f.name) for f in fields(self)}

    def differences(self, other: MadeWith) -> tuple[tuple[str, str, str], ...]:
        """(what, here, there) of every choice in which the two differ."""
        pairs = ((f.name, getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return tuple((name, here, there) for name, here, there in pairs if here != there)

    @property
    def overlapping(self) -> bool:
        """Whether windows were asked for that share records."""
        return bool(self.step) and self.step != self.window


MADE_COLUMNS = tuple(f"{PREFIX}{f.name}" for f in fields(MadeWith))


def plan_cells(plan: WindowPlan) -> dict[str, str]:
    """`window` and `step` of a plan as `MadeWith` keeps them: "60", "600 s", or "" for whole flights."""
    if plan.grid == float("inf"):
        return {"window": "", "step": ""}
    unit = " s" if plan.in_time else ""
    return {"window": f"{plan.length:.10g}{unit}", "step": f"{plan.step:.10g}{unit}"}


def made_with(row: Mapping[str, str]) -> MadeWith | None:
    """How a row says that it was made; None when it does not say."""
    if not all(column in row for column in MADE_COLUMNS):
        return None
    return MadeWith(**{f.name: row[f"{PREFIX}{f.name}"] for f in fields(MadeWith)})


def sealed(row: Mapping[str, Any], made: MadeWith) -> dict[str, Any]:
    """The row with how it was made and the checksum of it all."""
    whole = {**row, **made.cells()}
    return {**whole, CHECKSUM: checksum(whole)}


def checksum(row: Mapping[str, Any], without: tuple[str, ...] = ()) -> str:
    """Checksum of a row as it is written or as it was read: of the values of its columns, `without` some.

    Neither the order of the columns matters nor how a number is written, only its value; empty cells are as none.
    """
    digest = hashlib.sha256()
    for column in sorted(row):
        text = _canonical(row[column]) if column != CHECKSUM and column not in without else ""
        if text:
            digest.update(f"{column}\0{text}\0".encode(errors=UNSPEAKABLE))
    return digest.hexdigest()[:DIGITS]


def _canonical(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (list, tuple)):
        return "; ".join(map(str, value))
    text = str(value)
    try:
        number = float(text)
    except ValueError:
        return text
    return "" if isnan(number) else repr(number)
