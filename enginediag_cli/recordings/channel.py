"""One column of a recorder: where it comes from, its unit, and what it becomes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.config.checked import Checked
from enginediag_cli.errors import Problem
from enginediag_cli.recordings.fill import Fill
from enginediag_cli.units import UnitError, convert, find_unit, split_column, split_header, to_si


@dataclass(frozen=True)
class Channel:
    """target = convert(scale · source + offset, unit → unit of the target), or full_scale · source / 100, or density
    (kg/m³) times a volume flow."""

    target: str
    source: str
    unit: str
    target_unit: str
    full_scale: float | None
    scale: float
    offset: float
    limits: tuple[float, float] | None
    density_kg_m3: float | None = None
    fill: Fill | None = None

    def read(self, values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
        """Target (N,) from the source's values (N,); full_scale replaces the channel's own."""
        reading = self.scale * values + self.offset
        full = self.full_scale if full_scale is None else full_scale
        if full is not None:
            return to_si(reading, self.unit, full)
        if self.density_kg_m3 is not None:
            return to_si(reading, self.unit) * self.density_kg_m3
        return convert(reading, self.unit, self.target_unit)

    def source_of(self, engine: Mapping[str, Any]) -> str:
        """The source column for an engine of the file."""
        return self.source.replace("{prefix}", engine["prefix"])


def load_channel(checked: Checked, target: str, problems: list[Problem]) -> Channel | None:
    """The channel that a checked recorder file declares for a target; what is wrong with it goes to `problems`."""
    spec = checked.values["columns"][target]
    here = ("columns", target)
    target_unit = split_column(target)[1] or "1"
    unit = spec["unit"] or split_header(spec["from"])[1] or ("1" if target_unit == "1" else "")
    if not unit:
        problems.append(
            checked.problem(
                (*here, "from"), f"the unit of {spec['from']} is not known", "its name has no unit; add 'unit:'"
            )
        )
        return None
    try:
        known = find_unit(target_unit)
        if known.si != known.name and target_unit != "1":
            problems.append(
                checked.problem(
                    here, f"the target {target} is not in SI", f"name it {split_column(target)[0]}_{known.si}"
                )
            )
        if spec["full_scale"] is not None:
            to_si(1.0, unit, spec["full_scale"])
        elif _volume_as_mass(checked, target, unit, problems):
            to_si(1.0, unit)
        elif not _full_scale_per_engine(checked.values, target):
            convert(1.0, unit, target_unit)
    except UnitError as error:
        problems.append(checked.problem((*here, "unit" if spec["unit"] else "from"), str(error)))
        return None
    limits = spec["limits"]
    return Channel(
        target,
        spec["from"],
        unit,
        target_unit,
        spec["full_scale"],
        spec["scale"],
        spec["offset"],
        None if limits is None else (limits[0], limits[1]),
        spec["density_kg_m3"],
        _fill(checked, target, problems),
    )


def _volume_as_mass(checked: Checked, target: str, unit: str, problems: list[Problem]) -> bool:
    """Whether the column turns a volume flow into a mass flow, or says so where it cannot."""
    density = checked.values["columns"][target]["density_kg_m3"]
    volume = find_unit(unit).dimension == "volume flow"
    mass = find_unit(split_column(target)[1] or "1").dimension == "mass flow"
    if volume and mass and density is None:
        problems.append(
            checked.problem(
                ("columns", target),
                f"{unit} is a volume flow and {target} a mass flow",
                "add density_kg_m3:, of jet fuel about 800, at the temperature of the flow meter",
            )
        )
    elif density is not None and not (volume and mass):
        problems.append(
            checked.problem(
                ("columns", target, "density_kg_m3"), "a density turns a volume flow into a mass flow; this is none"
            )
        )
    return volume and mass


def _fill(checked: Checked, target: str, problems: list[Problem]) -> Fill | None:
    spec = checked.values["columns"][target]
    method, records = spec["fill"], spec["fill_records"]
    if (method == "none") != (records == 0):
        problems.append(
            checked.problem(
                ("columns", target, "fill_records" if method == "none" else "fill"),
                "'fill' and 'fill_records' belong together",
                "such as fill: hold, fill_records: 10",
            )
        )
    return Fill(method, records) if method != "none" and records else None


def _full_scale_per_engine(values: Mapping[str, Any], target: str) -> bool:
    engines = values["engines"].values()
    return bool(engines) and all(target in engine["full_scale"] for engine in engines)
