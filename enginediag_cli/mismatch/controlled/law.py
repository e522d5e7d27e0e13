"""A control law as a model may lack it, and the engine file that has it.

A law is tried as it will stand in the file: its text is put into the engine file's, and an engine is built from that.
What is fitted is then what is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.config.document import Node, appended, dump, insert_item, insert_key, parse_document
from enginediag_cli.engine.components.base import Actuator
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription

DIGITS = 7
"""Significant digits of set points and stops."""


@dataclass(frozen=True)
class Enabled:
    """A control acts while `column` is `side` ("at_most", "at_least") of `value`; `wrong`: share of the records of
    which that tells otherwise than their readings; within `margin` of the value nothing is told. `rest_sigma`: by how
    much the actuator wanders about its rest while released, in its unit, 0 where that is not known."""

    column: str
    side: str
    value: float
    wrong: float = 0.0
    margin: float = 0.0
    rest_sigma: float = 0.0

    def decided(self, x: np.ndarray) -> np.ndarray:
        """Values of the column (N,) that tell whether it acts."""
        return np.asarray(np.abs(x - self.value) >= self.margin)

    def released(self, x: np.ndarray) -> np.ndarray:
        """Where it does not act, by values of the column (N,)."""
        return np.asarray(x > self.value if self.side == "at_most" else x < self.value)


@dataclass(frozen=True)
class ControlLaw:
    """`actuator` of `component` holds the reading `hold` at `set_point` between `low` and `high`, in its unit, while
    `enabled` (None: always). `key`: what the component's entry must say before it has the actuator; `assumed`: what of
    that readings do not tell."""

    actuator: Actuator
    component: str
    hold: str
    set_point: float
    low: float
    high: float
    enabled: Enabled | None = None
    key: str = ""
    assumed: str = ""

    @property
    def name(self) -> str:
        """Of the control in the file, and the first part of its parameters' names."""
        return f"{self.component}_control"

    @property
    def label(self) -> str:
        """How answers call it."""
        return f"{self.actuator.name} holds {self.hold}"

    @property
    def parameters(self) -> tuple[str, ...]:
        """What of it is identified: the stops that are not where nothing sets the actuator. The set point is what the
        reading stands at: an offset of that instrument would be taken for it."""
        return tuple(self._named.values())

    @property
    def stops(self) -> dict[str, str]:
        """Name of the limit that acts there, by the stop's key."""
        return {q: f"{self.name}.{q}" for q in ("low", "high")}

    @property
    def _named(self) -> dict[str, str]:
        return {q: n for q, n in self.stops.items() if getattr(self, q) != self.actuator.neutral}

    def fitted(self, values: Mapping[str, float]) -> ControlLaw:
        """The same law with its numbers among these parameters' values."""
        found = {q: values.get(n, getattr(self, q)) for q, n in self._named.items()}
        return replace(self, **found)

    def errors(self, values: Mapping[str, float]) -> dict[str, float]:
        """What of these, by parameter, belongs to the keys of the entry."""
        return {q: values[n] for q, n in self._named.items() if n in values}

    def entry(self, source: str = "", errors: Mapping[str, float] | None = None) -> list[str]:
        """Lines of the item under `controls:`, indented by two."""
        block: dict[str, Any] = {"name": self.name, "actuator": self.actuator.name, "hold": self.hold}
        block |= {k: float(f"{getattr(self, k):.{DIGITS}g}") for k in ("set_point", "low", "high")}
        if self.enabled is not None:
            e = self.enabled
            block["acts_while"] = {"column": e.column, "side": e.side, "value": float(f"{e.value:.{DIGITS}g}")}
            told = {k: float(f"{v:.4g}") for k, v in (("margin", e.margin), ("rest_sigma", e.rest_sigma)) if v > 0.0}
            block["acts_while"] |= told
        if errors:
            block["standard_errors"] = {k: float(f"{v:.3g}") for k, v in errors.items()}
        if source:
            block["source"] = source
        text = dump(block, width=100).splitlines()
        return [("  - " if k == 0 else "    ") + line for k, line in enumerate(text)]

    def written(self, text: str, file: str, source: str = "", errors: Mapping[str, float] | None = None) -> str:
        """The engine file's text with the law, its actuator, and its numbers among what `identify` estimates where the
        file lists that. Raises ConfigError, DataError for text that cannot be edited."""
        text = text.removeprefix("\ufeff").replace("\r\n", "\n")
        if self.key:
            text = insert_key(text, self._component(parse_document(text, file)), "name", self.key)
        for name in self.parameters:
            block = parse_document(text, file).value.get("identification")
            listed = block.value.get("parameters") if block is not None and block.is_mapping else None
            if listed is not None and listed.is_list and listed.value:
                text = insert_item(text, listed, name)
        return appended(text, file, "controls", [self.entry(source, errors)])

    def engine(self, described: EngineDescription, power_setting: str) -> Engine:
        """The engine with the law. Raises ConfigError where it cannot be held."""
        from enginediag_cli.physics.engine_file import load_engine

        text = self.written(described.text, described.file)
        return load_engine(EngineDescription(described.file, text, described.tables), power_setting)

    def _component(self, root: Node) -> Node:
        components = root.value["components"].value
        return next(c for c in components if c.value["name"].value == self.component)
