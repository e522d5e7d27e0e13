"""Engine file → Engine, with every problem of the file reported at its place.

Why an engine has more unknowns than balances, or fewer: from what is there, not from a list of what may be.

Sizing at the design point, and what would cure a design point that cannot be met.

An engine's description as text: the engine file and the map tables that it reads, so that an engine can travel
inside another file and be built where its own file is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.document import parse_document
from enginediag_cli.config.hints import near
from enginediag_cli.config.kinds import check_document, load_checked
from enginediag_cli.config.reading import MOST_TABLE_BYTES, file_inside, read_regular
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.components import COMPONENTS, Component
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.heat_exchangers import ColdGasError
from enginediag_cli.engine.components.passages import Mixer, PressureMismatchError, Splitter
from enginediag_cli.engine.components.shaft_loads import SURPLUS, Propeller
from enginediag_cli.engine.control_section import orient, read_controls
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.gas import T_FIT, shared_gas
from enginediag_cli.engine.network import Demand, Network
from enginediag_cli.engine.term import Effect
from enginediag_cli.engine.wiring import inlets, outlets, wiring_problems
from enginediag_cli.errors import ConfigError, Mark, Problem


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
    found = [*_loads(network), *_shafts(network), *_ends(values)]
    return "; ".join(found) or "every flow must end in a nozzle, exhaust or mixer, every shaft have one power balance"


def _has_given_speed(network: Network, name: str) -> bool:
    """Whether the speed of a shaft is known from outside, itself or through a gearbox."""
    return any(
        network.shafts[s]["speed"] != "balance" or network.power_setting == f"{network.shafts[s]['speed_label']}_rpm"
        for s in network.coupling.coupled_shafts(name)
    )


def _loads(network: Network) -> Iterator[str]:
    """A load takes what is left at a speed that is given, or a given law at a speed that follows."""
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


FAN_RATIOS = (1.05, 12.0)
"""Pressure ratios between which that of a fan is sought: from hardly any compression to more than any fan gives."""
BYPASS_RATIOS = (0.02, 20.0)
"""Where a value that lets two flows mix is looked for."""
SIZING_PASSES = 60
"""Of all components, where one assumes what another gives: each gains a digit or more, since a burner's exit
temperature hardly leaves a way back."""
HALVINGS = 40
"""Of that range: far more than the digits that are told."""


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


Carried = Callable[[Sequence[Mapping[str, Any]], Network, Checked], tuple[list[Effect], list[Problem]]]
"""Entries of a `physics:` block, the sized network and the file → the effects at their sites, and what is wrong."""


def build_engine(source: str | Path | EngineDescription, carried: Carried, power_setting: str | None = None) -> Engine:
    """Reads, checks and sizes an engine, from its file or from a description that travels; `power_setting` replaces
    the file's, `carried` knows the effects that the file may name. Raises ConfigError, at places in the description's
    own text. `physics.engine_file.load_engine` is this with the library of effects."""
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
    problems = wiring_problems(values, checked)
    if problems:
        raise ConfigError(problems)
    components: list[Component] = []
    for k, c in enumerate(values["components"]):
        about: dict[str, Any] = {**c, "directory": str(Path(path).parent)}
        if c.get("table"):
            name, mark = c["table"]["file"], checked.mark(("components", k, "table", "file"))
            if described is None:
                file_inside(path, name, mark)
            else:
                about["table_text"] = described.table(name, mark)
        try:
            components.append(COMPONENTS[c["type"]](about))
        except ConfigError:
            raise
        except ValueError as error:
            raise ConfigError([Problem(checked.mark(("components", k)), str(error))]) from error
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
            network.demand = Demand.declared(values["power_demand"], values["power_setting"])
        except ValueError as error:
            raise ConfigError([Problem(checked.mark(("power_demand",)), str(error))]) from error
    engine = Engine(network, values, path)
    effects, problems = carried(values["physics"], network, checked)
    if problems:
        raise ConfigError(problems)
    engine = engine.replace_effects(effects)
    problems = list(_references(engine, values, checked))
    if problems:
        raise ConfigError(problems)
    return engine


def _references(engine: Engine, values: dict[str, Any], checked: Any) -> Any:
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
        for read in (*sensor.reads, *([sensor.over] if sensor.over else [])):
            if read not in engine.model_columns:
                yield Problem(
                    checked.mark(("sensors", column)),
                    f"the model has no column '{read}'",
                    near(read, engine.model_columns),
                )
