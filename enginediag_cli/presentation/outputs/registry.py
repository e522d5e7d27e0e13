"""The outputs whose columns are promised, by the name that `enginediag schema` knows. A new one is one line here."""

from __future__ import annotations

from importlib import import_module

from enginediag_cli.presentation.outputs.declared import Table

PREFIX = "output/"
_HERE = "enginediag_cli.presentation.outputs."

OUTPUTS = {
    "detect": "detect:DETECT",
    "detect/follow": "detect:FOLLOW",
    "detect/method": "detect:BY_METHOD",
    "isolate": "isolate:ISOLATE",
    "isolate/components": "isolate:COMPONENTS",
    "trend": "trend:TREND",
    "trend/components": "trend:EVENTS",
    "trend/flights": "trend:FLIGHTS",
    "trend/margin": "trend:MARGIN",
    "residual": "residual:RESIDUAL",
    "residual/records": "residual:RECORDS",
    "locate": "locate:LOCATE",
    "locate/per-record": "locate:PER_RECORD",
    "explain": "explain:EXPLAIN",
    "explain/curves": "explain:CURVES",
    "explain/amplitudes": "explain:AMPLITUDES",
    "refine": "refine:REFINE",
    "refine/control": "refine:CONTROL",
    "prove": "prove:PROVE",
    "prove/isolate": "prove:ISOLATED",
    "study": "study:STUDY",
    "study/counts": "study:COUNTS",
    "study/reliability": "study:RELIABILITY",
    "simulate": "simulate:SIMULATE",
    "check": "check:CHECK",
    "log": "log:LOG",
}
"""Module and attribute of each declaration; what `identify` writes is a YAML file of kind nominal."""


def output(name: str) -> Table:
    """The declaration of an output; raises KeyError for one that is not there."""
    module, _, attribute = OUTPUTS[name].partition(":")
    found: Table = getattr(import_module(_HERE + module), attribute)
    return found
