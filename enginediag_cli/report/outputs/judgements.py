"""Declared columns of what is said of windows: `residual`, `detect`, `isolate` and `trend`.

The columns of every row that is about a window of records: which it is, and what became of its records.

Columns that stand beside an answer: what would flip it, and what restoring a module would bring. Objects in JSON,
texts in a table, where they have to be asked for.

Rows of `detect`: of windows, of blocks of a flight that is followed, and by another method.

Rows of `isolate`: one per window and isolated parameter, or one per window with its components.

Rows of `residual`: local statistics of windows, or residuals of records.

Rows of `trend`: one per parameter, per event, or per flight and parameter.
"""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.report.outputs.declared import Table, column, part

WINDOW = (
    column("source", "text", "file that holds the window"),
    column("flight", "text", "flight, as its recording calls it; empty where it does not say"),
    column("engine", "text", "engine, as its recording calls it; empty where it does not say"),
    column("first_line", "integer", "first line of the window in its file, from 1"),
    column("last_line", "integer", "last line of the window"),
    column("start_s", "number", "time of the first record", "s", empty=True),
    column("end_s", "number", "time of the last record", "s", empty=True),
    column("records", "integer", "records in the window"),
    column("outside", "integer", "of these, outside the operating points identified and not judged"),
    column("incomplete", "integer", "of these, without an input or any reading"),
    column("failed", "integer", "of these, not computed by the engine's model"),
    column("sensors", "integer", "sensors that gave a reading"),
    column("sensors_of", "integer", "sensors that there are"),
    column("extrapolated", "integer", "records judged beyond the operating points identified, with limits as wider"),
    column("reason", "text", "why there is no verdict; empty where there is one"),
)
"""The columns of `residuals.flat.window_row`."""

INSTRUMENTS = column("instruments", "texts", "instruments that are stuck or scatter, in words", empty=True)


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


_TESTED = (
    column("verdict", "text", "healthy, fault, no verdict, or cannot tell where the leading answer does not stand"),
    column("p_value", "number", "probability of such a statistic where nothing changed", empty=True),
    column("fit_before", "number", "χ² per degree of freedom without any answer", empty=True),
    column("fit", "number", "χ² per degree of freedom that the answer leaves", empty=True),
    column("explained", "number", "share of the excess χ² that the answer takes away", empty=True),
    column("unlisted", "number", "probability that it is something that is not among the suspects", empty=True),
)
_CLASS = (
    column("class", "number", "probability that one of `members` is it", empty=True),
    column("members", "texts", "answers that the data cannot tell apart", empty=True),
    column("would_tell", "texts", "sensors that would tell the members apart", empty=True),
)

ISOLATE = Table(
    "isolate",
    1,
    "one row per window and isolated parameter, a single one where none is isolated",
    (
        *WINDOW,
        *_TESTED,
        INSTRUMENTS,
        column(
            "isolated", "texts", "the set of parameters that changed, with the instruments that are wrong", empty=True
        ),
        column(
            "probability",
            "number",
            "probability that these changed and nothing else that matters; with those of all others and `unlisted`, 1",
            empty=True,
        ),
        *_CLASS,
        column("parameter", "text", "the parameter that this row is about", empty=True),
        column("inclusion", "number", "probability that this parameter changed, in any set", empty=True),
        column("change", "number", "its change from nominal", "of the parameter", empty=True),
        column("lower", "number", "lower end of the change's interval (--confidence)", "of the parameter", empty=True),
        column("upper", "number", "upper end of the change's interval (--confidence)", "of the parameter", empty=True),
        column("unit", "text", "unit of the change; 1 is a share of nominal", empty=True),
        column("percent", "number", "the change in per cent of nominal", "%", empty=True),
        column("rivals", "texts", "other sets that cannot be excluded, with their probabilities", empty=True),
        column("rivals_left_out", "integer", "rivals that are not listed", empty=True),
        column("note", "text", "why there is no verdict, or what a bad fit did to the answer"),
        column("named", "texts", "faults of the catalogue that it is", empty=True),
        column("named_probability", "number", "probability of exactly these faults", empty=True),
        column(
            "severity", "texts", "size of each named fault with its interval, 1 as the catalogue has it", empty=True
        ),
        column("named_rivals", "texts", "other faults that cannot be excluded", empty=True),
        column("advice", "texts", "what to record next, in sentences"),
        *FLIPS,
        *SCOPE,
    ),
    asked={
        **ASKED_FLIPS,
        **ASKED_SCOPE,
        **dict.fromkeys(("named", "named_probability", "severity", "named_rivals"), "--catalogue"),
        "advice": "--advise",
    },
)

COMPONENTS = Table(
    "isolate/components",
    1,
    "isolate --by component: one row per window",
    (
        *WINDOW,
        *_TESTED,
        INSTRUMENTS,
        column("components", "texts", "the components that changed", empty=True),
        column("probability", "number", "probability of exactly these", empty=True),
        *_CLASS,
        column(
            "inclusion", "texts", "each component with the probability that it changed, likeliest first", empty=True
        ),
        column("rivals", "texts", "other sets of components, with their probabilities", empty=True),
        column("note", "text", "why there is no verdict, or what a bad fit did to the answer"),
        *FLIPS,
        *SCOPE,
    ),
    asked={**ASKED_FLIPS, **ASKED_SCOPE},
)


_MADE = {
    "nominal": "fingerprint of the nominal state and its engine",
    "window": "length of the windows; empty for whole flights",
    "step": "from one window to the next",
    "linearise": "where the model was linearised",
    "monitor": "parameters monitored, as they were asked for",
    "reference": "records that the window was compared with, 0 for nominal",
    "last": "records at the end of each flight that alone were judged, 0 for all",
    "model_error": "accuracy of the maps, where it was set by hand",
    "recorder": "fingerprint of the recorder file",
    "engine_instance": "the engine that was chosen of several",
}
_SQUARED = "per product of two parameters"

RESIDUAL = Table(
    "residual",
    1,
    "one row per window: local statistics s, F, V, which add; all that detect, isolate and trend need",
    (
        *WINDOW,
        column("silent", "texts", "monitored errors of sensors that gave no reading", empty=True),
        column("n", "integer", "records that the statistics rest on", empty=True),
        column("chi2", "number", "χ² of the residuals", empty=True),
        column("dof", "number", "its degrees of freedom", empty=True),
        column("noise_A1", "number", "how uncertain the noise makes the metric: first moment", empty=True),
        column("noise_A2", "number", "how uncertain the noise makes the metric: second moment", empty=True),
        column("noise_Q", "number", "how far the noise is from Gaussian", empty=True),
        column("parameters", "text", "what each parameter is, as a JSON list", empty=True),
        column("conditions", "text", "mean of each input over the records judged, as a JSON object", empty=True),
        column(
            "nuisance",
            "text",
            "JSON object: how many unit normals all windows share (common), and the standard deviations of what each "
            "recording has anew (own); empty: counted in s, F and V already (--reference)",
            empty=True,
        ),
        *(column(f"made:{name}", "text", help) for name, help in _MADE.items()),
        column("checksum", "text", "checksum of the other cells of the row"),
    ),
    families=(
        column("theta0:<parameter>", "number", "nominal value", "of the parameter", empty=True),
        column("prior_sigma:<parameter>", "number", "prior size of a change", "of the parameter", empty=True),
        column(
            "nuisance:<number>",
            "text",
            "s, F and V of what nuisance lists, and F and V between it and the parameters: f8: and base 64 of float64",
            empty=True,
        ),
        column("s:<parameter>", "number", "score Σ JᵀR⁻¹e", "per parameter", empty=True),
        column("F:<parameter>|<parameter>", "number", "information Σ JᵀR⁻¹J, upper triangle", _SQUARED, empty=True),
        column("V:<parameter>|<parameter>", "number", "covariance of s, upper triangle", _SQUARED, empty=True),
        column(
            "slopes:<parameter>|<parameter>",
            "number",
            "covariance that wrong slopes of the maps add to a change",
            "product of two parameters",
            empty=True,
        ),
    ),
)

RECORDS = Table(
    "residual/records",
    1,
    "residual --what records: one row per record, measured minus predicted",
    (
        column("source", "text", "file of the record"),
        column("line", "integer", "its line there, from 1"),
        column("flight", "text", "flight, as the recording calls it"),
        column("engine", "text", "engine, as the recording calls it"),
        column("time_s", "number", "time of the record", "s", empty=True),
        column("state", "text", "ok, or why there is no residual or what is doubtful about it"),
    ),
    families=(
        column("<sensor>:residual", "number", "measured minus predicted", "of the sensor's column", empty=True),
        column("<sensor>:sigmas", "number", "the residual in standard deviations of the noise", empty=True),
    ),
    asked=dict.fromkeys(("flight", "engine", "time_s"), "a recording that has the column"),
)


_SERIES = (
    column("engine", "text", "engine, as its recording calls it"),
    column("flights", "integer", "flights, or windows, of the series"),
)
_FIT = (
    column(
        "verdict",
        "text",
        "of the engine: changed, steady, differs from nominal from the first flight on, or cannot tell",
    ),
    column("fit_before", "number", "χ² per degree of freedom without any change", empty=True),
    column("fit", "number", "χ² per degree of freedom with what is told here", empty=True),
    column("unlisted", "number", "probability that it is something that is not among the suspects", empty=True),
    INSTRUMENTS,
)
_ONSET = (
    column("onset", "integer", "flight from which on, counted from 1 in the series", empty=True),
    column("onset_low", "integer", "lower end of its 95 % interval", empty=True),
    column("onset_high", "integer", "upper end of its 95 % interval", empty=True),
    column("onset_flight", "text", "that flight, as its recording calls it", empty=True),
    column("onset_source", "text", "file that holds it", empty=True),
    column("onset_line", "integer", "its first line there", empty=True),
    column("onset_s", "number", "its time, where the recording has one", "s", empty=True),
)
_PARAMETER = "of the parameter"

TREND = Table(
    "trend",
    1,
    "one row per parameter: what changed over flights, and since when",
    (
        *_SERIES,
        column("parameter", "text", "the parameter"),
        *_FIT,
        column("component", "text", "component or instrument that it belongs to"),
        column(
            "kind",
            "text",
            "steady, step, deterioration, or cannot tell where the series is not steady and nothing is told of it",
        ),
        column("probability", "number", "probability that it changed at all"),
        *_ONSET,
        column("change", "number", "change from before the onset to the last flight", _PARAMETER, empty=True),
        column("change_low", "number", "lower end of its 95 % interval", _PARAMETER, empty=True),
        column("change_high", "number", "upper end of its 95 % interval", _PARAMETER, empty=True),
        column("rate_per_flight", "number", "mean rate since the onset", _PARAMETER, empty=True),
        column("rate_low", "number", "lower end of its 95 % interval", _PARAMETER, empty=True),
        column("rate_high", "number", "upper end of its 95 % interval", _PARAMETER, empty=True),
        column("unit", "text", "unit of change and rate; 1 is a share of nominal"),
        column("rivals", "texts", "other suspects of the same change, with their probabilities"),
        *SCOPE,
    ),
    asked=ASKED_SCOPE,
)

EVENTS = Table(
    "trend/components",
    1,
    "trend --by component: one row per event, one alone where there is none",
    (
        *_SERIES,
        *_FIT,
        column("components", "texts", "the component that changed, or those that cannot be told apart"),
        column("probability", "number", "probability of the change; without an event, that nothing changed"),
        column("kind", "text", "step or deterioration", empty=True),
        *_ONSET,
        column("rivals", "texts", "all suspects, with their probabilities"),
        *SCOPE,
    ),
    asked=ASKED_SCOPE,
)

FLIGHTS = Table(
    "trend/flights",
    1,
    "trend --what flights: one row per flight and parameter",
    (
        column("engine", "text", "engine, as its recording calls it"),
        column("source", "text", "file that holds the flight"),
        column("flight", "text", "flight, as its recording calls it"),
        column("number", "integer", "its number in the series, from 1"),
        column("records", "integer", "records judged"),
        column("parameter", "text", "the parameter"),
        column("change", "number", "its change from nominal", _PARAMETER),
        column("low", "number", "lower end of the 95 % interval", _PARAMETER),
        column("high", "number", "upper end of the 95 % interval", _PARAMETER),
        column("unit", "text", "unit of the change; 1 is a share of nominal"),
    ),
)

_ESTIMATE = "of all flights together; in a row of a flight, by that flight alone"


def with_ends(name: str) -> tuple[str, str, str]:
    """A column of the margin's table, and those of its interval: used_K, used_low, used_high."""
    stem = name.removesuffix("_K")
    return name, f"{stem}_low", f"{stem}_high"


def _estimated(name: str, help: str, unit: str, level: str = "95 %") -> tuple[Field, ...]:
    told = (help, f"lower end of its {level} interval", f"upper end of its {level} interval")
    return tuple(column(n, "number", what, unit, empty=True) for n, what in zip(with_ends(name), told, strict=True))


MARGIN = Table(
    "trend/margin",
    1,
    "trend --what margin: one row per flight, one per event of maintenance, and one with the margin of each engine",
    (
        column("engine", "text", "engine, as its recording calls it"),
        column("row", "text", "what the row tells: flight, maintenance or margin"),
        column("number", "integer", "flight, counted from 1; the first after maintenance; the last", empty=True),
        column("flight", "text", "that flight, as its recording calls it", empty=True),
        column("source", "text", "file that holds it", empty=True),
        column("column", "text", "the hottest recorded temperature of burnt gas, whose margin it is", empty=True),
        column("condition", "text", "reference condition of the margin", empty=True),
        column("limit_K", "number", "limit of the temperature there, as stated", "K", empty=True),
        *_estimated("used_K", f"kelvins that wear has taken since the baseline, {_ESTIMATE}", "K"),
        *_estimated("margin_K", f"kelvins to the limit, {_ESTIMATE}", "K"),
        *_estimated("remaining_flights", "flights until the limit; empty: no end in sight", "", "90 %"),
        *_estimated("rate_K", "kelvins that wear takes in a flight now", "K"),
        column("event", "text", "wash, overhaul or exchange", empty=True),
        column("component", "text", "component that it was done to; empty: the engine", empty=True),
        column("brought", "texts", "what each parameter gained, with its 95 % interval"),
        *_estimated("recovered_K", "kelvins of margin that maintenance gave back", "K"),
        *_estimated("temperature_gain_K", "by how much turbine temperature fell at equal power", "K"),
        *_estimated("fuel_gain_percent", "by how much fuel flow fell at equal power", "%"),
        column("held", "text", "at which power and operating point that is", empty=True),
        column("reason", "text", "why something cannot be told", empty=True),
    ),
)
