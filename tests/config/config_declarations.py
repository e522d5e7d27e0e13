"""A file kind that uses every kind of field, for the tests of this folder."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section, Variants

MAP = Section(
    "map",
    "a component map",
    (
        Field("beta", "number", "position on the speed line", default=0.5, minimum=0.0, maximum=1.0),
        Field("table", "text", "CSV file of the map", default=None),
    ),
)
COMPONENT = Variants(
    "component",
    "a component of the gas path",
    {
        "compressor": Section(
            "compressor",
            "raises the pressure",
            (
                Field("pressure_ratio", "number", "design pressure ratio", minimum=1.0),
                Field("spool", "text", "shaft that drives it"),
                Field("map", "section", "its map", default={}, section=MAP),
            ),
        ),
        "nozzle": Section(
            "nozzle", "accelerates the gas", (Field("area_m2", "number", "throat area", unit="m²", minimum=0.0),)
        ),
    },
)
SHAFT = Section("shaft", "a shaft", (Field("inertia_kg_m2", "number", "moment of inertia", default=None),))
SENSOR = Section(
    "sensor",
    "a sensor",
    (
        Field("column", "text", "column of the recording"),
        Field("sigma", "number", "standard deviation", minimum=0.0),
    ),
)
FILE = Section(
    "engine",
    "an engine",
    (
        Field("kind", "choice", "what this file is", choices=("engine",)),
        Field("description", "text", "in one line", default=""),
        Field("sources", "texts", "where the numbers come from", default=()),
        Field("altitude_m", "number", "design altitude", unit="m", minimum=-500, maximum=20000, default=0.0),
        Field("stages", "integer", "number of stages", default=1, minimum=1),
        Field("cooled", "boolean", "whether the turbine is cooled", default=False),
        Field("speeds_rpm", "numbers", "speed lines", unit="rpm", default=(), minimum=0.0),
        Field("envelope_K", "range", "valid inlet temperatures", unit="K", default=None),
        Field("bounds", "number_map", "bounds by parameter", default={}),
        Field("columns", "text_map", "foreign names", default={}),
        Field("constants", "any_map", "constants", default={}),
        Field("sensors", "sections", "sensors", default=(), section=SENSOR),
        Field("shafts", "section_map", "shafts by name", default={}, section=SHAFT),
        Field("components", "named_sections", "the gas path", default=(), section=COMPONENT),
    ),
)

GOOD = """\
kind: engine
description: "a test"
sources: [report 1, report 2]
altitude_m: 1.0e4
stages: 4
cooled: true
speeds_rpm: [1e3, 2000, 3.5e+3]
envelope_K: [220, 320.5]
bounds: {hpc.efficiency: 0.9}
columns:
  T3: EGT
constants: {a: 1, b: text, c: true, d: }
sensors:
  - column: T3_K
    sigma: 2
shafts:
  lp: {}
  hp: {inertia_kg_m2: 3}
components:
  - name: hpc
    type: compressor
    pressure_ratio: 12
    spool: hp
  - {name: nozzle, type: nozzle, area_m2: .25}
"""
