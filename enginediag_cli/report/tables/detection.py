"""`residual` and `detect`: their tables, of windows, of records, and of blocks of a flight that is followed.

The columns of every row that is about a window of records say which window it is, and what became of its records.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from enginediag_cli.report.sentences import instrument_fault
from enginediag_cli.report.tables import Columns, Table, column

if TYPE_CHECKING:
    from enginediag_cli.detection.verdict import Verdict
    from enginediag_cli.history.follow import BlockReport
    from enginediag_cli.methods.base import Method, Verdicts, WindowVerdict
    from enginediag_cli.report.messages import Messages

verdict_column: Columns[Verdict] = Columns()
block_column: Columns[BlockReport] = Columns()
part_column: Columns[Any] = Columns()

SOURCE = part_column("source", "text", "file that holds the window")
FLIGHT = part_column("flight", "text", "flight, as its recording calls it; empty where it does not say")
ENGINE = part_column("engine", "text", "engine, as its recording calls it; empty where it does not say")
STRETCH = (
    part_column("first_line", "integer", "first line of the window in its file, from 1"),
    part_column("last_line", "integer", "last line of the window"),
    part_column("start_s", "number?", "time of the first record", unit="s"),
    part_column("end_s", "number?", "time of the last record", unit="s"),
    part_column("records", "integer", "records in the window"),
    part_column("outside", "integer", "of these, outside the operating points identified and not judged"),
    part_column("incomplete", "integer", "of these, without an input or any reading"),
    part_column("failed", "integer", "of these, not computed by the engine's model"),
)
SENSORS = (
    part_column("sensors", "integer", "sensors that gave a reading"),
    part_column("sensors_of", "integer", "sensors that there are"),
)
PLACE = (
    *(SOURCE, FLIGHT, ENGINE, *STRETCH, *SENSORS),
    part_column(
        "extrapolated", "integer", "records judged beyond the operating points identified, with limits as wider"
    ),
)
REASON = part_column("reason", "text", "why there is no verdict; empty where there is one")
WINDOW = (*PLACE, REASON)
"""The columns of `residuals.flat.window_row`."""

INSTRUMENTS = part_column(
    "instruments",
    "texts?",
    "instruments that are stuck or scatter, in words",
    lambda of: [instrument_fault(fault) for fault in of.instruments],
)
GROSS = part_column(
    "gross_readings",
    "integer?",
    "readings rejected as gross errors; empty for statistics, which do not hold it",
    lambda window: window.gross.rejected if window.gross.judged else None,
)
VERDICT = part_column("verdict", "text", "healthy, fault or no verdict")


def _not_excited(verdict: Verdict) -> list[str] | None:
    statistics = verdict.window.statistics
    if verdict.score is None or verdict.detectable is None or statistics is None:
        return None
    return [str(combination) for combination in statistics.unexcited()]


def _smallest_changes(verdict: Verdict) -> dict[str, float]:
    if verdict.score is None or verdict.detectable is None or verdict.window.statistics is None:
        return {}
    sizes = zip(verdict.score.parameters, verdict.detectable, strict=True)
    return {f"detectable:{name}": size for name, size in sizes}


DETECT: Table[Verdict] = Table(
    "detect",
    1,
    "one row per window: has the engine departed from nominal?",
    (
        *verdict_column.part(lambda v: v.window, PLACE),
        REASON,
        verdict_column(
            "judged",
            "integer",
            "records that the test rests on",
            lambda v: v.window.statistics.n if v.window.statistics else 0,
        ),
        *verdict_column.part(
            lambda v: v.test,
            (
                part_column(
                    "statistic", "number?", "generalised likelihood ratio, χ² with `dof` where nothing changed"
                ),
                part_column("dof", "integer?", "degrees of freedom of the statistic"),
                part_column("threshold", "number?", "value of the statistic from which there is an alarm"),
                part_column("p_value", "number?", "probability of such a statistic where nothing changed"),
                part_column("alarm", "boolean?", "whether the statistic is beyond its threshold"),
            ),
        ),
        verdict_column(
            "fit",
            "number?",
            "reduced χ² that no change of parameters explains",
            lambda v: v.fit.ratio if v.fit else None,
        ),
        VERDICT,
        *verdict_column.part(lambda v: v.window, (INSTRUMENTS, GROSS)),
        verdict_column(
            "not_excited",
            "texts?",
            "changes that the window could not have shown",
            _not_excited,
            only_with="--detectable",
        ),
    ),
    terminal=("flight", "engine", "verdict", "p_value", "fit", "records", "start_s", "end_s", "reason", "source"),
    families=(
        verdict_column(
            "detectable:<parameter>",
            "number?",
            "smallest change that the window would have shown",
            unit="of the parameter",
            only_with="--detectable",
        ),
    ),
    family_cells=_smallest_changes,
)
DETECTABLE = ("not_excited", "detectable:<parameter>")
"""Columns that are there with --detectable."""

FOLLOW: Table[BlockReport] = Table(
    "detect/follow",
    1,
    "detect --follow: one row per block of a flight, as it comes",
    (
        block_column("source", "text", SOURCE.help, lambda b: b.key[0]),
        block_column("flight", "text", FLIGHT.help, lambda b: b.key[1]),
        block_column("engine", "text", ENGINE.help, lambda b: b.key[2]),
        block_column("block", "integer", "number of the block in its flight, from 0"),
        *STRETCH,
        block_column("repeated", "integer", "records whose readings are those of the record before, not judged"),
        block_column("judged", "integer", "records that were judged"),
        *SENSORS,
        block_column("log10_e", "number", "evidence that something changed since the flight began, as a power of ten"),
        block_column("alarm", "boolean", "whether the evidence has reached 1/false-alarm, now or before"),
        *block_column.part(
            lambda b: b.change,
            (
                part_column(
                    "kind",
                    "text?",
                    "step, deterioration, comes and goes (once), intermittent, from start, irregular, or cannot tell",
                ),
                part_column("leading", "text?", "the leading kind where several are possible"),
                part_column("probability", "number?", "probability that it changed, by the leading kind"),
                part_column("likely", "text?", "parameter that changed most probably", lambda change: change.parameter),
                part_column(
                    "rivals",
                    "texts?",
                    "other suspects of the same change, with their probabilities",
                    lambda change: [f"{name} ({p:.2g})" for name, p in change.rivals.items()],
                ),
                part_column("onset_s", "number?", "since when", unit="s"),
                part_column(
                    "onset_low_s",
                    "number?",
                    "lower end of the 95 % interval of the onset",
                    lambda change: change.low_s,
                    "s",
                ),
                part_column(
                    "onset_high_s",
                    "number?",
                    "upper end of the 95 % interval of the onset",
                    lambda change: change.high_s,
                    "s",
                ),
            ),
        ),
        block_column("reason", "text", "why the block has no result; empty where it has one"),
        INSTRUMENTS,
        block_column("gross_readings", "integer?", GROSS.help, lambda b: b.gross.rejected),
    ),
    terminal=("flight", "block", "log10_e", "alarm", "kind", "likely", "onset_s", "end_s", "records", "source"),
)


class MethodRow(NamedTuple):
    """What another method says of a window."""

    window_verdict: WindowVerdict
    method: Method

    @property
    def verdicts(self) -> Verdicts | None:
        """None of a window without a verdict."""
        return None if self.window_verdict.reason else self.window_verdict.verdicts

    @property
    def isolated(self) -> list[str]:
        names = self.verdicts.isolated_names(self.window_verdict.number) if self.verdicts is not None else None
        return list(names or ())

    @property
    def probability(self) -> float | None:
        stated = self.verdicts.probability if self.verdicts is not None and self.isolated else None
        return None if stated is None else float(stated[self.window_verdict.number])


method_column: Columns[MethodRow] = Columns()
TEST_COLUMNS = ("statistic", "threshold", "p_value")


def _tests(of: MethodRow) -> dict[str, Any]:
    """Cells of each test of the method; empty without a verdict."""
    tests = {test.name: test for test in of.verdicts.tests} if of.verdicts is not None else {}
    return {
        f"{name}:{figure}": getattr(tests[name], figure)[of.window_verdict.number] if name in tests else None
        for name in of.method.tests
        for figure in TEST_COLUMNS
    }


METHOD: Table[MethodRow] = Table(
    "detect/method",
    1,
    "detect --method: one row per window, judged by another method",
    (
        *method_column.part(lambda of: of.window_verdict.window.place, PLACE),
        *method_column.part(lambda of: of.window_verdict, (REASON,)),
        method_column(
            "judged", "integer", "records that the verdict rests on", lambda of: of.window_verdict.window.judged
        ),
        method_column("method", "text", "the method", lambda of: of.method.name),
        method_column(
            "alarm",
            "boolean?",
            "whether any test is beyond its threshold",
            lambda of: bool(of.verdicts.alarm[of.window_verdict.number]) if of.verdicts is not None else None,
        ),
        method_column("isolated", "texts", "what the method names"),
        method_column(
            "isolated_kind",
            "text?",
            "whether it names parameters or sensors",
            lambda of: of.verdicts.kind if of.verdicts is not None and of.isolated else None,
        ),
        method_column("probability", "number?", "probability that the method states for what it names"),
        *method_column.part(lambda of: of.window_verdict, (VERDICT,)),
    ),
    families=(
        method_column("<test>:statistic", "number?", "value of a test"),
        method_column("<test>:threshold", "number?", "value from which the test alarms"),
        method_column("<test>:p_value", "number?", "probability of such a value where nothing changed"),
    ),
    family_cells=_tests,
    families_after="method",
)


_MADE = {
    "nominal": "fingerprint of the nominal state and its engine",
    "window": "length of the windows; empty for whole flights",
    "step": "from one window to the next",
    "linearise": "where the model was linearised",
    "monitor": "monitored parameters, as requested",
    "reference": "records that the window was compared with, 0 for nominal",
    "last": "records at the end of each flight that alone were judged, 0 for all",
    "model_error": "accuracy of the maps, where it was set by hand",
    "recorder": "fingerprint of the recorder file",
    "engine_instance": "the engine that was chosen of several",
}
_SQUARED = "per product of two parameters"
RECORDED = "a recording that has the column"

RESIDUAL: Table[dict[str, Any]] = Table(
    "residual",
    1,
    "one row per window: local statistics s, F, V, which add; all that detect, isolate and trend need",
    (
        *WINDOW,
        column("silent", "texts?", "monitored errors of sensors that gave no reading"),
        column("n", "integer?", "records that the statistics rest on"),
        column("chi2", "number?", "χ² of the residuals"),
        column("dof", "number?", "its degrees of freedom"),
        column("noise_A1", "number?", "how uncertain the noise makes the metric: first moment"),
        column("noise_A2", "number?", "how uncertain the noise makes the metric: second moment"),
        column("noise_Q", "number?", "how far the noise is from Gaussian"),
        column("parameters", "text?", "what each parameter is, as a JSON list"),
        column("conditions", "text?", "mean of each input over the records judged, as a JSON object"),
        column(
            "nuisance",
            "text?",
            "JSON object: how many unit normals all windows share (common), and the standard deviations of what each "
            "recording has anew (own); empty: counted in s, F and V already (--reference)",
        ),
        *(column(f"made:{name}", "text", help) for name, help in _MADE.items()),
        column("checksum", "text", "checksum of the other cells of the row"),
    ),
    ("flight", "engine", "start_s", "end_s", "records", "n", "chi2", "dof", "outside", "reason", "source"),
    families=(
        column("theta0:<parameter>", "number?", "nominal value", "of the parameter"),
        column("prior_sigma:<parameter>", "number?", "prior size of a change", "of the parameter"),
        column(
            "nuisance:<number>",
            "text?",
            "s, F and V of what nuisance lists, and F and V between it and the parameters: f8: and base 64 of float64",
        ),
        column("s:<parameter>", "number?", "score Σ JᵀR⁻¹e", "per parameter"),
        column("F:<parameter>|<parameter>", "number?", "information Σ JᵀR⁻¹J, upper triangle", _SQUARED),
        column("V:<parameter>|<parameter>", "number?", "covariance of s, upper triangle", _SQUARED),
        column(
            "slopes:<parameter>|<parameter>",
            "number?",
            "covariance that wrong slopes of the maps add to a change",
            "product of two parameters",
        ),
    ),
)

RECORDS: Table[dict[str, Any]] = Table(
    "residual/records",
    1,
    "residual --what records: one row per record, measured minus predicted",
    (
        column("source", "text", "file of the record"),
        column("line", "integer", "its line there, from 1"),
        column("flight", "text", "flight, as the recording calls it", only_with=RECORDED),
        column("engine", "text", "engine, as the recording calls it", only_with=RECORDED),
        column("time_s", "number?", "time of the record", "s", only_with=RECORDED),
        column("state", "text", "ok, or why there is no residual or what is doubtful about it"),
    ),
    families=(
        column("<sensor>:residual", "number?", "measured minus predicted", "of the sensor's column"),
        column("<sensor>:sigmas", "number?", "the residual in standard deviations of the noise"),
    ),
)


def report_window(messages: Messages, verdict: Verdict, *, in_words: bool) -> None:
    """Instruments that are stuck or scatter, where they are named in words; a window that is not healthy, for the log
    alone: its rows say more."""
    if in_words and verdict.window.instruments:
        from enginediag_cli.report.tables.isolation import report_instruments

        report_instruments(messages, verdict)
    if verdict.verdict == "healthy" or messages.log is None:
        return
    from enginediag_cli.report.tables.isolation import window_fields, window_words

    told = f"{window_words(verdict)}: {verdict.verdict}" + (f", {verdict.reason}" if verdict.reason else "")
    p_value = verdict.test.p_value if verdict.test else None
    messages.record("note", told, verdict=verdict.verdict, p_value=p_value, **window_fields(verdict))


def report_new_instruments(messages: Messages, report: BlockReport, known: set[str]) -> None:
    """Instruments of a flight that are found stuck or scattering for the first time, beside those that are `known`."""
    from enginediag_cli.report.sentences import instrument_fault

    source, flight, engine = report.key
    place = ", ".join(filter(None, [engine and f"engine {engine}", flight and f"flight {flight}"])) or source
    for fault in report.instruments:
        if fault.name not in known:
            known.add(fault.name)
            messages.note(f"{place}: {instrument_fault(fault)}", engine=engine, flight=flight)
