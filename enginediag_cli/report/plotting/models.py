"""Charts of a model: its fit by reading, where it differs (location × driver), corrections with bands, and refinements.

Also the charts that `--picture` of `detect`, `isolate`, `trend` and `identify` writes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.evaluation import P_ISA, T_ISA
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.identification.nominal import EVERYTHING, SensorQuality
from enginediag_cli.parameters import Parameter, spelled
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
    from enginediag_cli.history.engines import EngineTrend
    from enginediag_cli.identification.identify import Identification
    from enginediag_cli.isolation.windows import IsolatedWindow
    from enginediag_cli.residuals.monitor import Monitor
    from enginediag_cli.residuals.windows import WindowStatistics


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


@dataclass(frozen=True)
class OperatingMap:
    """The map of a compressor with the points flown: corrected flow [kg/s] and pressure ratio of the nominal engine, of
    the engine as found, along speed lines (by their names) and of surge, None where the engine file has no line."""

    component: str
    nominal: tuple[np.ndarray, np.ndarray]
    found: tuple[np.ndarray, np.ndarray]
    lines: Mapping[str, tuple[np.ndarray, np.ndarray]]
    surge: tuple[np.ndarray, np.ndarray] | None = None


FLOWN_FLIGHTS, MOST_SPEEDS = 10, 7
"""Last flights whose points are drawn on a map; and speed lines of it."""


def operating_maps(
    monitor: Monitor, windows: Sequence[WindowStatistics], change: Mapping[str, float]
) -> list[OperatingMap]:
    """Of each compressor, from a few records of the last flights; change: of parameters, in their units. None of an
    engine whose network is not known."""
    engine: Any = monitor.engine
    network = getattr(engine, "network", None)
    flown = [w.sample_inputs for w in windows[-FLOWN_FLIGHTS:] if w.sample_inputs]
    compressors = [c for c in network.components if isinstance(c, Compressor)] if network is not None else []
    if network is None or not flown or not compressors:
        return []
    inputs = {c: np.concatenate([one[c] for one in flown]) for c in flown[0]}
    columns = [column for c in compressors for column in _map_columns(c)]
    base = {name: value for name, value in monitor.base.items() if name in engine.parameters}
    moved = {name: base.get(name, engine.parameters[name].nominal) + x for name, x in change.items() if x}
    moved = {name: x for name, x in moved.items() if not engine.parameters[name].belongs_to_instrument}
    states = []
    for parameters in (base, {**base, **moved}):
        values = dict(zip(columns, engine.predict(inputs, parameters, sensors=columns).y.T, strict=True))
        states.append([_map_point(c, values) for c in compressors])
    return [
        OperatingMap(spelled(c.name), nominal, found, _speed_lines(c, network.gas, speed), c.surge_points())
        for c, (*nominal_point, speed), (*found_point, _) in zip(compressors, *states, strict=True)
        for nominal, found in [((nominal_point[0], nominal_point[1]), (found_point[0], found_point[1]))]
        if np.isfinite(speed).any()
    ]


def _map_columns(c: Compressor) -> tuple[str, ...]:
    station = c.values["from"]
    named = (f"{c.name}_pressure_ratio", f"{c.name}_corrected_rpm")
    return (f"W{station}_kg_s", f"T{station}_K", f"P{station}_Pa", *named)


def _map_point(c: Compressor, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corrected flow, pressure ratio and corrected speed in shares of the design's."""
    W, T, P, ratio, rpm = (values[column] for column in _map_columns(c))
    return W * np.sqrt(T / T_ISA) / (P / P_ISA), ratio, rpm / (c.speed_scale * c.design_map_speed)


def _speed_lines(c: Compressor, gas: Any, speed: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    low, high = np.nanmin(speed), np.nanmax(speed)
    step = next(s for s in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if (high - low) / s <= MOST_SPEEDS - 2)
    first, last = math.floor(low / step), math.ceil(high / step)
    return {f"{100 * k * step:.0f} %": c.speed_line(gas, k * step) for k in range(first, last + 1)}


def operating_line(key: str, found: OperatingMap) -> Chart:
    """Points flown on the map of a compressor."""
    layers: list[Layer] = [Line("", x.tolist(), y.tolist(), quiet=True) for x, y in found.lines.values()]
    if found.surge is not None:
        layers.append(Line("surge", found.surge[0].tolist(), found.surge[1].tolist(), 1))
    layers.append(Points("nominal engine", found.nominal[0].tolist(), found.nominal[1].tolist(), 0))
    if not np.allclose(found.nominal[1], found.found[1], equal_nan=True):
        layers.append(Points("engine as found", found.found[0].tolist(), found.found[1].tolist(), 1))
    speeds = list(found.lines)
    names = f"{speeds[0]} to {speeds[-1]}" if speeds else ""
    rows = list(zip(*(v.tolist() for v in (*found.nominal, *found.found)), strict=True))
    columns = chart_columns(
        ("corrected flow, nominal engine", "kg/s"),
        "pressure ratio, nominal engine",
        ("corrected flow, engine as found", "kg/s"),
        "pressure ratio, engine as found",
    )
    return Chart(
        key,
        f"Operating line of the {found.component}",
        Axis("corrected flow", "kg/s"),
        Axis("pressure ratio"),
        layers,
        ChartTable(columns, rows),
        f"Points of the last flights on the map; thin lines: corrected speed from {names} of the design's.",
    )


def isolability(key: str, window: WindowStatistics, origin: RowOrigin, known: Mapping[str, Parameter]) -> Chart | None:
    """How far one window separates a plausible change of one suspect from all that another could imitate it by; None
    without statistics.

    d: change by one prior standard deviation of each parameter, in the direction of wear; S_ij = J_ii − J_ij J_jj⁺ J_ji
    with the information J; shown is (dᵀ S_ij d)^½, standard errors.
    """
    statistics = window.statistics
    if statistics is None:
        return None
    names = [name for name in statistics.parameters if name in known]
    owners: dict[str, list[int]] = {}
    for name in names:
        owners.setdefault(known[name].component, []).append(statistics.parameters.index(name))
    scale = statistics.prior_sigma
    F = statistics.F * scale * scale[:, None]
    J = F @ np.linalg.pinv(statistics.V * scale * scale[:, None], hermitian=True) @ F
    words = [known[statistics.parameters[at[0]]].part or owner for owner, at in owners.items()]
    x, y, value, rows = [], [], [], []
    for i, mine in enumerate(owners.values()):
        d = np.array([float(known[statistics.parameters[k]].wear or 1) for k in mine])
        if known[statistics.parameters[mine[0]]].belongs_to_instrument:
            d[1:] = 0.0  # an instrument is wrong in one form
        for j, other in enumerate(owners.values()):
            if i == j:
                continue
            cross = J[np.ix_(mine, other)]
            S = J[np.ix_(mine, mine)] - cross @ np.linalg.pinv(J[np.ix_(other, other)], hermitian=True) @ cross.T
            x.append(j)
            y.append(i)
            value.append(float(np.sqrt(max(d @ S @ d, 0.0))))
            rows.append((words[i], words[j], value[-1]))
    if not value:
        return None
    label = f"flight {window.flight}" if window.flight else window.source
    return Chart(
        key,
        "Isolability",
        Axis("mistaken for", categories=words),
        Axis("", categories=words),
        [
            HeatCells(
                "standard errors between them",
                x,
                y,
                value,
                SEPARATE,
                [f"{v:.0f}" if v < SEPARATE else "" for v in value],
                origins=[origin] * len(x),
            )
        ],
        ChartTable(chart_columns("suspect", "mistaken for", "standard errors between them"), rows, [origin] * len(x)),
        f"How far {label} alone separates a plausible change of a row's suspect from everything that the column's "
        "could do. Below 2 they are indistinguishable; n flights like it separate them by √n times as much.",
    )


SEPARATE = 10.0
"""Standard errors from which two suspects are far apart."""
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


def trend_chart(series: Series, rows: Sequence[Mapping[str, Any]], histories: Mapping[str, EngineTrend]) -> Chart:
    """Of the first engine in which something changed, else of the first: its health over flights; rows: of `trend`;
    histories: engine → what is known of it. Raises NoVerdictError where no engine has flights."""
    from enginediag_cli.report.tables.trend import flight_rows

    flights = [_row(row) for row in flight_rows(series, histories)]
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
    levels, shown = mine, ""
    if of_it:
        windows = [
            (replace(x.window, statistics=x.statistics), RowOrigin(x.window.source, f"{x.window.first_line}"))
            for x in series.stretches[engine]
        ]
        mine, shown = conditional_rows(windows, [str(row["parameter"]) for row in of_it]), ALONE
    order, marks = order_windows(one), []
    for row in of_it[:1]:
        low, high = order.number_position(row["onset_low"]), order.number_position(row["onset_high"])
        if low is not None:
            marks.append(EventMark(low, f"onset: {series.parameters[names[0]].part}", high))
    return health_trend("trend", mine, names, series.parameters, marks, caption=shown, levels=levels)


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
