"""Declared columns of the search for missing physics: `locate`, `explain` and `refine`.

What `explain` writes: coefficients as rows, or all of it as one object; curves and amplitudes as files beside.

Rows of `locate`: places of the map, or places with an amplitude of their own in every record.

The report of `refine`: what unseen flights say of the engine file before and after.
"""

from __future__ import annotations

from enginediag_cli.report.outputs.declared import Table, column, part
from enginediag_cli.report.outputs.judgements import FLIPS

_PLACE = (
    column("location", "text", "where it acts"),
    column("component", "text", "component of the place"),
    column("driver", "text", "what it varies with"),
)

EXPLAIN = Table(
    "explain",
    1,
    "one row per coefficient of every explanation; of unlisted physics one per place that was fitted",
    (
        column("status", "text", "what the answer is"),
        column("rank", "integer", "rank of the explanation, from 1", empty=True),
        column("kind", "text", "effect, fault, law, switch, control, free form …", empty=True),
        column("name", "text", "name of the explanation, effect@place", empty=True),
        column("component", "text", "component where it acts", empty=True),
        column("driver", "text", "what it varies with", empty=True),
        column("probability", "number", "probability of the explanation", empty=True),
        column("coefficient", "text", "the coefficient of this row", empty=True),
        column("value", "number", "its value", "of the coefficient", empty=True),
        column("standard_error", "number", "its standard error", "of the coefficient", empty=True),
        column("low", "number", "lower end of its 95 % interval", "of the coefficient", empty=True),
        column("high", "number", "upper end of its 95 % interval", "of the coefficient", empty=True),
        column("unit", "text", "unit of the coefficient", empty=True),
        column("gain", "number", "fall of χ², twice the log likelihood", empty=True),
        column("flights_gained", "number", "share of flights that gain", empty=True),
        column("statement", "text", "the same in words", empty=True),
    ),
    document=(
        column("schema", "text", "name and version of this schema"),
        column("status", "text", "what the answer is"),
        column("reason", "text", "why there is none", empty=True),
        column("kind", "text", "kind of the leading explanation", empty=True),
        column("sentences", "texts", "the answer in words"),
        *FLIPS,
        part("control", "a control that the model lacks", empty=True),
        part(
            "explanations",
            "those that cannot be told apart, likeliest first",
            (
                column("name", "text", "effect@place, joined by +"),
                column("in_words", "text", "the same in words"),
                column("kinds", "texts", "of each member"),
                column("components", "texts", "of each member"),
                column("drivers", "texts", "of each member"),
                column("probability", "number", "probability of the explanation", empty=True),
                column("gain", "number", "fall of χ², twice the log likelihood", empty=True),
                column("chi2", "number", "χ² with it", empty=True),
                column("flights_gained", "number", "share of flights that gain", empty=True),
                part("coefficients", "with intervals", many=True),
                part("rates", "coefficients that are times, as rates", many=True),
            ),
            many=True,
        ),
        part("rest", "places at which something is left", _PLACE, many=True),
        part("rejected", "explanations that were rejected, and why"),
        part("places", "leading places of the map", _PLACE, many=True),
        part("curves", "free-form curves", _PLACE, many=True),
        part("law", "a law that no library holds", empty=True),
        part("hidden", "what acts without a recorded driver", many=True),
        part(
            "follows",
            "what the first of these follows after all, as a switch with hysteresis, best first",
            (
                column("variable", "text", "name of the variable"),
                column("way", "text", "above, below, falling or rising: when it is on"),
                column("lower", "number", "lower threshold", "of the variable, or its design value"),
                column("upper", "number", "upper threshold", "of the variable, or its design value"),
                column("turns", "integer", "changes of state that they give back"),
                column("changes", "integer", "of so many"),
                column("wrong", "integer", "records that they have wrong"),
                column("records", "integer", "of so many"),
                column("gain", "number", "by how much shorter this is to write down", "nat"),
            ),
            many=True,
        ),
        column("map_accuracy", "number", "stated accuracy of the maps"),
        part("advice", "what to record next", empty=True),
        column("chi2", "number", "χ² without any explanation", empty=True),
        column("readings", "integer", "readings that it is of", empty=True),
        column("provenance", "texts", "what made it, as the head of a CSV"),
    ),
)

CURVES = Table(
    "explain/curves",
    1,
    "explain --curves: points of the fitted free-form curves",
    (
        column("location", "text", "where it acts"),
        column("driver", "text", "what it varies with"),
        column("driver_unit", "text", "unit of the driver"),
        column("driver_value", "number", "value of the driver", "driver_unit"),
        column("change", "number", "change there", "unit"),
        column("standard_error", "number", "its standard error", "unit"),
        column("unit", "text", "unit of the change"),
    ),
)

AMPLITUDES = Table(
    "explain/amplitudes",
    1,
    "explain --amplitudes: an effect without a recorded driver, record by record",
    (
        column("engine", "text", "engine of the record"),
        column("flight", "text", "flight of the record"),
        column("record", "integer", "number of the record in its flight, from 1"),
        column("time_s", "number", "time of the record", "s", empty=True),
        column("location", "text", "where it acts"),
        column("amplitude", "number", "its amplitude", "unit"),
        column("standard_error", "number", "its standard error", "unit"),
        column("unit", "text", "unit of the amplitude"),
        column("probability_on", "number", "probability that the switch is on", empty=True),
        column("changed_from_s", "number", "earliest time at which it changed to this", "s", empty=True),
        column("changed_to_s", "number", "latest time at which it changed to this", "s", empty=True),
    ),
)


LOCATE = Table(
    "locate",
    1,
    "one row per place within reach of the best; a single one where there is no place to tell",
    (
        column("verdict", "text", "what kind of mismatch it is, or that there is none"),
        column("rank", "integer", "rank of the place, from 1", empty=True),
        column("driver", "text", "what it varies with; what these flights cannot tell apart as a = b", empty=True),
        column("along", "text", "the driver of the group that was scored", empty=True),
        column("location", "text", "where it acts", empty=True),
        column("component", "text", "component of the place", empty=True),
        column("within", "boolean", "whether the place is within reach of the best", empty=True),
        column("statistic", "number", "fall of χ² by a free-form correction there", empty=True),
        column("dof", "number", "degrees of freedom of the correction", empty=True),
        column("p_value", "number", "adjusted for all places looked at", empty=True),
        column("share", "number", "share of the excess χ² that it takes away", empty=True),
        column("stability", "number", "share of resamples of whole flights in which it comes first", empty=True),
        column("driver_stability", "number", "share of resamples in which its driver comes first", empty=True),
        column("refit", "number", "fall of χ² after a refit inside the model", empty=True),
    ),
)

PER_RECORD = Table(
    "locate/per-record",
    1,
    "locate --per-record: one row per place with a free amplitude in every record, best first",
    (
        column("rank", "integer", "rank of the place, from 1"),
        column("location", "text", "where the amplitude acts; nothing for the model as it is"),
        column("component", "text", "component of the place", empty=True),
        column("chi2_per_record", "number", "χ² per record that is left"),
        column("times_best", "number", "that over the χ² per record of the best"),
        column("at_bound", "integer", "identified parameters that end at a bound"),
        column("failed", "integer", "records that could not be computed"),
        column("converged", "boolean", "whether the fit converged"),
    ),
)


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
