"""The report of `refine`: what unseen flights say of the engine file before and after."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column, part

_WHAT = (
    column("what", "text", "the figure: rms, chi2 per reading, log likelihood …"),
    column("of", "text", "sensor, flight or setting that it is of"),
)
_FIGURES = (
    column("unit", "text", "unit of before and after"),
    column("before", "number", "with the engine file as it was", "unit", empty=True),
    column("after", "number", "with what was put in", "unit", empty=True),
    column("n", "integer", "readings, or windows, that it is of", empty=True),
)
_SAID = (
    column("sentences", "texts", "the result in words"),
    column("provenance", "texts", "what made it, as the head of a CSV"),
)
_SCHEMA = column("schema", "text", "name and version of this schema")

REFINE = Table(
    "refine",
    1,
    "refine --report: figures of flights that were not fitted",
    (*_WHAT, *_FIGURES),
    document=(
        _SCHEMA,
        column("verdict", "text", "accepted, refused or cannot be judged"),
        column("refused", "text", "why nothing was written", empty=True),
        column("still_missing", "text", "what the fitted flights show beyond", empty=True),
        part("effects", "terms with their coefficients", many=True),
        part("standard_errors", "of the coefficients"),
        part("criteria", "what was asked, what was found", many=True),
        column("log_likelihood_gain", "number", "on unseen flights", empty=True),
        part("flights", "log likelihood of each unseen flight", many=True),
        part("chi2_per_reading", "on unseen flights", empty=True),
        part("detect", "false alarms before and after", empty=True),
        part("rows", "the rows of the CSV", (*_WHAT, *_FIGURES), many=True),
        *_SAID,
    ),
)

CONTROL = Table(
    "refine/control",
    1,
    "refine --report, where a control is put into the engine file",
    (*_WHAT, column("where", "text", "regime of the control, or everything"), *_FIGURES),
    document=(
        _SCHEMA,
        column("accepted", "boolean", "whether the file was written"),
        column("failed", "text", "why not", empty=True),
        column("control", "text", "the control in words"),
        part("standard_errors", "of set point and stops"),
        part("rows", "the rows of the CSV", many=True),
        column("errors_smaller_by", "number", "factor on unseen flights, mean over the sensors", empty=True),
        column("runs_gained", "number", "share of runs of records that gain", empty=True),
        *_SAID,
    ),
)
