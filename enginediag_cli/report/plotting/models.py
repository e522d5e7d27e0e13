"""Charts of a model: its fit by reading, where it differs (location × driver), corrections with bands, and refinements.

Also the charts that `--picture` of `detect`, `isolate`, `trend` and `identify` writes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.identification.nominal import EVERYTHING, SensorQuality
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.plotting import (
    Axis,
    Band,
    Bars,
    Chart,
    ChartTable,
    EventMark,
    HeatCells,
    Layer,
    Line,
    Points,
    RowOrigin,
    Value,
    chart_columns,
)
from enginediag_cli.report.plotting.health import (
    TrendCourse,
    health_trend,
    maintenance_marks,
    margin_forecast,
    read_margin,
)
from enginediag_cli.report.plotting.residuals import detection_course, window_fingerprint
from enginediag_cli.report.plotting.svg import picture
from enginediag_cli.report.result_files import ALONE, Row, conditional_rows, order_windows
from enginediag_cli.report.sentences import display_scale
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.series import Series
    from enginediag_cli.identification.identify import Identification
    from enginediag_cli.isolation.windows import IsolatedWindow


CHI2, RMS = "chi2 per reading", "rms"
"""What rows of `refine` say of a reading."""
ALL = "all"
"""The row of all readings together."""


def refinement_fit(key: str, rows: Sequence[Row]) -> Chart:
    """Rows of `refine`; the readings' own unit is in the table."""
    chi2 = [row for row in rows if row.text("what") == CHI2 and row.text("of") != ALL]
    rms = {row.text("of"): row for row in rows if row.text("what") == RMS}
    names = [split_column(row.text("of"))[0] for row in chi2]
    before, after = ([math.sqrt(row.number(c)) for row in chi2] for c in ("before", "after"))
    places = list(range(len(chi2)))
    origins = [row.origin for row in chi2]
    cells = []
    for row, name, one, other in zip(chi2, names, before, after, strict=True):
        told = rms.get(row.text("of"))
        sizes = (told.number("before"), told.number("after"), told.text("unit")) if told else (None, None, "")
        cells.append((name, one, other, *sizes, row.count("n")))
    columns = chart_columns(
        "reading", "RMS before, standard deviations", "after", "RMS before", "after", "unit", "readings"
    )
    return Chart(
        key,
        "Unseen flights, before and after",
        Axis("RMS of the residual in standard deviations of the noise"),
        Axis("", categories=names),
        [
            Points("before", before, places, 1, origins=origins),
            Points("after", after, places, 0, origins=origins),
        ],
        ChartTable(columns, cells, origins),
        "At 1 a reading is predicted as well as its noise allows.",
        [EventMark(1.0, "noise alone")],
    )


def flight_gains(key: str, flights: Sequence[tuple[str, float, RowOrigin]]) -> Chart:
    """(flight, gain of log likelihood, its place)."""
    origins = [origin for _, _, origin in flights]
    gains = [gain for _, gain, _ in flights]
    lost = sum(gain <= 0 for gain in gains)
    return Chart(
        key,
        "Gain, flight by flight",
        Axis("gain of log likelihood"),
        Axis("", categories=[name for name, _, _ in flights]),
        [Bars("", list(range(len(flights))), gains, 0, origins=origins)],
        ChartTable(chart_columns("flight", "gain of log likelihood"), [(n, g) for n, g, _ in flights], origins),
        f"{sum(gains):.1f} in all; {lost or 'none'} of {len(flights)} without gain.",
    )


def law_curve(key: str, band: Mapping[str, Any], place: str, origin: RowOrigin) -> Chart:
    """band: `variable`, `values`, `change`, `standard_error` and `unit`, as `explain` writes them."""
    unit = str(band.get("unit") or "")
    factor, shown = (100.0, "%") if unit in ("", "1") else (1.0, unit)
    x = [float(v) for v in band["values"]]
    change = [factor * float(v) for v in band["change"]]
    error = [factor * float(v) for v in band["standard_error"]]
    low = [c - NORMAL_95 * e for c, e in zip(change, error, strict=True)]
    high = [c + NORMAL_95 * e for c, e in zip(change, error, strict=True)]
    variable = str(band["variable"]).replace("_", " ")
    columns = chart_columns(variable, ("change", shown), ("95 % from", shown), ("to", shown))
    rows = list(zip(x, change, low, high, strict=True))
    return Chart(
        key,
        f"What the model lacks at {place}",
        Axis(variable),
        Axis(f"change of {place}", shown),
        [Band("95 % band", x, low, high, 0), Line("law", x, change, 0)],
        ChartTable(columns, rows, [RowOrigin(origin.file, f"{origin.row}[{k}]") for k in range(len(rows))]),
        f"The change of {place} along {variable} over the conditions flown, about its mean, with the band of all forms "
        "that agree with the recordings.",
    )


MOST_ROWS, MOST_COLUMNS = 24, 12
"""Places and drivers of a map that can be read."""
SMALLEST = 1e-300
"""A p-value that a float no longer separates from zero."""


def mismatch_places(key: str, rows: Sequence[Row], gate: float = math.nan) -> Chart:
    """Rows of `locate`, or `places` of `explain`; gate: what chance alone reaches, NaN where not known."""
    surprise = [_neg_log_p(row) for row in rows]
    order = sorted(range(len(rows)), key=lambda k: -surprise[k])
    locations = list(dict.fromkeys(rows[k].text("location") for k in order))[:MOST_ROWS]
    drivers = list(dict.fromkeys(rows[k].text("driver") for k in order))[:MOST_COLUMNS]
    kept = [k for k in order if rows[k].text("location") in locations and rows[k].text("driver") in drivers]
    values = [surprise[k] for k in kept]
    cells = HeatCells(
        "−ln p",
        [drivers.index(rows[k].text("driver")) for k in kept],
        [locations.index(rows[k].text("location")) for k in kept],
        values,
        max(values, default=1.0),
        [f"{v:.0f}" if v >= 10 else f"{v:.1f}" for v in values],
        rooted=True,
        origins=[rows[k].origin for k in kept],
    )
    columns = chart_columns("place", "varies with", "−ln p", "fall of χ²", "stability")
    chance = f" Chance alone reaches {gate:.1f}." if math.isfinite(gate) else ""
    left = len(rows) - len(kept)
    return Chart(
        key,
        "Where model and recordings differ",
        Axis("varies with", categories=[_short(driver) for driver in drivers]),
        Axis("", categories=locations),
        [cells],
        ChartTable(
            columns,
            [
                (
                    rows[k].text("location"),
                    rows[k].text("driver"),
                    surprise[k],
                    rows[k].number("statistic"),
                    rows[k].number("stability"),
                )
                for k in order
            ],
            [rows[k].origin for k in order],
        ),
        f"−ln p of a correction at a place that varies with a driver: the darker, the less it is chance.{chance} "
        "Empty cells were not written or cannot be seen." + (f" Less surprising, not drawn: {left}." if left else ""),
    )


def _short(driver: str) -> str:
    """Of a group of indistinguishable drivers the first two."""
    parts = driver.split(" = ")
    return driver if len(parts) < 3 else f"{' = '.join(parts[:2])} + {len(parts) - 2}"


def _neg_log_p(row: Row) -> float:
    if "surprise" in row:
        return row.number("surprise")
    p = row.number("p_value")
    return max(0.0, -math.log(max(p, SMALLEST))) if math.isfinite(p) else 0.0


def identified_fit(key: str, result: Identification) -> Chart:
    """Records that were fitted, cross-validated, and held out, as far as there are."""
    sets = {
        "fitted": result.in_sample,
        "cross-validated": result.cross_validated,
        "held out": result.held_out,
    }
    names = [q.sensor for q in _all_regimes(result.in_sample)]
    layers: list[Layer] = []
    rows: list[Sequence[Value]] = []
    for colour, (words, qualities) in enumerate(sets.items()):
        mine = [q for q in _all_regimes(qualities) if q.sensor in names]
        if mine:
            places = [float(names.index(q.sensor)) for q in mine]
            layers.append(Points(words, [q.chi2**0.5 for q in mine], places, colour))
            rows += [(split_column(q.sensor)[0], words, q.chi2**0.5, q.rms, q.unit, q.n) for q in mine]
    columns = chart_columns("reading", "records", "RMS, standard deviations", "RMS", "unit", "readings")
    return Chart(
        key,
        "Residual of each reading after identification",
        Axis("RMS of the residual in standard deviations of the noise"),
        Axis("", categories=[split_column(name)[0] for name in names]),
        layers,
        ChartTable(columns, rows),
        "At 1 a reading is reproduced as well as its noise allows.",
        [EventMark(1.0, "noise alone")],
    )


def _all_regimes(qualities: Sequence[SensorQuality]) -> list[SensorQuality]:
    return [q for q in qualities if q.regime == EVERYTHING and q.n]


LIKELY = 0.5
"""Probability from which a parameter is drawn as one that changed."""


def chart_svg(chart: Chart) -> str:
    """The chart as SVG text."""
    return picture(chart).text()


def detection_chart(rows: Iterable[Mapping[str, Any]]) -> Chart:
    """Raises NoVerdictError where nothing was judged."""
    told = [_row(row) for row in rows]
    if not any(row.number("threshold") > 0 for row in told):
        raise NoVerdictError("--picture: no window has a verdict that could be drawn")
    return detection_course("detect", told)


def isolation_chart(windows: Sequence[IsolatedWindow]) -> Chart:
    """The last window in which something was isolated, or the last that was judged. Raises NoVerdictError where no
    statistics hold the sensors."""
    judged = [w for w in windows if w.diagnosis is not None and w.verdict.window.statistics is not None]
    for found in [*reversed([w for w in judged if w.named]), *reversed(judged)]:
        assert found.diagnosis is not None
        result, window = found.diagnosis.result, found.verdict.window
        rivals = [(tuple(r.parameters), r.probability) for r in result.alternatives]
        answers = [(tuple(result.isolated), result.probability), *rivals] if result.isolated else []
        place = RowOrigin(window.source, f"{window.first_line}–{window.last_line}")
        chart = window_fingerprint("isolate", window, place, answers, found.meaning)
        if chart is not None:
            return chart
    raise NoVerdictError("--picture: no window that was judged has statistics with every sensor's error")


LASTING = ("step", "deterioration")
"""Kinds whose course is drawn from the onset to the last flight, where nothing has ended it."""


def trend_chart(series: Series, rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of the first engine in which something changed, else of the first: its health over flights; rows: of `trend`.
    Raises NoVerdictError where no engine has flights."""
    from enginediag_cli.report.tables.trend import flight_rows

    flights = [_row(row) for row in flight_rows(series)]
    if not flights:
        raise NoVerdictError("--picture: no flight has statistics that could be drawn")
    changed = [row for row in rows if row.get("onset") and row.get("parameter") and row["probability"] >= LIKELY]
    engine = str((changed or [flights[0].cells])[0]["engine"])
    mine = [row for row in flights if row.text("engine") == engine]
    of_it = [row for row in changed if row["engine"] == engine]
    names = [str(row["parameter"]) for row in of_it] or list(dict.fromkeys(row.text("parameter") for row in mine))
    _, unit = display_scale(series.parameters[names[0]])
    names = [name for name in names if display_scale(series.parameters[name])[1] == unit]
    one = [row for row in mine if row.text("parameter") == names[0]]
    told = ""
    if of_it:
        windows = [
            (replace(x.window, statistics=x.statistics), RowOrigin(x.window.source, f"{x.window.first_line}"))
            for x in series.stretches[engine]
        ]
        mine, told = conditional_rows(windows, [str(row["parameter"]) for row in of_it]), ALONE
    order, marks = order_windows(one), []
    for row in of_it[:1]:
        low, high = order.number_position(row["onset_low"]), order.number_position(row["onset_high"])
        if low is not None:
            marks.append(EventMark(low, f"onset: {series.parameters[names[0]].part}", high))
    courses = {
        str(row["parameter"]): TrendCourse(
            int(row["onset"]), row["kind"] == "step", row["change"], row["change_low"], row["change_high"]
        )
        for row in of_it
        if row["kind"] in LASTING and row.get("end") is None
    }
    return health_trend("trend", mine, names, series.parameters, marks, caption=told, courses=courses)


def margin_chart(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of the first engine: its margin over flights, with maintenance; rows: of `trend --what margin`. Raises
    NoVerdictError where no flight shows it."""
    told = [_row(row) for row in rows]
    found = read_margin([row for row in told if row.text("engine") == told[0].text("engine")])
    chart = None if found is None else margin_forecast("margin", found, maintenance_marks(found))
    if chart is None:
        raise NoVerdictError("--picture: no flight has a margin that could be drawn")
    return chart


def identification_chart(result: Identification) -> Chart:
    """How well each reading is fitted."""
    return identified_fit("identify", result)


def _row(cells: Mapping[str, Any]) -> Row:
    return Row(cells, RowOrigin(str(cells.get("source", "")), str(cells.get("first_line", cells.get("number", "")))))
