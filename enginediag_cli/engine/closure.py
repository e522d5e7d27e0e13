"""Why an engine has more unknowns than balances, or fewer: from what is there, not from a list of what may be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from enginediag_cli.engine.components.load import SURPLUS
from enginediag_cli.engine.components.propeller import Propeller
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.wiring import inlets, outlets


def missing_closure(network: Network, values: Mapping[str, Any]) -> str:
    """What to change, in words."""
    found = [*_loads(network), *_shafts(network), *_ends(values)]
    return "; ".join(found) or "every flow must end in a nozzle, exhaust or mixer, every shaft have one power balance"


def _given(network: Network, name: str) -> bool:
    """Whether the speed of a shaft is known from outside, itself or through a gearbox."""
    return any(
        network.shafts[s]["speed"] != "balance" or network.power_setting == f"{network.shafts[s]['speed_label']}_rpm"
        for s in network.coupling.turning_with(name)
    )


def _loads(network: Network) -> Iterator[str]:
    """A load takes what is left at a speed that is given, or a given law at a speed that follows."""
    for machine in network.coupling.machines:
        shaft, law = machine.values["shaft"], machine.values.get("law")
        given = _given(network, shaft)
        balanced = network.coupling.turning_with(shaft)[0] in network.coupling.balanced
        if law == SURPLUS and not given:
            yield (
                f"{machine.name} takes what shaft '{shaft}' has to spare, which leaves its speed open: give "
                f"the shaft 'speed: constant' (a generator on the grid) or 'speed: input' (a recorded column), or the "
                "load 'law: cube'"
            )
        elif law != SURPLUS and given and balanced:
            cure = "a pitch that a control moves" if isinstance(machine, Propeller) else "'law: surplus'"
            yield (
                f"{machine.name} takes power by a law, from which the speed of shaft '{shaft}' follows, but that is "
                f"given: take {cure}, or 'speed: balance'"
            )


def _shafts(network: Network) -> Iterator[str]:
    for name in network.coupling.balanced:
        if name not in network.loaded_shafts and network.shafts[name]["speed"] != "balance":
            yield (
                f"the speed of shaft '{name}' is given, but nothing takes what its turbine has to spare: give it a "
                "load, or 'speed: balance'"
            )


def _ends(values: Mapping[str, Any]) -> Iterator[str]:
    taken = {c[key] for c in values["components"] for key in inlets(c)}
    for c in values["components"]:
        for station in outlets(c):
            if station not in taken:
                yield (
                    f"the flow at station '{station}' behind {c['name']} goes nowhere: a nozzle, exhaust or mixer must "
                    "take it"
                )
