"""What `--picture` of `detect`, `isolate`, `trend` and `identify` draws: one chart of each answer, as a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.report.charts.health_trend import (
    Course,
    health_trend,
    maintenance_marks,
    margin,
    margin_found,
)
from enginediag_cli.report.charts.model import Chart, Mark, Origin, scale_of
from enginediag_cli.report.charts.model_charts import identified_fit
from enginediag_cli.report.charts.residual_charts import detection_course, window_fingerprint
from enginediag_cli.report.charts.rows import ALONE, Row, given_rows, order_of
from enginediag_cli.report.charts.static import picture

if TYPE_CHECKING:
    from enginediag_cli.detection.trend import Series
    from enginediag_cli.identification.identify import Identification
    from enginediag_cli.isolation.of_windows import IsolatedWindow

LIKELY = 0.5
"""Probability from which a parameter is drawn as one that changed."""


def svg_of(chart: Chart) -> str:
    """The chart as SVG text."""
    return picture(chart).text()


def of_detection(rows: Iterable[Mapping[str, Any]]) -> Chart:
    """Raises NoVerdictError where nothing was judged."""
    told = [_row(row) for row in rows]
    if not any(row.number("threshold") > 0 for row in told):
        raise NoVerdictError("--picture: no window has a verdict that could be drawn")
    return detection_course("detect", told)


def of_isolation(windows: Sequence[IsolatedWindow]) -> Chart:
    """The last window in which something was isolated, or the last that was judged. Raises NoVerdictError where no
    statistics hold the sensors."""
    judged = [w for w in windows if w.diagnosis is not None and w.verdict.window.statistics is not None]
    for found in [*reversed([w for w in judged if w.named]), *reversed(judged)]:
        assert found.diagnosis is not None
        result, window = found.diagnosis.result, found.verdict.window
        rivals = [(tuple(r.parameters), r.probability) for r in result.rivals]
        answers = [(tuple(result.isolated), result.probability), *rivals] if result.isolated else []
        place = Origin(window.source, f"{window.first_line}–{window.last_line}")
        chart = window_fingerprint("isolate", window, place, answers, found.known)
        if chart is not None:
            return chart
    raise NoVerdictError("--picture: no window that was judged has statistics with every sensor's error")


def of_trend(series: Series, rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of the first engine in which something changed, else of the first: its health over flights; rows: of `trend`.
    Raises NoVerdictError where no engine has flights."""
    from enginediag_cli.report.trend_rows import flight_rows

    flights = [_row(row) for row in flight_rows(series)]
    if not flights:
        raise NoVerdictError("--picture: no flight has statistics that could be drawn")
    changed = [row for row in rows if row.get("onset") and row.get("parameter") and row["probability"] >= LIKELY]
    engine = str((changed or [flights[0].cells])[0]["engine"])
    mine = [row for row in flights if row.text("engine") == engine]
    of_it = [row for row in changed if row["engine"] == engine]
    names = [str(row["parameter"]) for row in of_it] or list(dict.fromkeys(row.text("parameter") for row in mine))
    _, unit = scale_of(series.known[names[0]])
    names = [name for name in names if scale_of(series.known[name])[1] == unit]
    one = [row for row in mine if row.text("parameter") == names[0]]
    told = ""
    if of_it:
        windows = [
            (replace(x.window, statistics=x.statistics), Origin(x.window.source, f"{x.window.first_line}"))
            for x in series.stretches[engine]
        ]
        mine, told = given_rows(windows, [str(row["parameter"]) for row in of_it]), ALONE
    order, marks = order_of(one), []
    for row in of_it[:1]:
        low, high = order.at(row["onset_low"]), order.at(row["onset_high"])
        if low is not None:
            marks.append(Mark(low, f"onset: {series.known[names[0]].part}", high))
    courses = {
        str(row["parameter"]): Course(
            int(row["onset"]), row["kind"] == "step", row["change"], row["change_low"], row["change_high"]
        )
        for row in of_it
    }
    return health_trend("trend", mine, names, series.known, marks, caption=told, courses=courses)


def of_margin(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of the first engine: its margin over flights, with maintenance; rows: of `trend --what margin`. Raises
    NoVerdictError where no flight tells of it."""
    told = [_row(row) for row in rows]
    found = margin_found([row for row in told if row.text("engine") == told[0].text("engine")])
    chart = None if found is None else margin("margin", found, maintenance_marks(found))
    if chart is None:
        raise NoVerdictError("--picture: no flight tells of a margin that could be drawn")
    return chart


def of_identification(result: Identification) -> Chart:
    """How well each reading is fitted."""
    return identified_fit("identify", result)


def _row(cells: Mapping[str, Any]) -> Row:
    return Row(cells, Origin(str(cells.get("source", "")), str(cells.get("first_line", cells.get("number", "")))))
