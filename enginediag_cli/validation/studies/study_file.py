"""Declaration of the YAML file that describes a study, and what becomes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.config.reading import named_file
from enginediag_cli.errors import ConfigError, DataError, Problem
from enginediag_cli.methods.registry import SECTIONS, chosen_method
from enginediag_cli.simulation.flights import MISSIONS
from enginediag_cli.simulation.noise import NOISE
from enginediag_cli.validation.studies.cases import CASE, FaultCase, build_case

if TYPE_CHECKING:
    from enginediag_cli.methods.base import Method
    from enginediag_cli.residuals.monitor import Monitor
    from enginediag_cli.simulation.noise import ColumnNoise

STUDY_FILE = Section(
    "study",
    "a Monte-Carlo study of diagnosis",
    (
        Field("kind", "choice", "kind of file", "study", choices=("study",)),
        Field("description", "text", "what the study is to show", ""),
        Field("source", "text", "where cases and numbers come from", ""),
        Field("engine", "text", "engine file, relative to this file; or one that comes with the program"),
        Field(
            "monitor",
            "texts",
            "parameters that may have changed, names or patterns such as 'sensor.*.bias'; those "
            "that the engine file monitors where absent",
            (),
        ),
        Field("records", "integer", "records of one diagnosis", minimum=1),
        Field(
            "mission",
            "section",
            "operating conditions, drawn anew for every diagnosis",
            section=Variants("mission", "kind of mission", {name: m.SECTION for name, m in MISSIONS.items()}),
        ),
        Field("constants", "number_map", "further inputs of the engine, each held at one value", {}),
        Field("noise", "section", "sensor noise; its size is known to the methods", {}, section=NOISE),
        Field("cases", "named_sections", "what is wrong with the engine", section=CASE),
        Field("methods", "named_sections", "who diagnoses", section=Variants("method", "kind of method", SECTIONS)),
        Field(
            "false_alarm",
            "number",
            "false-alarm probability of detection, and level of rejection tests",
            0.01,
            minimum=1e-6,
            maximum=0.5,
        ),
        Field("reliability", "boolean", "ask how often answers of a stated probability are right", False),
        Field("seed", "integer", "seed of everything random", 0, minimum=0),
    ),
)


@dataclass(frozen=True)
class Study:
    """A study ready to run. `missions` are the values of the section; `methods` by the names that the study gives."""

    path: Path
    monitor: Monitor
    records: int
    plan: Mapping[str, Any]
    noise: Mapping[str, ColumnNoise]
    cases: tuple[FaultCase, ...]
    methods: Mapping[str, Method]
    false_alarm: float
    reliability: bool
    seed: int


def load_study(path: str | Path) -> Study:
    """Read a study and its engine; raises ConfigError with every problem that can be seen before it runs."""
    from enginediag_cli.physics.engine_file import load_engine
    from enginediag_cli.simulation.noise import column_noise
    from enginediag_cli.validation.studies.known import known_nominal

    checked = load_checked(path, "study")
    values = checked.values
    engine = load_engine(named_file(Path(path), values["engine"], "engine file", checked.mark(("engine",))))
    noise = column_noise(values["noise"], engine, checked.mark(("noise",)))
    try:
        monitor = known_nominal(engine, values["monitor"], noise)
    except DataError as error:
        raise ConfigError([Problem(checked.mark(("monitor",)), str(error))]) from None
    problems = [
        checked.problem((key,), f"there are no {key}; one is needed") for key in ("cases", "methods") if not values[key]
    ]
    cases = []
    for k, case in enumerate(values["cases"]):
        try:
            cases.append(build_case(case, monitor))
        except DataError as error:
            problems.append(checked.problem(("cases", k), str(error)))
    if problems:
        raise ConfigError(problems)
    plan = {"flights": 1, "mission": values["mission"], "constants": values["constants"]}
    methods = {m["name"]: chosen_method(m) for m in values["methods"]}
    return Study(
        Path(path),
        monitor,
        values["records"],
        plan,
        noise,
        tuple(cases),
        methods,
        values["false_alarm"],
        values["reliability"],
        values["seed"],
    )
