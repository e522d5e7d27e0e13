"""What `study` writes: rates, counts or reliability as rows, all of it as one object."""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.presentation.outputs.declared import Table, column, part

_PLACE = (
    column("case", "text", "fault case of the study file"),
    column("method", "text", "method of diagnosis"),
)
_REPETITIONS = column("repetitions", "integer", "diagnoses")
_COUNT = column("count", "integer", "how often")
_RATE = (
    column("rate", "number", "share"),
    column("low", "number", "lower end of its 95 % interval", empty=True),
    column("high", "number", "upper end of its 95 % interval", empty=True),
)


def _rate(name: str, help: str) -> tuple[Field, ...]:
    return (
        column(name, "number", f"share of diagnoses: {help}", empty=True),
        column(f"{name}_low", "number", "lower end of its 95 % interval", empty=True),
        column(f"{name}_high", "number", "upper end of its 95 % interval", empty=True),
    )


STUDY = Table(
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
        column("mean_size", "number", "parameters named, on the mean", empty=True),
        column("seconds_per_diagnosis", "number", "CPU time of one diagnosis", "s"),
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
                column("exact", "integer", "diagnoses that named exactly what changed", empty=True),
                column("contained", "integer", "diagnoses among whose names is what changed", empty=True),
                column("mean_size", "number", "parameters named, on the mean", empty=True),
                column("unchanged", "integer", "diagnoses of engines in which nothing changed"),
                column("false_alarms", "integer", "of these, with a finding"),
                part("false_alarm_rate", "with its interval", _RATE, empty=True),
                part("detected_rate", "with its interval", _RATE, empty=True),
                part("exact_rate", "with its interval", _RATE, empty=True),
                part("contained_rate", "with its interval", _RATE, empty=True),
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

COUNTS = Table(
    "study/counts",
    1,
    "study --show counts: how often each parameter was named, one column per parameter",
    (*_PLACE, _REPETITIONS),
    families=(column("<parameter>", "integer", "diagnoses that name the parameter", empty=True),),
)

RELIABILITY = Table(
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
        column("low", "number", "lower end of the 95 % interval of the rate", empty=True),
        column("high", "number", "upper end of the 95 % interval of the rate", empty=True),
    ),
)
