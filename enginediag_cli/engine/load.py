"""Engine file → Engine, with every problem of the file reported at its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.document import parse_document
from enginediag_cli.config.hints import near
from enginediag_cli.config.kinds import check_document, load_checked
from enginediag_cli.config.reading import file_inside
from enginediag_cli.engine.closure import missing_closure
from enginediag_cli.engine.components import COMPONENTS, Component
from enginediag_cli.engine.controls.build import controls_of
from enginediag_cli.engine.demand import Demand
from enginediag_cli.engine.description import EngineDescription
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.gas import gas_for
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.sizing import size
from enginediag_cli.engine.term import Effect
from enginediag_cli.engine.wiring import wiring_problems
from enginediag_cli.errors import ConfigError, Problem

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
        gas_for(values["fuel_hydrogen_carbon_ratio"]),
        components,
        values["shafts"],
        values["power_setting"],
        values["design"],
        values["start"],
        controls_of(values, components, checked),
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
    engine = engine.with_effects(effects)
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
