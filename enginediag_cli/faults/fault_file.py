"""Declaration of the YAML file that describes faults, and the faults that one or more files hold."""

from __future__ import annotations

from pathlib import Path

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.config.kinds import load_checked
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.faults.component_faults import ComponentFault, FaultSet
from enginediag_cli.faults.laws import LAWS, STEP
from enginediag_cli.faults.sensor_faults import EFFECTS, SensorFault

_LAW = Field("law", "section", "how it grows; a step from the first record where absent", STEP, section=LAWS)

COMPONENT_FAULT = Section(
    "fault",
    "a direction in parameter space",
    (
        Field("description", "text", "what happens in the engine", ""),
        Field("reference", "text", "where direction and size come from", ""),
        Field("assumed", "boolean", "true where the size is engineering judgement, not published", False),
        Field(
            "changes",
            "number_map",
            "change of each parameter at severity 1: relative for scale factors "
            "(nominal not 0), in the parameter's unit for biases (nominal 0)",
        ),
        Field("severity", "number", "how much of these changes at full size", 1.0),
        _LAW,
    ),
)

SENSOR_FAULT = Section(
    "sensor fault",
    "an instrument that reads wrong",
    (
        Field("description", "text", "what happens to the instrument", ""),
        Field("reference", "text", "where the size comes from", ""),
        Field("assumed", "boolean", "true where the size is engineering judgement, not published", False),
        Field("column", "text", "column of the recording that it affects, e.g. T3_K"),
        Field("effect", "section", "what it does to the reading", section=EFFECTS),
        _LAW,
    ),
)

FAULT_FILE = Section(
    "faults",
    "faults of components and of sensors",
    (
        Field("kind", "choice", "kind of file", "faults", choices=("faults",)),
        Field("description", "text", "what this set of faults is", ""),
        Field("source", "text", "where directions and sizes come from", ""),
        Field("faults", "named_sections", "faults of components", (), section=COMPONENT_FAULT),
        Field("sensor_faults", "named_sections", "faults of sensors", (), section=SENSOR_FAULT),
    ),
)


def load_faults(*paths: str | Path) -> FaultSet:
    """All faults of the files together; raises ConfigError with file, line and column."""
    components: list[ComponentFault] = []
    sensors: list[SensorFault] = []
    for path in paths:
        checked = load_checked(path, "faults")
        faults, instruments = checked.values["faults"], checked.values["sensor_faults"]
        if not faults and not instruments:
            raise ConfigError(
                [Problem(checked.mark(), "the file describes no fault", "give 'faults:' or 'sensor_faults:'")]
            )
        for k, values in enumerate(faults):
            marks = {name: checked.key_mark(("faults", k, "changes", name)) for name in values["changes"]}
            components.append(
                ComponentFault(
                    values["name"],
                    values["changes"],
                    values["severity"],
                    values["law"],
                    marks,
                    checked.mark(("faults", k)),
                    values["reference"],
                    values["assumed"],
                )
            )
        for k, values in enumerate(instruments):
            sensors.append(
                SensorFault(
                    values["name"],
                    values["column"],
                    values["effect"],
                    values["law"],
                    checked.mark(("sensor_faults", k, "column")),
                    values["reference"],
                    values["assumed"],
                )
            )
    return FaultSet(tuple(components), tuple(sensors))
