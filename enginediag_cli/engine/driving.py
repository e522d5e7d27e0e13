"""Checks of an engine file about what its shafts drive: loads, propellers and gearboxes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from enginediag_cli.config.checked import Checked
from enginediag_cli.errors import Problem

DRIVEN = ("load", "propeller")
RATIO_DIGITS = 1e-3
"""By how much a stated gear ratio may differ from that of the design speeds, as a share: they are rounded."""


def driving_problems(values: Mapping[str, Any], checked: Checked) -> list[Problem]:
    """Machines in an order and number that can be sized, and gears that fit."""
    return [*_machines(values, checked), *_gears(values, checked)]


def _states_power(c: Mapping[str, Any]) -> bool:
    return bool(c["design_power_W"] is not None or c.get("speeds_rpm"))


def _machines(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """A machine that takes what a shaft has to spare comes behind its turbines, once."""
    turned: set[str] = set()
    takers: dict[str, str] = {}
    geared = {c["drives"]: c["name"] for c in values["components"] if c["type"] == "gearbox"}
    for k, c in enumerate(values["components"]):
        shaft, place = c.get("shaft"), checked.mark(("components", k, "shaft"))
        if c["type"] == "turbine":
            turned.add(shaft)
        if c["type"] not in DRIVEN:
            continue
        takes_rest = not _states_power(c)
        if shaft in takers and (takes_rest or c.get("law") == "surplus"):
            yield Problem(
                place,
                f"{c['name']}: shaft '{shaft}' drives {takers[shaft]} already, which takes what it has",
                "give all but the last of them a design_power_W and a law of their own (cube, torque, given), or state "
                "what the smaller one takes as the shaft's power_offtake_W",
            )
        elif shaft in takers and any(
            x["name"] == takers[shaft] and x.get("law") == "surplus" for x in values["components"]
        ):
            yield Problem(
                place, f"{c['name']}: stands behind {takers[shaft]}, which takes all that '{shaft}' has to spare"
            )
        elif takes_rest and shaft in geared:
            yield Problem(
                place,
                f"{c['name']}: a machine behind gearbox {geared[shaft]} cannot take what is left",
                "state its design_power_W, with a law of its own (cube, torque, given)",
            )
        elif takes_rest and shaft not in turned:
            yield Problem(
                place,
                f"{c['name']}: a load comes behind the turbine that drives its shaft",
                "one that states its design_power_W may stand before it, whose pressure_ratio then follows",
            )
        if takes_rest:
            takers[shaft] = c["name"]


def _gears(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """A gearbox drives another shaft, once, at the ratio of the design speeds, behind all that this one drives."""
    speeds = {s["name"]: s for s in values["shafts"]}
    driving: dict[str, str] = {}
    behind: dict[str, str] = {}
    turned: set[str] = set()
    for k, c in enumerate(values["components"]):
        place = checked.mark(("components", k))
        if c.get("shaft") in behind:
            yield Problem(
                place,
                f"{c['name']}: is on shaft '{c['shaft']}', which gearbox {behind[c['shaft']]} before it drives",
                "a gearbox stands behind all that is on the shaft that it drives, and turbines are on the other one",
            )
        if c["type"] == "turbine":
            turned.add(c["shaft"])
        if c["type"] != "gearbox" or not {c["shaft"], c["drives"]} <= set(speeds):
            continue
        one, other = speeds[c["shaft"]], speeds[c["drives"]]
        if c["drives"] in driving or c["drives"] == c["shaft"] or c["drives"] in turned:
            told = f"{c['name']}: shaft '{c['drives']}' has a turbine, drives this gearbox, or is driven already"
            yield Problem(place, told, "a gearbox drives a shaft that nothing else drives")
            continue
        ratio = one["design_speed_rpm"] / other["design_speed_rpm"]
        if c["ratio"] is not None and abs(c["ratio"] / ratio - 1.0) > RATIO_DIGITS:
            yield Problem(
                place,
                f"{c['name']}: a ratio of {c['ratio']:g} does not agree with the design speeds, which give {ratio:.5g}",
                f"shaft '{c['drives']}': design_speed_rpm: {one['design_speed_rpm'] / c['ratio']:.6g}",
            )
        driving[c["drives"]] = c["shaft"]
        behind[c["drives"]] = c["name"]
    for name in driving:
        last = name
        while last in driving:
            last = driving[last]
        given = [s for s in speeds if speeds[s]["speed"] != "balance" and s in (name, last)]
        if len(given) > 1:
            told = f"shafts {' and '.join(given)} turn together, and both have a speed given"
            yield Problem(checked.mark(("shafts", name)), told, "one of them follows: 'speed: balance'")
