"""Raw deltas as engine monitoring shows them: readings minus what the nominal engine reads at the same power setting.

The mean over a flight's records, from its statistics about nominal, S the biases of its sensors:

    e = F_SS⁻¹ s_S,      Cov e = F_SS⁻¹ V_SS F_SS⁻¹

so that nothing is estimated but means: no suspects, no prior. The power setting is the input that sets the power, or a
reading a that is held instead. With L what one unit of error of that input does to the readings,

    x = e_a / L_a,       e' = e − L x

x is then the delta of the input itself: the fuel that the engine needs beyond nominal at equal N1.

Smoothed deltas are exponentially weighted means, weight of a flight (1 − α)^age, α = 2/(n + 1), n `smoothing_flights`,
that begin anew after maintenance. Their standard error counts how much flights scatter, by the differences of
neighbours, where that is more than the noise of their means. Levels are compared with smoothed deltas.

Such trend monitoring: SAE AIR1873, Guide to Limited Engine Monitoring Systems for Aircraft Gas Turbine Engines. Limits
are the operator's or the manufacturer's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section, near
from enginediag_cli.config.validate import load_checked
from enginediag_cli.detection.series import FlightWindow, Series
from enginediag_cli.engine.instrument_errors import InputError
from enginediag_cli.errors import ConfigError, DataError, Problem
from enginediag_cli.units import DAY_S, is_date, split_column

SMOOTHING_FLIGHTS = 5
"""Flights of an even mean that scatters as much: of the usual weights, 0.1 to 0.3 of the newest flight, the upper."""
MEDIAN = 0.455
"""Median of the square of a standard normal variable."""
FEWEST_DIFFERENCES = 4
"""Differences of neighbours from which their median is taken for a scatter."""
WARNING, CAUTION = "warning", "caution"
SIDES = (
    (WARNING, "warning_high", 1.0),
    (WARNING, "warning_low", -1.0),
    (CAUTION, "caution_high", 1.0),
    (CAUTION, "caution_low", -1.0),
)
"""Level, its key, and on which side of it the delta is then."""


def _limit(level: str, side: str) -> Field:
    return Field(f"{level}_{side}", "number", f"{level} where the smoothed delta is {side}er, in the shown unit", None)


DELTA_ALERT = Section(
    "delta",
    "levels of one delta, in the shown unit: °C for temperatures in K, else % of what the nominal engine reads",
    (
        Field("name", "text", "what the delta is called, such as EGT; its column's quantity where absent", ""),
        *(_limit(level, side) for level in (CAUTION, WARNING) for side in ("high", "low")),
        Field("flights", "integer", "flights in a row for which it must last", 1, minimum=1),
        Field("days", "number", "days for which it must last, where recordings have dates", 0.0, minimum=0.0),
    ),
)

ALERTS_FILE = Section(
    "alerts",
    "alert levels of deltas",
    (
        Field("kind", "choice", "kind of file", "alerts", choices=("alerts",)),
        Field("description", "text", "what these levels are for", ""),
        Field("sources", "texts", "where they come from", ()),
        Field(
            "setting",
            "text",
            "power setting at which deltas are compared: a reading, such as N1_rpm; the engine's own where absent",
            "",
        ),
        Field(
            "smoothing_flights",
            "number",
            "flights of an even mean that scatters as much as the smoothed delta",
            float(SMOOTHING_FLIGHTS),
            minimum=1.0,
        ),
        Field(
            "deltas", "section_map", "levels by column, in the order in which they are drawn", {}, section=DELTA_ALERT
        ),
    ),
)


@dataclass(frozen=True)
class DeltaAlerts:
    """levels: column → values of its section `DELTA_ALERT`, in the shown unit; setting: power setting that is held, ""
    for the engine's own; smoothing_flights: of an even mean that scatters as much."""

    levels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    setting: str = ""
    smoothing_flights: float = SMOOTHING_FLIGHTS


def load_alerts(path: str | Path) -> DeltaAlerts:
    """Read a file of alert levels.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    DeltaAlerts

    Raises
    ------
    ConfigError
        For anything wrong in the file, with its line and column.
    """
    checked = load_checked(path, "alerts")
    values = checked.values
    problems = []
    for column, level in values["deltas"].items():
        for side, sign in (("high", 1.0), ("low", -1.0)):
            first, second = level[f"{CAUTION}_{side}"], level[f"{WARNING}_{side}"]
            if first is not None and second is not None and sign * (second - first) < 0:
                what = f"{column}: the warning, {second:g}, comes before the caution, {first:g}"
                problems.append(Problem(checked.mark(("deltas", column)), what, "a warning is the farther level"))
        if all(level[key] is None for _, key, _ in SIDES):
            what = f"{column}: no level; give one of {', '.join(key for _, key, _ in SIDES)}"
            problems.append(Problem(checked.mark(("deltas", column)), what))
    if problems:
        raise ConfigError(problems)
    return DeltaAlerts(values["deltas"], values["setting"], values["smoothing_flights"])


@dataclass(frozen=True)
class FlightDeltas:
    """Deltas of one engine, T flights and m columns: `delta`, standard `error` of the mean over the flight, `smoothed`,
    `smoothed_error` (T, m), NaN where there is no reading; all in the units (m,), which are °C or % as shown. names
    (m,): what the deltas are called; level (T, m): "", caution or warning; since (T, m): number, from 1, of the flight
    from which on it has been at that level, 0 without; events: numbers of first flights after maintenance; dates (T,):
    seconds since 1970, None where times are no dates; levels: of columns, as `DeltaAlerts` has them."""

    engine: str
    stretches: Sequence[FlightWindow]
    columns: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    delta: np.ndarray
    error: np.ndarray
    smoothed: np.ndarray
    smoothed_error: np.ndarray
    level: np.ndarray
    since: np.ndarray
    setting: str
    smoothing_flights: float
    events: tuple[int, ...] = ()
    dates: np.ndarray | None = None
    levels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.delta)


def flight_deltas(
    series: Series,
    engine: str,
    alerts: DeltaAlerts | None = None,
    *,
    reference: int = 0,
    events: Sequence[int] = (),
) -> FlightDeltas:
    """Deltas of an engine over its flights, smoothed and compared with alert levels.

    Parameters
    ----------
    series : Series
        With statistics about nominal, errors of instruments among the parameters.
    engine : str
    alerts : DeltaAlerts, optional
        Levels, the power setting and the smoothing.
    reference : int
        First records of the engine; deltas are counted from the mean of the flights within these; 0: from nominal.
    events : sequence of int
        Numbers, from 1, of first flights after maintenance.

    Returns
    -------
    FlightDeltas

    Raises
    ------
    DataError
        Where statistics hold no errors of sensors, and for a power setting or column that is not recorded.
    """
    alerts = alerts or DeltaAlerts()
    stretches = series.stretches[engine]
    columns, e, C, read = _mean_residuals(series, stretches)
    if alerts.setting:
        columns, e, C, read = _hold_reading(series, stretches, alerts.setting, columns, e, C, read)
    _check_columns(alerts, columns)
    factor, units = _display_factors(columns, e, read)
    delta, error = e * factor, np.sqrt(np.einsum("tii->ti", C)) * factor
    healthy = series.healthy(engine, reference) if reference else 0
    if healthy:
        delta = delta - np.nanmean(delta[:healthy], axis=0)
    smoothed, smoothed_error = _smooth(delta, error, alerts.smoothing_flights, events)
    dates = _dates(stretches)
    level, since = _levels(columns, smoothed, alerts.levels, dates)
    names = tuple(alerts.levels.get(c, {}).get("name") or split_column(c)[0] for c in columns)
    return FlightDeltas(
        engine,
        stretches,
        columns,
        names,
        units,
        delta,
        error,
        smoothed,
        smoothed_error,
        level,
        since,
        alerts.setting or next(iter(series.power_inputs), ""),
        alerts.smoothing_flights,
        tuple(events),
        dates,
        alerts.levels,
    )


def _input_errors(series: Series) -> Sequence[InputError]:
    """Errors of inputs, of each its usual form first."""
    return tuple(getattr(series.monitor.engine, "errors", {}).values()) if series.monitor is not None else ()


def _sensor_biases(series: Series) -> dict[str, str]:
    """Column → name of the bias of its sensor."""
    monitor = series.monitor
    if monitor is None:
        raise DataError("deltas need --nominal: the engine predicts what is read at the same power setting")
    found = {}
    for column in monitor.sensors:
        own = [p.name for p in monitor.engine.sensors[column].parameters() if p.quantity == "bias"]
        if own and own[0] in series.parameters:
            found[column] = own[0]
    if not found:
        raise DataError("deltas need the errors of sensors among the parameters: leave out --monitor")
    return found


Residuals = tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]
"""Columns (m,), mean residuals (T, m), their covariance (T, m, m), and mean readings (T, m), NaN where not known."""


def _mean_residuals(series: Series, stretches: Sequence[FlightWindow]) -> Residuals:
    """In the columns' units."""
    biases = _sensor_biases(series)
    columns = tuple(biases)
    m = len(columns)
    e, C = np.full((len(stretches), m), np.nan), np.full((len(stretches), m, m), np.nan)
    for t, stretch in enumerate(stretches):
        F, _, seen, rows = _readings_part(stretch, biases.values())
        if len(seen):
            gain = np.linalg.inv(F)
            e[t, seen] = gain @ stretch.statistics.s[rows]
            C[t, seen[:, None], seen] = gain @ stretch.statistics.V[np.ix_(rows, rows)] @ gain
    read = np.array([[x.window.readings.get(c, np.nan) for c in columns] for x in stretches])
    return columns, e, C, read


def _readings_part(stretch: FlightWindow, biases: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """F_SS (k, k) and F_S· (k, p) of the sensors that were read, which of all these are (k,), and their rows."""
    statistics = stretch.statistics
    own = np.diag(statistics.F)
    place = {name: i for i, name in enumerate(statistics.parameters)}
    named = [(j, place[name]) for j, name in enumerate(biases) if name in place]
    read = [(j, i) for j, i in named if own[i] > 0]
    seen, rows = (np.array(x, int) for x in (zip(*read, strict=True) if read else ((), ())))
    return statistics.F[np.ix_(rows, rows)], statistics.F[rows], seen, rows


def _hold_reading(
    series: Series,
    stretches: Sequence[FlightWindow],
    setting: str,
    columns: tuple[str, ...],
    e: np.ndarray,
    C: np.ndarray,
    read: np.ndarray,
) -> Residuals:
    """The same at equal reading `setting`: its delta gives way to that of the input that sets the power."""
    power = next(iter(series.power_inputs), "")
    error = next((x for x in _input_errors(series) if x.column == power), None)
    if setting == power:
        return columns, e, C, read
    if setting not in columns:
        raise DataError(f"--setting: no reading {setting!r} is used; {near(setting, (power, *columns))}")
    if error is None:
        raise DataError(f"--setting: the error of {power or 'the input that sets the power'} is no parameter here")
    a, biases = columns.index(setting), _sensor_biases(series).values()
    out = np.full_like(e, np.nan)
    covariance = np.full_like(C, np.nan)
    for t, stretch in enumerate(stretches):
        F, rows, seen, _ = _readings_part(stretch, biases)
        names = stretch.statistics.parameters
        if a not in seen or error.parameter.name not in names:
            continue
        L = np.zeros(len(columns))
        L[seen] = np.linalg.solve(F, rows[:, names.index(error.parameter.name)])
        T = np.eye(len(columns))
        T[:, a] -= L / L[a]
        T[a] = 0.0
        T[a, a] = 1.0 / L[a]  # the place of the reading is that of the input
        kept = np.ix_(seen, seen)
        out[t, seen] = T[kept] @ e[t, seen]
        covariance[t, seen[:, None], seen] = T[kept] @ C[t][kept] @ T[kept].T
    level = np.array([x.window.conditions.get(power, np.nan) for x in stretches])
    if error.multiplies:  # a share of what is read
        out[:, a] *= level
        covariance[:, a] *= level[:, None]
        covariance[:, :, a] *= level[:, None]
    read = read.copy()
    read[:, a] = level
    return (*columns[:a], power, *columns[a + 1 :]), out, covariance, read


def _check_columns(alerts: DeltaAlerts, columns: Sequence[str]) -> None:
    for column in alerts.levels:
        if column not in columns:
            raise DataError(f"alert levels of {column!r}, of which there is no delta; {near(column, columns)}")


def _display_factors(columns: Sequence[str], e: np.ndarray, read: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Factors (T, m) to the shown unit: °C of temperatures in K, else % of what the nominal engine reads."""
    factor, units = np.ones_like(e), []
    for j, column in enumerate(columns):
        unit = split_column(column)[1]
        nominal = read[:, j] - e[:, j]
        if unit != "K" and np.all(np.abs(nominal[np.isfinite(e[:, j])]) > 0):
            factor[:, j] = 100.0 / np.abs(nominal)
            units.append("%")
        else:
            units.append("°C" if unit == "K" else unit)
    return factor, tuple(units)


def _smooth(
    delta: np.ndarray, error: np.ndarray, flights: float, events: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means (T, m) with their standard errors, begun anew at events."""
    keep = 1.0 - 2.0 / (flights + 1.0)
    step = np.diff(delta, axis=0)
    enough = np.isfinite(step).sum(axis=0) >= FEWEST_DIFFERENCES
    scatter = np.zeros(delta.shape[1])
    scatter[enough] = np.nanmedian(step[:, enough] ** 2, axis=0) / (2 * MEDIAN)
    variance = np.maximum(error**2, scatter)
    total = squares = weight = np.zeros(delta.shape[1])
    mean, deviation = np.full_like(delta, np.nan), np.full_like(delta, np.nan)
    for t in range(len(delta)):
        decay = 0.0 if t + 1 in events else keep
        seen = np.isfinite(delta[t])
        total = decay * total + np.where(seen, delta[t], 0.0)
        squares = decay**2 * squares + np.where(seen, variance[t], 0.0)
        weight = decay * weight + seen
        known = weight > 0
        mean[t, known] = total[known] / weight[known]
        deviation[t, known] = np.sqrt(squares[known]) / weight[known]
    return mean, deviation


def _dates(stretches: Sequence[FlightWindow]) -> np.ndarray | None:
    """When each flight began, in seconds since 1970; None unless all recordings count from there."""
    start = np.array([x.window.start_s for x in stretches])
    return start if all(map(is_date, start)) else None


def _levels(
    columns: Sequence[str], smoothed: np.ndarray, levels: Mapping[str, Mapping[str, Any]], dates: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Level (T, m) of each smoothed delta, and since which flight, from 1, it has been beyond it; 0 without."""
    level, since = np.full(smoothed.shape, "", dtype=object), np.zeros(smoothed.shape, int)
    for column, own in levels.items():
        if own["days"] > 0 and dates is None:
            raise DataError(f"{column}: an alert after {own['days']:g} days needs dates, and the recordings show none")
        j = columns.index(column)
        for name, key, sign in SIDES:
            if own[key] is None:
                continue
            beyond = sign * (np.nan_to_num(smoothed[:, j], nan=-sign * np.inf) - own[key]) > 0
            first = 0
            for t in range(len(beyond)):
                if not beyond[t]:
                    first = t + 1
                    continue
                lasted = t - first + 1 >= own["flights"]
                lasted &= own["days"] == 0 or (dates is not None and dates[t] - dates[first] >= own["days"] * DAY_S)
                if lasted and not level[t, j]:
                    level[t, j], since[t, j] = name, first + 1
    return level, since
