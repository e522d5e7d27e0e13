"""Rows of `detect`: of windows, of blocks of a flight that is followed, and by another method."""

from __future__ import annotations

from enginediag_cli.presentation.outputs.declared import Table, column
from enginediag_cli.presentation.outputs.windows import INSTRUMENTS, WINDOW

GROSS = column(
    "gross_readings",
    "integer",
    "readings rejected as gross errors; empty of statistics, which do not tell",
    empty=True,
)
VERDICT = column("verdict", "text", "healthy, fault or no verdict")
_PLACE = {c.name: c for c in WINDOW}

DETECT = Table(
    "detect",
    1,
    "one row per window: has the engine departed from nominal?",
    (
        *WINDOW,
        column("judged", "integer", "records that the test rests on"),
        column("statistic", "number", "generalised likelihood ratio, χ² with `dof` where nothing changed", empty=True),
        column("dof", "integer", "degrees of freedom of the statistic", empty=True),
        column("threshold", "number", "value of the statistic from which there is an alarm", empty=True),
        column("p_value", "number", "probability of such a statistic where nothing changed", empty=True),
        column("alarm", "boolean", "whether the statistic is beyond its threshold", empty=True),
        column("fit", "number", "χ² per degree of freedom that no change of parameters explains", empty=True),
        VERDICT,
        INSTRUMENTS,
        GROSS,
        column("not_excited", "texts", "changes that the window could not have shown", empty=True),
    ),
    families=(
        column(
            "detectable:<parameter>",
            "number",
            "smallest change that the window would have shown",
            "of the parameter",
            empty=True,
        ),
    ),
    asked={"not_excited": "--detectable"},
)

FOLLOW = Table(
    "detect/follow",
    1,
    "detect --follow: one row per block of a flight, as it comes",
    (
        _PLACE["source"],
        _PLACE["flight"],
        _PLACE["engine"],
        column("block", "integer", "number of the block in its flight, from 0"),
        *(_PLACE[name] for name in ("first_line", "last_line", "start_s", "end_s", "records")),
        *(_PLACE[name] for name in ("outside", "incomplete", "failed")),
        column("repeated", "integer", "records whose readings are those of the record before, not judged"),
        column("judged", "integer", "records that were judged"),
        _PLACE["sensors"],
        _PLACE["sensors_of"],
        column("log10_e", "number", "evidence that something changed since the flight began, as a power of ten"),
        column("alarm", "boolean", "whether the evidence has reached 1/false-alarm, now or before"),
        column("kind", "text", "what the change looks like in time", empty=True),
        column("leading", "text", "the leading kind where several are possible", empty=True),
        column("probability", "number", "probability of the leading kind", empty=True),
        column("likely", "text", "parameter that the change is likeliest one of", empty=True),
        column("onset_s", "number", "since when", "s", empty=True),
        column("onset_low_s", "number", "lower end of the 95 % interval of the onset", "s", empty=True),
        column("onset_high_s", "number", "upper end of the 95 % interval of the onset", "s", empty=True),
        column("reason", "text", "why the block tells nothing; empty where it does"),
        INSTRUMENTS,
        GROSS,
    ),
)

BY_METHOD = Table(
    "detect/method",
    1,
    "detect --method: one row per window, judged by another method",
    (
        *WINDOW,
        column("judged", "integer", "records that the verdict rests on"),
        column("method", "text", "the method"),
        column("alarm", "boolean", "whether any test is beyond its threshold", empty=True),
        column("isolated", "texts", "what the method names"),
        column("isolated_kind", "text", "whether it names parameters or sensors", empty=True),
        column("probability", "number", "probability that the method states for what it names", empty=True),
        VERDICT,
    ),
    families=(
        column("<test>:statistic", "number", "value of a test", empty=True),
        column("<test>:threshold", "number", "value from which the test alarms", empty=True),
        column("<test>:p_value", "number", "probability of such a value where nothing changed", empty=True),
    ),
)
