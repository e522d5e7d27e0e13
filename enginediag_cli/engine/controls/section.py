"""The keys of `controls:` in an engine file."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

FUEL = "fuel"
"""The actuator that every engine has: the fuel valve of its main burner."""
SIDES = ("at_most", "at_least")

SCHEDULE = Section(
    "schedule",
    "a value as a table or a polynomial of something",
    (
        Field("against", "text", "model column or input of the engine; or give `input`", ""),
        Field("input", "text", "column that the recording holds, an input of the engine by this", ""),
        Field("points", "numbers", "where the table has values, rising, in the column's unit", ()),
        Field("values", "numbers", "values there; straight lines between, the end values beyond", ()),
        Field("polynomial", "numbers", "instead of a table: c0, c1, … of c0 + c1 x + …", ()),
    ),
)
LIMIT = Section(
    "limit",
    "a limit that takes over where it is met",
    (
        Field("name", "text", "what `active_limit` calls it"),
        Field("column", "text", "model column that is limited"),
        Field("side", "choice", "which way", choices=SIDES),
        Field("value", "number", "the limit, in the column's unit", None),
        Field("schedule", "section", "the limit as a table or polynomial", None, section=SCHEDULE),
        Field(
            "lead_s",
            "number",
            "in transients of a shaft's speed: what is limited is the speed plus this times its rate of change",
            0.0,
            unit="s",
            minimum=0.0,
        ),
    ),
)
WHILE = Section(
    "acts_while",
    "when a control acts; else its actuator rests at the stop nearest to where nothing sets it",
    (
        Field("column", "text", "model column or input of the engine that tells"),
        Field("side", "choice", "it acts while the column is", choices=SIDES),
        Field("value", "number", "this, in the column's unit"),
        Field("margin", "number", "nearer to it than this nobody can tell whether it acts", 0.0, minimum=0.0),
        Field(
            "rest_sigma",
            "number",
            "how far from its rest the actuator wanders from day to day while released (standard deviation)",
            0.0,
            minimum=0.0,
        ),
    ),
)
CONTROL = Section(
    "control",
    "what moves an actuator of the engine",
    (
        Field("name", "text", "name of the control, the first part of its parameters' names"),
        Field(
            "actuator",
            "text",
            "what it moves: an actuator of a component, such as compressor.vane_closing_deg, or `fuel`",
        ),
        Field(
            "hold", "text", "model column that it keeps at the set point; of fuel, by default, the power setting", ""
        ),
        Field("set_point", "number", "in the unit of that column; default: its value at the design point", None),
        Field("set_point_schedule", "section", "the set point as a table or polynomial", None, section=SCHEDULE),
        Field("low", "number", "lower stop of the actuator, in its unit; default: the component's", None),
        Field("high", "number", "upper stop of the actuator, in its unit; default: the component's", None),
        Field("limits", "named_sections", "limits, the later ones before the earlier ones", (), section=LIMIT),
        Field(
            "lead_s",
            "number",
            "in transients that hold a shaft's speed: what is held is the speed plus this times its rate of change",
            0.0,
            unit="s",
            minimum=0.0,
        ),
        Field(
            "time_constant_s",
            "number",
            "in transients: of the control, which moves the actuator by its error over this; 0: at once",
            0.0,
            unit="s",
            minimum=0.0,
        ),
        Field(
            "rate_per_s",
            "number",
            "in transients: fastest that the actuator moves, in its unit (fuel: kg/s) per second; 0: no limit",
            0.0,
            minimum=0.0,
        ),
        Field("acts_while", "section", "when it acts; default always", None, section=WHILE),
        Field("schedule", "section", "position as a table or polynomial, instead of holding", None, section=SCHEDULE),
        Field("source", "text", "where it comes from", ""),
        Field("standard_errors", "number_map", "of the set point and the stops, as identified", {}),
        Field("recorded", "text", "input column that holds the position, instead of holding", ""),
    ),
)
