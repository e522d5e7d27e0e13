"""Checks of an engine file that need more than one key: stations, shafts, bleeds, power setting.

Checks of an engine file about what its shafts drive: loads, propellers and gearboxes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from enginediag_cli.config.hints import near
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.control_section import lever
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


RECEIVERS = ("receives", "cooling_before_rotor", "cooling_after_rotor")


def wiring_problems(values: Mapping[str, Any], checked: Checked) -> list[Problem]:
    """Everything about the network that is wrong, before it is built."""
    parts = (_stations, _bleeds, _exchangers, _shafts, _gearboxes, driving_problems, _whole)
    return [problem for part in parts for problem in part(values, checked)]


def inlets(component: Mapping[str, Any]) -> list[str]:
    """Keys that name the stations at which a component begins."""
    if component["type"] == "mixer":
        return ["core", "bypass"]
    return ["from"] if "from" in component else []


def outlets(component: Mapping[str, Any]) -> list[str]:
    """Stations that a component delivers."""
    keys = ["core", "bypass"] if component["type"] == "splitter" else ["to"]
    return [str(component[k]) for k in keys if k in component]


def _stations(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """Every station is delivered once, before the one component that begins at it."""
    delivered: list[str] = []
    taken: dict[str, str] = {}
    for k, c in enumerate(values["components"]):
        for key in inlets(c):
            place, station = checked.mark(("components", k, key)), c[key]
            if station not in delivered:
                yield Problem(
                    place, f"{c['name']}: no component before it delivers station '{station}'", near(station, delivered)
                )
            elif station in taken:
                yield Problem(
                    place,
                    f"{c['name']}: station '{station}' already is the inlet of {taken[station]}",
                    "use a splitter or a bleed to divide a flow",
                )
            taken[station] = c["name"]
        for station in outlets(c):
            if station in delivered:
                yield Problem(checked.mark(("components", k)), f"{c['name']}: station '{station}' is delivered already")
            delivered.append(station)


def _gearboxes(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """A gearbox stands behind all that the shaft takes which it drives, and before the turbine that it is driven by,
    whose work is what is taken from it until then."""
    components = values["components"]
    for k, gearbox in enumerate(components):
        if gearbox["type"] != "gearbox":
            continue
        mark = checked.mark(("components", k))
        early = [c["name"] for c in components[:k] if c["type"] == "turbine" and c.get("shaft") == gearbox["shaft"]]
        late = [c["name"] for c in components[k + 1 :] if c.get("shaft") == gearbox["drives"]]
        if early:
            what = f"gearbox '{gearbox['name']}' must stand before turbine '{early[0]}', which drives it"
            yield Problem(mark, what, f"move it in the list of components before '{early[0]}'")
        if late:
            what = f"gearbox '{gearbox['name']}' must stand behind '{late[-1]}' of shaft '{gearbox['drives']}'"
            yield Problem(mark, what, f"move it in the list of components behind '{late[-1]}'")


def _bleeds(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """A bleed has one name, is taken before it is received, and received at most once."""
    bleeds: list[str] = []
    received: dict[str, str] = {}
    for k, c in enumerate(values["components"]):
        for key in RECEIVERS:
            for i, bleed in enumerate(c.get(key, ())):
                place = checked.mark(("components", k, key, i))
                if bleed not in bleeds:
                    yield Problem(place, f"{c['name']}: there is no bleed '{bleed}' before it", near(bleed, bleeds))
                elif bleed in received:
                    yield Problem(place, f"{c['name']}: bleed '{bleed}' is received already by {received[bleed]}")
                received[bleed] = c["name"]
        for port in c.get("ports", ()):
            if port["name"] in bleeds:
                yield Problem(
                    checked.mark(("components", k, "ports")), f"{c['name']}: bleed '{port['name']}' exists already"
                )
            bleeds.append(port["name"])


def _exchangers(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """A recuperator has one hot side, which comes behind it."""
    cold: dict[str, int] = {}
    hot: dict[str, str] = {}
    for k, c in enumerate(values["components"]):
        if c["type"] == "recuperator":
            cold[c["name"]] = k
        if c["type"] != "recuperator_hot":
            continue
        place, of = checked.mark(("components", k, "recuperator")), c["recuperator"]
        if of not in cold:
            yield Problem(place, f"{c['name']}: there is no recuperator '{of}' before it", near(of, list(cold)))
        elif of in hot:
            yield Problem(place, f"{c['name']}: recuperator '{of}' has a hot side already, {hot[of]}")
        hot[of] = c["name"]
    for name, k in cold.items():
        if name not in hot:
            yield Problem(
                checked.mark(("components", k)),
                f"{name}: nothing heats it",
                "give it a component of type recuperator_hot behind a turbine",
            )


def _shafts(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """Components name shafts that exist; a shaft has a turbine or a gearbox that drives it."""
    shafts = [s["name"] for s in values["shafts"]]
    driven: set[str] = set()
    for k, c in enumerate(values["components"]):
        for key in ("shaft", "drives"):
            if key in c and c[key] not in shafts:
                place = checked.mark(("components", k, key))
                yield Problem(place, f"{c['name']}: there is no shaft '{c[key]}'", near(c[key], shafts))
        if c["type"] in ("turbine", "gearbox"):
            driven.add(c["drives" if c["type"] == "gearbox" else "shaft"])
    for name in shafts:
        if name not in driven:
            yield Problem(checked.mark(("shafts", name)), f"shaft '{name}' has no turbine")


def _whole(values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """One of each of the parts that no engine lacks, and a power setting that this engine can have."""
    types = [c["type"] for c in values["components"]]
    for needed in ("ambient", "inlet", "burner"):
        if types.count(needed) != 1:
            yield Problem(
                checked.mark(("components",)),
                f"an engine needs exactly one {needed}, this one has {types.count(needed)}",
                "a second burner is an afterburner" if needed == "burner" and types.count(needed) > 1 else "",
            )
    for k, c in enumerate(values["components"]):
        if c["type"] == "afterburner" and "burner" not in types[:k]:
            yield Problem(checked.mark(("components", k)), f"{c['name']}: an afterburner comes behind the burner")
    known = power_settings(values)
    known = [*known, lever(values)] if lever(values) else list(known)
    if values["power_setting"] not in known:
        yield Problem(
            checked.mark(("power_setting",)),
            f"'{values['power_setting']}' cannot be the power setting",
            near(values["power_setting"], known),
        )


def power_settings(values: Mapping[str, Any]) -> list[str]:
    """Columns that may set the power of this engine: fuel flow, the speeds that follow from a balance, the total
    temperature of any station that burnt gas reaches, engine pressure ratio, thrust, and power and torque of what its
    shafts drive."""
    components = values["components"]
    types = {c["type"] for c in components}
    found = ["Wf_kg_s", *(f"{s['speed_label']}_rpm" for s in values["shafts"] if s["speed"] == "balance")]
    found += hot_columns(components)
    # behind a turbine that discharges through a stack, pressure tells nearly nothing of the power
    found += ["EPR"] if types & {"nozzle", "condi_nozzle"} else []
    found += ["Fn_N"] if types & {"nozzle", "condi_nozzle", "propeller"} else []
    # what is demanded of a machine cannot be wanted once more
    machines = [c["name"] for c in components if c["type"] in ("load", "propeller") and c.get("law") != "given"]
    found += ["power_W"] if machines else []
    machines += [c["name"] for c in components if c["type"] == "gearbox"]
    return [*found, *(f"{name}_{column}" for name in machines for column in ("power_W", "torque_N_m"))]


def hot_columns(components: Sequence[Mapping[str, Any]]) -> list[str]:
    """Columns of the total temperature of stations that gas from a burner reaches, in the order of the gas path."""
    return [f"T{station}_K" for station in _hot_stations(components)]


def _hot_stations(components: Sequence[Mapping[str, Any]]) -> list[str]:
    """Stations that gas from a burner reaches, those between vanes and rotor of a turbine among them."""
    hot: list[str] = []
    for c in components:
        if c["type"] == "burner" or any(c[key] in hot for key in inlets(c)):
            inside = c.get("rotor_inlet_station")
            hot += [*([inside] if inside else []), *outlets(c)]
    return hot
