"""Engine file → `Engine`, with every problem of the file reported at its place.

`build_engine` reads the file, checks what needs more than one key (stations, shafts, bleeds, loads, propellers,
gearboxes, power setting), sizes the network at the design point, and adds the effects. Where a design point cannot be
met, or the unknowns are not as many as the balances, the message says what would fix it.

`EngineDescription` is the text of an engine file and of its map tables. With it an engine can be stored inside another
file, or sent to another process, and be built where its own file is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.document import parse_document
from enginediag_cli.config.fields import near
from enginediag_cli.config.files import MOST_TABLE_BYTES, file_inside, read_regular
from enginediag_cli.config.validate import Checked, check_document, load_checked
from enginediag_cli.engine.components import COMPONENTS, Component
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.passages import ColdGasError, Mixer, PressureMismatchError, Splitter
from enginediag_cli.engine.components.shaft_loads import SURPLUS, Propeller
from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.declaration import lever, orient, read_controls
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_FIT, shared_gas
from enginediag_cli.engine.network import Demand, Network
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import ConfigError, Mark, Problem

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
                f"{c['name']}: a machine behind gearbox {geared[shaft]} cannot take the surplus power of its shaft",
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


@dataclass(frozen=True)
class EngineDescription:
    """`text` of the engine file `file`; `tables`: file of a map, as the engine file names it → its text."""

    file: str
    text: str
    tables: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def from_engine_file(path: str | Path, declared: Mapping[str, Any]) -> EngineDescription:
        """The files of an engine that was built from `path` and declares `declared`. Raises ConfigError."""
        names = [c["table"]["file"] for c in declared.get("components", ()) if c.get("table")]
        tables = {name: _text(file_inside(path, name), MOST_TABLE_BYTES) for name in dict.fromkeys(names)}
        return EngineDescription(str(path), _text(path), tables)

    @property
    def sha256(self) -> str:
        """Of the engine file's bytes."""
        import hashlib

        return hashlib.sha256(self.text.encode()).hexdigest()

    def table(self, name: str, mark: Mark) -> str:
        """The text of a map table. Raises ConfigError at `mark` for one that does not travel along."""
        if name not in self.tables:
            raise ConfigError([Problem(mark, f"the map table {name} does not travel with this engine")])
        return self.tables[name]

    def differs(self, path: str | Path) -> bool:
        """Whether the engine file, or a table that it reads, says something else than this. Raises ConfigError for an
        engine file that cannot be read; a table that is not there says nothing."""
        if _text(path) != self.text:
            return True
        for name, text in self.tables.items():
            try:
                other = _text(file_inside(path, name), MOST_TABLE_BYTES)
            except ConfigError:
                continue
            if other != text:
                return True
        return False


def _text(path: str | Path, *most: int) -> str:
    """The text of a file, byte for byte, a byte order mark included. Raises ConfigError."""
    try:
        return read_regular(path, *most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError([Problem(Mark(str(path)), "the file is not UTF-8 text", "save it as UTF-8")]) from error


def missing_closure(network: Network, values: Mapping[str, Any]) -> str:
    """What to change, in words."""
    found = [*_loads(network), *_load_shafts(network), *_ends(values)]
    return "; ".join(found) or "every flow must end in a nozzle, exhaust or mixer, every shaft have one power balance"


def _has_given_speed(network: Network, name: str) -> bool:
    """Whether the speed of a shaft is known from outside, itself or through a gearbox."""
    return any(
        network.shafts[s]["speed"] != "balance" or network.power_setting == f"{network.shafts[s]['speed_label']}_rpm"
        for s in network.coupling.coupled_shafts(name)
    )


def _loads(network: Network) -> Iterator[str]:
    """A load takes the surplus at a speed that is given, or a given law at a speed that follows."""
    for machine in network.coupling.machines:
        shaft, law = machine.values["shaft"], machine.values.get("law")
        given = _has_given_speed(network, shaft)
        balanced = network.coupling.coupled_shafts(shaft)[0] in network.coupling.balanced
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


def _load_shafts(network: Network) -> Iterator[str]:
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


FAN_RATIOS = (1.05, 12.0)
"""Pressure ratios between which that of a fan is sought: from hardly any compression to more than any fan gives."""
BYPASS_RATIOS = (0.02, 20.0)
"""Where a value that lets two flows mix is looked for."""
SIZING_PASSES = 60
"""Of all components, where one assumes what another gives: each gains a digit or more, since a burner's exit
temperature hardly leaves a way back."""
HALVINGS = 40
"""Of that range: far more than the digits that are printed."""


def size(network: Network, values: Mapping[str, Any], checked: Checked) -> None:
    """Runs the components through the design point. Raises ConfigError, with the value that would do where there is
    one."""
    try:
        _run(network, values)
    except PressureMismatchError as error:
        problem = Problem(
            checked.mark(("design",)),
            f"the design point cannot be met: {error}",
            _equal_pressures(network, values, error),
        )
        raise ConfigError([problem]) from error
    except ColdGasError as error:
        problem = Problem(
            checked.mark(("design",)), f"the design point cannot be met: {error}", _warm_enough(network, values)
        )
        raise ConfigError([problem]) from error
    except ValueError as error:
        raise ConfigError([Problem(checked.mark(("design",)), f"the design point cannot be met: {error}")]) from error
    _controls(network, values, checked)


def _controls(network: Network, values: Mapping[str, Any], checked: Checked) -> None:
    """Set points and signs of the controls, at the sized design point."""
    assert network.design_point is not None
    leaves = dict(network.design_point.leaves)
    try:
        orient(network, leaves)
    except ValueError as error:
        raise ConfigError([Problem(checked.mark(("controls",)), str(error))]) from error
    except KeyError as error:
        columns = network.columns(network.design_point)
        problem = Problem(
            checked.mark(("controls",)), f"the model has no column '{error.args[0]}'", near(error.args[0], columns)
        )
        raise ConfigError([problem]) from error


def _run(network: Network, values: Mapping[str, Any]) -> None:
    own = {column: x for c in network.components for column, x in c.design_inputs().items()}
    inputs = {c: np.array([values["design"].get(c, own.get(c, 0.0))]) for c in network.inputs()}
    x: dict[str, Any] = {u.name: np.array([u.start]) for c in network.components for u in c.unknowns()}
    x |= {f"{name}.corrected_speed": np.array([1.0]) for name in network.shafts}
    leaves: dict[str, Any] = {**network.neutral, **{p.name: p.nominal for p in network.parameters()}, **x, **inputs}
    for _ in range(SIZING_PASSES):
        with np.errstate(all="ignore"):
            network.size(Evaluation(network.gas, 1, leaves))
        if all(c.converged() for c in network.components):
            assert network.design_point is not None
            network.coupling.check_design(network.design_point)
            return
    open_still = ", ".join(c.name for c in network.components if not c.converged())
    raise ValueError(f"{open_still}: no temperature behind it agrees with what follows from it")


def _equal_pressures(network: Network, values: Mapping[str, Any], error: PressureMismatchError) -> str:
    """The fan pressure ratio or the bypass ratio with which both flows reach the mixer at one total pressure."""
    mixer = next(c for c in network.components if isinstance(c, Mixer) and c.name == error.mixer)
    splitter = next((c for c in network.components if isinstance(c, Splitter)), None)
    if splitter is None:
        return ""
    fan = _feeding(network, splitter)
    found = []
    searched: list[tuple[Component, str, tuple[float, float]]] = [(fan, "pressure_ratio", FAN_RATIOS)] if fan else []
    searched.append((splitter, "bypass_ratio", BYPASS_RATIOS))
    for component, key, within in searched:

        def surplus(x: float, component: Component = component, key: str = key) -> float:
            return _mixer_pressure_ratio(network, values, mixer, component, key, x) - 1.0

        value = _bisected(surplus, *within)
        if value is not None:
            found.append(f"{component.name}: {key}: {value:.3f}")
    return f"both flows have one total pressure with {' or with '.join(found)}" if found else ""


def _warm_enough(network: Network, values: Mapping[str, Any]) -> str:
    """The burner's exit temperature from which on the gas of a recuperator is warmer than its air."""
    burner = next(c for c in network.components if isinstance(c, Burner))
    kept = burner.values["exit_temperature_K"]

    def surplus(x: float) -> float:
        burner.values["exit_temperature_K"] = x
        try:
            _run(network, values)
        except ColdGasError as error:
            return error.surplus_K
        except ValueError:
            return np.nan
        finally:
            burner.values["exit_temperature_K"] = kept
        return 1.0

    value = _bisected(surplus, kept, T_FIT[1])
    if value is None:
        return "a lower pressure_ratio of the compressors would let it"
    return f"it is as warm with {burner.name}: exit_temperature_K: {value:.0f}, or with less pressure_ratio before it"


def _feeding(network: Network, splitter: Splitter) -> Compressor | None:
    """The compressor nearest before the splitter."""
    before = network.components[: network.components.index(splitter)]
    return next((c for c in reversed(before) if isinstance(c, Compressor)), None)


def _mixer_pressure_ratio(
    network: Network, values: Mapping[str, Any], mixer: Mixer, component: Component, key: str, x: float
) -> float:
    """Bypass over core total pressure at the mixer with another value of one key; NaN where nothing can be sized."""
    kept = component.values[key]
    component.values[key] = x
    try:
        _run(network, values)
        return mixer.design_ratio
    except PressureMismatchError as error:
        return error.ratio
    except ValueError as error:
        # the core has nothing left: its pressure is too low for any mixer behind it
        return np.inf if mixer.name not in str(error) else np.nan
    finally:
        component.values[key] = kept


def _bisected(surplus: Callable[[float], float], low: float, high: float) -> float | None:
    """Where a rising function is zero; None where its ends have one sign."""
    if not (surplus(low) < 0.0 < surplus(high)):
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)


EffectReader = Callable[[Sequence[Mapping[str, Any]], Network, Checked], tuple[list[Effect], list[Problem]]]
"""Entries of a `physics:` block, the sized network and the file → the effects at their sites, and what is wrong."""


def build_engine(
    source: str | Path | EngineDescription, read_effects: EffectReader, power_setting: str | None = None
) -> Engine:
    """Read, check and size an engine. `physics.engine_file.load_engine` is this with the library of effects.

    Parameters
    ----------
    source
        An engine file, or a description of one that has been sent to another process.
    read_effects
        Makes the effects of the `physics:` block.
    power_setting
        Column that sets the power, in the place of the file's.

    Returns
    -------
    Engine
        The sized engine with its effects, at nominal parameters.

    Raises
    ------
    ConfigError
        For anything wrong in the file, with its line and column.
    """
    described = source if isinstance(source, EngineDescription) else None
    path = described.file if described else str(source)
    if described is None:
        checked = load_checked(path, "engine")
    else:
        checked = check_document(parse_document(described.text.removeprefix("\ufeff"), path), "engine")
    values = dict(checked.values)
    if power_setting and power_setting != values["power_setting"]:
        # the file's range and envelope are of its own power setting, or of the set point that asks for it
        own = (values["power_setting"], (values["power_demand"] or {}).get("column"))
        values["envelope"] = {c: r for c, r in values["envelope"].items() if c not in own}
        values["power_setting"], values["power_range"], values["power_demand"] = power_setting, None, None
    _raise_problems(wiring_problems(values, checked))
    network = _sized_network(values, checked, _components(values, checked, path, described))
    engine = Engine(network, values, path)  # gives the network its sensors, which effects may name
    effects, problems = read_effects(values["physics"], network, checked)
    _raise_problems(problems)
    engine = engine.replace_effects(effects)
    _raise_problems(_reference_problems(engine, values, checked))
    return engine


def _raise_problems(problems: Iterable[Problem]) -> None:
    if problems := list(problems):
        raise ConfigError(problems)


def _components(
    values: Mapping[str, Any], checked: Checked, path: str, described: EngineDescription | None
) -> list[Component]:
    """The components of an engine file, with their map tables: from files beside it, or from its description."""
    components: list[Component] = []
    for k, c in enumerate(values["components"]):
        declared: dict[str, Any] = {**c, "directory": str(Path(path).parent)}
        if c.get("table"):
            name, mark = c["table"]["file"], checked.mark(("components", k, "table", "file"))
            if described is None:
                file_inside(path, name, mark)
            else:
                declared["table_text"] = described.table(name, mark)
        try:
            components.append(COMPONENTS[c["type"]](declared))
        except ConfigError:
            raise
        except ValueError as error:
            raise ConfigError([Problem(checked.mark(("components", k)), str(error))]) from error
    return components


def _sized_network(values: dict[str, Any], checked: Checked, components: list[Component]) -> Network:
    """The network of these components at its design point, with its controls and its set point of power."""
    network = Network(
        shared_gas(values["fuel_hydrogen_carbon_ratio"]),
        components,
        values["shafts"],
        values["power_setting"],
        values["design"],
        values["start"],
        read_controls(values, components, checked),
    )
    size(network, values, checked)
    if values["power_demand"] is not None:
        try:
            network.demand = Demand.from_mapping(values["power_demand"], values["power_setting"])
        except ValueError as error:
            raise ConfigError([Problem(checked.mark(("power_demand",)), str(error))]) from error
    return network


def _reference_problems(engine: Engine, values: Mapping[str, Any], checked: Checked) -> Iterator[Problem]:
    """Names of parameters, columns and inputs, and as many balances as unknowns."""
    for k, name in enumerate(values["monitored"]):
        if name not in engine.parameters:
            yield Problem(
                checked.mark(("monitored", k)), f"there is no parameter '{name}'", near(name, list(engine.parameters))
            )
    known = (*engine.inputs, *engine.optional_inputs)
    for column in values["envelope"]:
        if column not in known:
            yield Problem(
                checked.mark(("envelope", column)), f"'{column}' is not an input of this engine", near(column, known)
            )
    names = engine.network.possible_unknowns()
    for name in values["start"]:
        if name not in names:
            yield Problem(
                checked.mark(("start", name)), f"'{name}' is not an unknown of this engine", near(name, names)
            )
    unknowns, balances = [u.name for u in engine.unknowns], list(engine._balance_names)
    if len(unknowns) != len(balances):
        yield Problem(
            checked.mark(("components",)),
            f"{len(unknowns)} unknowns ({', '.join(unknowns)}) but {len(balances)} balances ({', '.join(balances)})",
            missing_closure(engine.network, values),
        )
        return
    for column, sensor in engine.sensors.items():
        for read in (*sensor.reads, *([sensor.denominator] if sensor.denominator else [])):
            if read not in engine.model_columns:
                yield Problem(
                    checked.mark(("sensors", column)),
                    f"the model has no column '{read}'",
                    near(read, engine.model_columns),
                )
