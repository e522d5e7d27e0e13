"""`prove` and `study`: the columns of trials and studies.

The score sheets of `prove` and the rates, counts or reliability of `study`, as rows and as one object.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.report.tables import Column, Table, column, part

_RATE = (
    column("rate", "number?", "share, or mean, as the score says"),
    column("count", "integer?", "how many of them"),
    column("of", "integer", "trials, or answers, that the rate is of"),
    column("low", "number?", "lower end of its 95 % interval"),
    column("high", "number?", "upper end of its 95 % interval"),
    column("target", "text?", "target of the score; empty where there is none"),
    column("met", "text?", "yes or no; empty without a target"),
)

_RUN = (
    column("trials", "integer", "trials that were run"),
    column("failed_records", "integer", "records that could not be simulated"),
    column("seed", "integer", "seed of everything random"),
    column("truths", "texts", "truths that were chosen"),
    part("versions", "of the program and its libraries"),
)
_SCHEMA = column("schema", "text", "name and version of this schema")

PROVE: Table[Mapping[str, Any]] = Table(
    "prove",
    1,
    "one row per score, truth and kind of trials, then one per bin",
    (
        column("score", "text", "what is counted"),
        column("truth", "text", "same_model, map_error or realistic"),
        column("kind", "text", "kind of the trials; empty for the score's headline"),
        column("bin", "text", "bin of size or of stated probability; empty for all"),
        *_RATE,
    ),
    document=(
        _SCHEMA,
        column("scores", "texts", "names of the scores; each is a key of this object"),
        part("bins", "rates by truth and bin"),
        part("held_out_misfit", "χ² per reading of held-back flights, by truth"),
        part("trials_by_kind", "trials of each kind, by truth"),
        column("unscored", "integer", "trials that could not be scored"),
        column("kinds", "texts", "kinds of trials that were drawn"),
        part("model_error", "accuracy of the maps that the explainer allows for, by truth"),
        column("false_alarm", "number", "required probability of a false finding"),
        column("engine", "text", "engine file"),
        *_RUN,
    ),
)

ISOLATED: Table[Mapping[str, Any]] = Table(
    "prove/isolate",
    1,
    "prove --question isolate: the sheet, reliability of stated probabilities, and outcomes by kind",
    (
        column("table", "text", "sheet, reliability, outcomes or kinds"),
        column("score", "text", "what is counted"),
        column("kind", "text?", "kind of the trials"),
        column("bin", "text?", "bin of stated probability"),
        column("stated", "number?", "mean stated probability of the bin"),
        column("gap", "number?", "rate less mean stated probability"),
        *_RATE,
    ),
    document=(
        _SCHEMA,
        part("sheet", "scores with their intervals and targets"),
        part("reliability", "bins of stated probability: all names, by kind of trial, classes, no change, changes"),
        part("kinds", "outcomes by kind of trial"),
        part("engines", "outcomes by engine"),
        column("chosen_kinds", "texts", "kinds of trials that were drawn"),
        column("engine_files", "texts", "engine files"),
        *_RUN,
    ),
)


HISTORIES: Table[Mapping[str, Any]] = Table(
    "prove/history",
    1,
    "prove --kind history: one row per truth and figure",
    (
        column("truth", "text", "how the true engines differ from the model"),
        column("figure", "text", "what is counted"),
        column("rate", "number", "share, or gap"),
        column("low", "number?", "lower end of its 95 % interval"),
        column("high", "number?", "upper end of its 95 % interval"),
        column("hits", "integer?", "how often"),
        column("count", "integer", "of how many"),
        column("target", "text", "its target; empty for none"),
        column("met", "boolean", "whether the rate is within its target"),
    ),
    document=(_SCHEMA, part("sheet", "figures with their intervals and targets"), *_RUN),
)


_PLACE = (
    column("case", "text", "fault case of the study file"),
    column("method", "text", "method of diagnosis"),
)
_REPETITIONS = column("repetitions", "integer", "diagnoses")
_COUNT = column("count", "integer", "how often")
_STUDY_RATE = (
    column("rate", "number", "share"),
    column("low", "number?", "lower end of its 95 % interval"),
    column("high", "number?", "upper end of its 95 % interval"),
)


def _rate(name: str, help: str) -> tuple[Column, ...]:
    return (
        column(name, "number?", f"share of diagnoses: {help}"),
        column(f"{name}_low", "number?", "lower end of its 95 % interval"),
        column(f"{name}_high", "number?", "upper end of its 95 % interval"),
    )


STUDY: Table[Mapping[str, Any]] = Table(
    "study",
    1,
    "one row per case and method: rates with binomial intervals",
    (
        *_PLACE,
        _REPETITIONS,
        column("no_verdict", "integer", "diagnoses without a verdict"),
        *_rate("detected", "a change was found, where there is one"),
        *_rate("false_alarm", "a change was found, where there is none"),
        *_rate("exact", "exactly what changed was named"),
        *_rate("contained", "what changed is among what was named"),
        column("mean_size", "number?", "parameters named, on the mean"),
        column("seconds_per_diagnosis", "number", "CPU time of one diagnosis", "s"),
    ),
    terminal=(
        "case",
        "method",
        "repetitions",
        "detected",
        "exact",
        "contained",
        "false_alarm",
        "mean_size",
        "no_verdict",
        "seconds_per_diagnosis",
    ),
    document=(
        column("schema", "text", "name and version of this schema"),
        part(
            "cases",
            "of every case and method: counts, and rates with their intervals",
            (
                *_PLACE,
                _REPETITIONS,
                column("no_verdict", "integer", "diagnoses without a verdict"),
                column("detected", "integer", "diagnoses that found a change"),
                column("exact", "integer?", "diagnoses that named exactly what changed"),
                column("contained", "integer?", "diagnoses among whose names is what changed"),
                column("mean_size", "number?", "parameters named, on the mean"),
                column("unchanged", "integer", "diagnoses of engines in which nothing changed"),
                column("false_alarms", "integer", "of these, with a finding"),
                part("false_alarm_rate", "with its interval", _STUDY_RATE, empty=True),
                part("detected_rate", "with its interval", _STUDY_RATE, empty=True),
                part("exact_rate", "with its interval", _STUDY_RATE, empty=True),
                part("contained_rate", "with its interval", _STUDY_RATE, empty=True),
                column("failed_records", "integer", "records that could not be simulated"),
            ),
            many=True,
        ),
        column("study", "text", "the study file"),
        column("engine", "text", "name of the engine"),
        column("records", "integer", "records of one diagnosis"),
        column("seed", "integer", "seed of everything random"),
        column("parameters", "texts", "monitored parameters"),
        part(
            "timings",
            "CPU times, which differ from run to run",
            (*_PLACE, column("seconds_per_diagnosis", "number", "CPU time of one diagnosis", "s")),
            many=True,
        ),
    ),
)

COUNTS: Table[Mapping[str, Any]] = Table(
    "study/counts",
    1,
    "study --show counts: how often each parameter was named, one column per parameter",
    (*_PLACE, _REPETITIONS),
    families=(column("<parameter>", "integer?", "diagnoses that name the parameter"),),
)

RELIABILITY: Table[Mapping[str, Any]] = Table(
    "study/reliability",
    1,
    "study --show reliability: one row per bin of stated probability",
    (
        *_PLACE,
        column("from", "number", "lower end of the bin of stated probabilities"),
        column("to", "number", "upper end of the bin"),
        column("answers", "integer", "answers in it"),
        column("stated", "number", "their mean stated probability"),
        column("right", "integer", "how many of them are right"),
        column("rate", "number", "share of them that is right"),
        column("count", "integer", "as right"),
        column("of", "integer", "as answers"),
        column("low", "number?", "lower end of the 95 % interval of the rate"),
        column("high", "number?", "upper end of the 95 % interval of the rate"),
    ),
)
