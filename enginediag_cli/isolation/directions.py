"""Faults of a catalogue as directions in the space of monitored parameters, each with a cone of like ratios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.faults.component_faults import FaultSet


@dataclass(frozen=True)
class NamedFault:
    """A fault of the catalogue that the data could show.

    `generators` (q, p): changes in parameter units that span its cone; with weights w ≥ 0 the change is
    Σ w_i generator_i at the severity Σ w_i, and equal weights give the catalogue's own direction. `one_sided`:
    its severity cannot be negative.
    """

    name: str
    generators: np.ndarray
    one_sided: bool

    @property
    def own(self) -> np.ndarray:
        """The catalogue's direction (p,): changes at severity 1."""
        return np.asarray(self.generators.mean(axis=0))


def named_faults(
    catalogue: FaultSet, parameters: Sequence[str], theta0: np.ndarray, *, ratio_spread: float = 1.7
) -> tuple[tuple[NamedFault, ...], dict[str, str]]:
    """Faults of the catalogue as directions over monitored `parameters`, and those that cannot be, with reasons.

    theta0 (p,): nominal values; changes are relative to them where they are not 0. ratio_spread ≥ 1: ratios of
    the changes lie within this factor of the catalogue's.
    """
    if ratio_spread < 1:
        raise ValueError("`ratio_spread` must be at least 1")
    position = {name: i for i, name in enumerate(parameters)}
    found: list[NamedFault] = []
    untestable: dict[str, str] = {}
    for fault in catalogue.components:
        if any(fault.name == other.name for other in found):
            continue  # the same fault, described in another file as a part of something
        missing = [name for name in fault.changes if name not in position]
        if missing:
            untestable[fault.name] = f"{', '.join(missing)} not monitored"
            continue
        own = np.zeros(len(parameters))
        for name, change in fault.changes.items():
            own[position[name]] = fault.severity * change * (theta0[position[name]] or 1.0)
        found.append(NamedFault(fault.name, _cone(own, ratio_spread), True))
    for sensor in catalogue.sensors:
        if any(sensor.name == other.name for other in found):
            continue
        kind, size = sensor.effect["type"], sensor.effect.get("size", sensor.effect.get("change", 0.0))
        possible = [f"sensor.{quantity}.{kind}" for quantity in _quantities(sensor.column)]
        name = next((candidate for candidate in possible if candidate in position), possible[-1])
        if kind not in ("bias", "scale"):
            untestable[sensor.name] = f"a reading that is {kind} is no change of a parameter"
        elif name not in position or not size:
            untestable[sensor.name] = f"{name} not monitored"
        else:
            own = np.zeros(len(parameters))
            own[position[name]] = size
            found.append(NamedFault(sensor.name, own[None], False))
    return tuple(found), untestable


def _quantities(column: str) -> list[str]:
    """What a column may be of, its unit cut off bit by bit: `Wf_kg_s` → Wf_kg_s, Wf_kg, Wf."""
    parts = column.split("_")
    return ["_".join(parts[:k]) for k in range(len(parts), 0, -1)]


def _cone(own: np.ndarray, spread: float) -> np.ndarray:
    """Generators (q, p) of the cone about `own` (p,): one of its q changes large against the others each.

    With two changes, ratios within the factor `spread` of the catalogue's.
    """
    at = np.flatnonzero(own)
    q = len(at)
    if q < 2 or spread == 1:
        return own[None]
    factors = np.where(np.eye(q, dtype=bool), spread**0.5, spread**-0.5)
    generators = np.tile(own, (q, 1))
    generators[:, at] *= factors / factors.mean(axis=0)
    return generators
