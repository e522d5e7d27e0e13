"""Columns that stand beside an answer: what would flip it, and what restoring a module would bring. Objects in JSON,
texts in a table, where they have to be asked for."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import column, part

FLIP = (
    column("what", "text", "the map, instrument, input or prior that would have to be wrong"),
    column("kind", "text", "map, sensor, input or prior"),
    column("size", "number", "smallest error that changes the name, as added to what was recorded"),
    column("unit", "text", "its unit"),
    column("stated", "number", "what is allowed for it already, one standard deviation", empty=True),
    column("stated_as", "text", "where that comes from", empty=True),
    column("times", "number", "size over stated", empty=True),
    column("becomes", "text", "what the answer would be", empty=True),
    column("words", "text", "the same as a sentence"),
)
FLIPS = (
    part("flips", "errors that would change the name, the nearest first", FLIP, many=True, empty=True),
    column("flips_told", "text", "the nearest of them in one sentence", empty=True),
)
SCOPE = (part("work_scope", "turbine temperature and fuel at equal power if a module were restored", empty=True),)

ASKED_FLIPS = {"flips": "--flips, or json", "flips_told": "json"}
ASKED_SCOPE = {"work_scope": "--work-scope, or json"}
"""What brings these columns."""
