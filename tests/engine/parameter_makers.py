"""Parameters with their meaning, for tests that name some without an engine."""

from __future__ import annotations

from collections.abc import Iterable

from enginediag_cli.parameters import Parameter, spelled

INFINITY = float("inf")


def described(name: str, unit: str = "") -> Parameter:
    """The parameter of a name that is spelt as engines spell theirs: `hpc.efficiency`, `sensor.T3.bias`."""
    first, *rest = name.split(".")
    bounds = (0.0, -INFINITY, INFINITY, 1.0)
    if first == "sensor":
        error = {"bias": "sensor bias", "scale": "sensor scale factor"}.get(rest[1], rest[1])
        words = f"{rest[0]} {error}"
        return Parameter(name, "sensor", *bounds, unit, "", f"sensor.{rest[0]}", rest[1], words, f"{rest[0]} sensor")
    quantity = ".".join(rest)
    told = "isentropic efficiency" if quantity == "efficiency" else spelled(quantity)
    part, wear = spelled(first), -1 if quantity == "efficiency" else 0
    return Parameter(name, "health", *bounds, unit or "1", "", first, quantity, f"{part} {told}", part, wear)


def meaning_of(names: Iterable[str]) -> dict[str, Parameter]:
    """Parameters by name."""
    return {name: described(name) for name in names}
