"""The columns of each result that a narrow terminal shows: most important first, as many as have room.

A column that is empty in all rows takes no room. csv, json and ndjson always have all columns.
"""

from __future__ import annotations

DETECT = ("flight", "engine", "verdict", "p_value", "fit", "records", "start_s", "end_s", "reason", "source")

FOLLOW = ("flight", "block", "log10_e", "alarm", "kind", "likely", "onset_s", "end_s", "records", "source")

ISOLATE = (
    "flight",
    "engine",
    "verdict",
    "parameter",
    "change",
    "lower",
    "upper",
    "unit",
    "probability",
    "start_s",
    "fit",
    "note",
    "rivals",
)

COMPONENTS = ("flight", "engine", "verdict", "components", "probability", "start_s", "fit", "rivals", "note")

_COURSE = ("onset_low", "onset_high", "onset_flight", "onset_line", "flights", "fit_before", "fit", "rivals")
"""What is told last of every change over flights, whatever changed."""

TREND = (
    "engine",
    "verdict",
    "parameter",
    "kind",
    "probability",
    "onset",
    "rate_per_flight",
    "change",
    "unit",
    *_COURSE,
)

MARGIN = (
    "engine",
    "row",
    "number",
    "flight",
    "used_K",
    "margin_K",
    "margin_low",
    "margin_high",
    "remaining_flights",
    "remaining_flights_low",
    "remaining_flights_high",
    "event",
    "recovered_K",
    "reason",
)
"""What is left, flight by flight, what maintenance gave back, and how long it lasts."""

TREND_COMPONENTS = ("engine", "verdict", "components", "probability", "kind", "onset", *_COURSE)

FLIGHTS = ("engine", "number", "flight", "parameter", "change", "low", "high", "unit", "records", "source")

STATISTICS = ("flight", "engine", "start_s", "end_s", "records", "n", "chi2", "dof", "outside", "reason", "source")

LOCATE = ("rank", "location", "driver", "statistic", "p_value", "share", "stability", "verdict", "component", "refit")

PER_RECORD = ("rank", "location", "chi2_per_record", "times_best", "at_bound", "failed", "converged", "component")

EXPLAIN = (
    "rank",
    "name",
    "probability",
    "coefficient",
    "value",
    "low",
    "high",
    "unit",
    "status",
    "driver",
    "kind",
    "gain",
    "statement",
)

REFINE = ("what", "of", "before", "after", "unit", "n")

STUDY = (
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
)

SIMULATE = ("time_s", "flight", "altitude_m", "mach", "status")

TERMS = ("term", "title", "varies_with")

VARIABLES = ("variable", "at_design", "unit", "words")

SITES = ("term", "at", "acts_on", "carried", "coefficients")

FLEET = (
    "rank",
    "engine",
    "verdict",
    "severity",
    "unit",
    "since",
    "changed",
    "instruments",
    "margin_K",
    "remaining_flights",
    "discovery",
    "flights",
    "reason",
    "build",
)
