"""The outputs whose columns are promised, by the name that `enginediag schema` knows. A new one is one line here."""

from __future__ import annotations

from importlib import import_module

from enginediag_cli.report.outputs.declared import Table

PREFIX = "output/"
_HERE = "enginediag_cli.report.outputs."

OUTPUTS = {
    "detect": "judgements:DETECT",
    "detect/follow": "judgements:FOLLOW",
    "detect/method": "judgements:BY_METHOD",
    "isolate": "judgements:ISOLATE",
    "isolate/components": "judgements:COMPONENTS",
    "trend": "judgements:TREND",
    "trend/components": "judgements:EVENTS",
    "trend/flights": "judgements:FLIGHTS",
    "trend/margin": "judgements:MARGIN",
    "residual": "judgements:RESIDUAL",
    "residual/records": "judgements:RECORDS",
    "locate": "discrepancy:LOCATE",
    "locate/per-record": "discrepancy:PER_RECORD",
    "explain": "discrepancy:EXPLAIN",
    "explain/curves": "discrepancy:CURVES",
    "explain/amplitudes": "discrepancy:AMPLITUDES",
    "refine": "discrepancy:REFINE",
    "refine/control": "discrepancy:CONTROL",
    "prove": "validation:PROVE",
    "prove/isolate": "validation:ISOLATED",
    "study": "validation:STUDY",
    "study/counts": "validation:COUNTS",
    "study/reliability": "validation:RELIABILITY",
    "simulate": "files:SIMULATE",
    "check": "files:CHECK",
    "log": "files:LOG",
}
"""Module and attribute of each declaration; what `identify` writes is a YAML file of kind nominal."""


def output(name: str) -> Table:
    """The declaration of an output; raises KeyError for one that is not there."""
    module, _, attribute = OUTPUTS[name].partition(":")
    found: Table = getattr(import_module(_HERE + module), attribute)
    return found
