"""Local statistics as flat rows, one value per column, and back; such a file needs nothing else to be read.

Columns: those of the window, `n`, `chi2`, `dof`, `noise_A1`, `noise_A2`, `noise_Q`, `parameters` (what each parameter
is, a JSON list of `Parameter.as_mapping`), then `theta0:a`, `prior_sigma:a`, `s:a` per parameter a, and the upper
triangles `F:a|b` and `V:a|b`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.residuals.pipeline import WindowStatistics
from enginediag_cli.residuals.statistics import LocalStatistics

TEXTS = ("source", "flight", "engine", "reason")
COUNTS = ("first_line", "last_line", "records", "outside", "incomplete", "failed")
TIMES = ("start_s", "end_s")
DOUBT = ("noise_A1", "noise_A2", "noise_Q")
"""How uncertain estimated noise makes the metric and how far it is from Gaussian, see `Score`; a file without these
columns has known, Gaussian noise."""
MEANING = "parameters"
"""What each parameter is: its component, quantity, words, unit and wear are not to be guessed from its name."""
WINDOW_COLUMNS = (
    "source",
    "flight",
    "engine",
    "first_line",
    "last_line",
    "start_s",
    "end_s",
    "records",
    "outside",
    "incomplete",
    "failed",
    "reason",
)


def window_row(window: WindowStatistics) -> dict[str, Any]:
    """The bookkeeping of a window as a row."""
    return {name: getattr(window, name) for name in WINDOW_COLUMNS}


def flat_columns(parameters: Sequence[str]) -> tuple[str, ...]:
    """Columns of a file of statistics of these parameters."""
    pairs = [(a, b) for i, a in enumerate(parameters) for b in parameters[i:]]
    return (
        *WINDOW_COLUMNS,
        "n",
        "chi2",
        "dof",
        *DOUBT,
        MEANING,
        *(f"{what}:{a}" for what in ("theta0", "prior_sigma", "s") for a in parameters),
        *(f"{what}:{a}|{b}" for what in ("F", "V") for a, b in pairs),
    )


def flat_row(window: WindowStatistics) -> dict[str, Any]:
    """One window as a row; a window without verdict has only its bookkeeping."""
    row = window_row(window)
    x = window.statistics
    if x is None:
        return row
    row.update(n=x.n, chi2=x.chi2, dof=x.dof, **dict(zip(DOUBT, x.doubt, strict=True)))
    row[MEANING] = _written(meanings(x.meaning, x.parameters).values())
    for i, a in enumerate(x.parameters):
        row.update(
            {
                f"theta0:{a}": x.theta0[i],
                f"prior_sigma:{a}": x.prior_sigma[i],
                f"s:{a}": x.s[i],
            }
        )
        for k in range(i, len(x.parameters)):
            b = x.parameters[k]
            row.update({f"F:{a}|{b}": x.F[i, k], f"V:{a}|{b}": x.V[i, k]})
    return row


def is_flat(columns: Iterable[str]) -> bool:
    """Whether these are the columns of a file of statistics, not of a recording."""
    return any(column.startswith("s:") for column in columns)


def read_flat(
    rows: Iterable[Mapping[str, str]], source: str, lines: Iterable[int]
) -> Iterator[tuple[WindowStatistics, dict[str, Parameter]]]:
    """Windows and what their parameters are, by name, from rows of texts. DataError names file, line, column."""
    for row, line in zip(rows, lines, strict=True):
        cell = _Cells(row, f"{source}:{line}")
        names = tuple(c.removeprefix("s:") for c in row if c.startswith("s:"))
        statistics = None
        meaning: dict[str, Parameter] = {}
        if row.get("n", "").strip():
            theta0, sigma, s = (
                np.array([cell.number(f"{what}:{a}") for a in names]) for what in ("theta0", "prior_sigma", "s")
            )
            F, V = (cell.matrix(what, names) for what in ("F", "V"))
            A1, A2, Q = (cell.number(c) if c in row else 0.0 for c in DOUBT)
            if not np.all(sigma > 0):
                raise DataError(f"{source}:{line}:prior_sigma: must be positive")
            meaning = cell.meaning(names)
            statistics = LocalStatistics(
                names,
                theta0,
                sigma,
                s,
                F,
                V,
                int(cell.number("n")),
                cell.number("chi2"),
                cell.number("dof"),
                doubt=(A1, A2, Q),
                meaning=meaning,
            )
        values: dict[str, Any] = {c: row.get(c, "") for c in TEXTS}
        values.update({c: int(cell.number(c)) for c in COUNTS})
        values.update({c: cell.number(c) if row.get(c, "").strip() else float("nan") for c in TIMES})
        if statistics is None and not values["reason"]:
            values["reason"] = "the file of statistics gives none for this window"
        yield WindowStatistics(**values, statistics=statistics), meaning


def _written(parameters: Iterable[Parameter]) -> str:
    return json.dumps([p.as_mapping() for p in parameters], ensure_ascii=False, separators=(",", ":"))


@lru_cache(maxsize=16)
def _read_meaning(text: str) -> tuple[Parameter, ...]:
    """Every row of a file says the same; ValueError says what is wrong."""
    try:
        entries = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON: {error}") from None
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError("not a list of parameters")
    found = tuple(Parameter.from_mapping(entry) for entry in entries)
    if len({p.name for p in found}) < len(found):
        raise ValueError("a parameter is described twice")
    return found


def _meaning(text: str, names: Sequence[str], place: str) -> dict[str, Parameter]:
    try:
        found = {p.name: p for p in _read_meaning(text)}
    except ValueError as error:
        raise DataError(f"{place}: {error}") from None
    absent = [name for name in names if name not in found]
    if absent:
        raise DataError(f"{place}: does not say what {absent[0]!r} is")
    return {name: found[name] for name in names}


class _Cells:
    """Numbers of one row, with a place to name when one is wrong."""

    def __init__(self, row: Mapping[str, str], place: str):
        self._row, self._place = row, place

    def number(self, column: str) -> float:
        text = self._row.get(column)
        if text is None:
            raise DataError(f"{self._place}: missing column {column}")
        try:
            value = float(text)
        except ValueError:
            raise DataError(f"{self._place}:{column}: not a number: {text!r}") from None
        if not np.isfinite(value):
            raise DataError(f"{self._place}:{column}: not a finite number: {text!r}")
        return value

    def meaning(self, names: Sequence[str]) -> dict[str, Parameter]:
        """What the parameters of these names are."""
        text = self._row.get(MEANING)
        if text is None:
            raise DataError(
                f"{self._place}: missing column {MEANING}: what each parameter is; write it with `residual`"
            )
        return _meaning(text, names, f"{self._place}:{MEANING}")

    def matrix(self, what: str, names: Sequence[str]) -> np.ndarray:
        full = np.zeros((len(names), len(names)))
        for i, a in enumerate(names):
            for k in range(i, len(names)):
                full[i, k] = full[k, i] = self.number(f"{what}:{a}|{names[k]}")
        return full
