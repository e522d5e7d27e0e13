"""Local statistics as flat rows, one value per column, and back; such a file needs nothing else to be read.

Columns: those of the window, `n`, `chi2`, `dof`, `noise_A1`, `noise_A2`, `noise_Q`, `parameters` (what each parameter
is, a JSON list of `Parameter.as_mapping`), `conditions` (mean of each input over the records that were judged, a JSON
mapping), then `theta0:a`, `prior_sigma:a`, `s:a` per monitored parameter a, and the upper triangles `F:a|b`, `V:a|b`
and `slopes:a|b`. What is uncertain beside these is described in `nuisance`, a JSON mapping: `common`, how many unit
normals `nominal.1` … all windows share, and `own`, name -> standard deviation of what each recording has anew. With k
of them, and a monitored parameters, `nuisance:1` … hold s (k,), F (a, k), the upper triangle of F (k, k), V (a, k) and
the upper triangle of V (k, k), row by row: one text in base 64 of little-endian float64, cut into cells that begin
with `f8:`. All of these but `slopes` add, see `files.py`.

A row is bound to how it was made by hashes of the nominal and the settings, and by a checksum of the row itself.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import isnan
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter, meanings
from enginediag_cli.residuals.statistics import LocalStatistics, range_space
from enginediag_cli.residuals.windows import Extrapolation, WindowPlan, WindowStatistics
from enginediag_cli.safe_text import UNSPEAKABLE

TEXTS = ("source", "flight", "engine", "reason")
COUNTS = ("first_line", "last_line", "records", "outside", "incomplete", "failed", "sensors", "sensors_of")
SILENT = "silent"
"""Column that lists the monitored errors of sensors that gave no reading."""
MOST = 2**53
"""Counts are whole numbers up to this: beyond it a number no longer distinguishes neighbours."""
LARGEST_VARIANCE = 1e9
"""Between this and its inverse lies the variance of s in units of its information F: noise that is correlated from
record to record multiplies it by hundreds, and the uncertainty of nominal has been put into F by then."""
LARGEST_INFORMATION = 1e30
"""In prior standard deviations, squared: a million records of readings a million times finer than a change."""
NEGLIGIBLE = 1e-6
"""Share of the largest eigenvalue by which rounding may make a covariance negative; rank is judged far more finely."""
TIMES = ("start_s", "end_s")
DOUBT = ("noise_A1", "noise_A2", "noise_Q")
"""How uncertain estimated noise makes the metric and how far it is from Gaussian, see `Score`; a file without these
columns has known, Gaussian noise."""
SLOPES = "slopes"
"""Covariance that wrong slopes of the maps add to a change of the parameters; a file without these columns has none."""
MEANING = "parameters"
"""What each parameter is: its component, quantity, words, unit and wear are not to be guessed from its name."""
NUISANCE = "nuisance"
"""What is uncertain beside the monitored parameters and has not been marginalised; empty: nothing is left."""
CELL = 100_000
"""Characters of a cell: readers of CSV refuse cells of more than 131,072."""
MARK = "f8:"
"""Begins a cell of numbers, which would else begin as a formula now and then."""
CONDITIONS = "conditions"
"""What was flown, by which a series of windows is separated from the weather; a file without this column does not
say."""
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
    "sensors",
    "sensors_of",
    "extrapolated",
    "reason",
)


def window_row(window: WindowStatistics) -> dict[str, Any]:
    """The bookkeeping of a window as a row."""
    return {name: getattr(window, name) for name in WINDOW_COLUMNS}


def flat_columns(parameters: Sequence[str], nuisance: int = 0) -> tuple[str, ...]:
    """Columns of a file of statistics of these monitored parameters, and of so many that are uncertain beside them."""
    numbers = nuisance + 2 * (len(parameters) * nuisance + nuisance * (nuisance + 1) // 2)
    cells = -(-(-(-8 * numbers // 3) * 4) // CELL)  # three bytes are four characters
    pairs = [(a, b) for i, a in enumerate(parameters) for b in parameters[i:]]
    return (
        *WINDOW_COLUMNS,
        SILENT,
        "n",
        "chi2",
        "dof",
        *DOUBT,
        MEANING,
        CONDITIONS,
        NUISANCE,
        *(f"{NUISANCE}:{i + 1}" for i in range(cells)),
        *(f"{what}:{a}" for what in ("theta0", "prior_sigma", "s") for a in parameters),
        *(f"{what}:{a}|{b}" for what in ("F", "V", SLOPES) for a, b in pairs),
    )


def flat_row(window: WindowStatistics) -> dict[str, Any]:
    """One window as a row; a window without verdict has only its bookkeeping."""
    row = window_row(window)
    x = window.statistics
    if x is None:
        return row
    row[SILENT] = list(window.silent)
    row.update(n=x.n, chi2=x.chi2, dof=x.dof, **dict(zip(DOUBT, x.doubt, strict=True)))
    row[MEANING] = _write_parameters(meanings(x.meaning, x.monitored).values())
    row[CONDITIONS] = json.dumps(dict(window.conditions), ensure_ascii=False, separators=(",", ":"))
    row.update(_nuisance_cells(x))
    names = x.monitored
    for i, a in enumerate(names):
        row.update({f"theta0:{a}": x.theta0[i], f"prior_sigma:{a}": x.prior_sigma[i], f"s:{a}": x.s[i]})
        for k in range(i, len(names)):
            b = names[k]
            row.update({f"F:{a}|{b}": x.F[i, k], f"V:{a}|{b}": x.V[i, k]})
            row[f"{SLOPES}:{a}|{b}"] = 0.0 if x.slopes is None else x.slopes[i, k]
    return row


def _nuisance_cells(x: LocalStatistics) -> dict[str, str]:
    """What is uncertain beside the monitored parameters, which come first, as cells."""
    if not x.additive:
        return {}
    k = len(x.common) + len(x.own)
    a = len(x.parameters) - k
    upper = np.triu_indices(k)
    parts = [x.s[a:], *(part for M in (x.F, x.V) for part in (M[:a, a:].ravel(), M[a:, a:][upper]))]
    text = base64.b64encode(np.concatenate(parts).astype("<f8").tobytes()).decode("ascii")
    own = dict(zip(x.own, x.prior_sigma[len(x.parameters) - len(x.own) :].tolist(), strict=True))
    described = json.dumps({"common": len(x.common), "own": own}, ensure_ascii=False, separators=(",", ":"))
    cells = {f"{NUISANCE}:{i // CELL + 1}": MARK + text[i : i + CELL] for i in range(0, len(text), CELL)}
    return {NUISANCE: described, **cells}


def is_flat(columns: Iterable[str]) -> bool:
    """Whether these are the columns of a file of statistics, not of a recording."""
    return any(column.startswith("s:") for column in columns)


def read_flat(
    rows: Iterable[Mapping[str, str]], source: str, lines: Iterable[int]
) -> Iterator[tuple[WindowStatistics, dict[str, Parameter]]]:
    """Windows and what their parameters are, by name, from rows of texts. DataError names file, line, column."""
    for row, line in zip(rows, lines, strict=True):
        cell = _StatisticsRow(row, f"{source}:{line}")
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
                a = names[int(np.argmax(~(sigma > 0)))]
                raise DataError(f"{source}:{line}:prior_sigma:{a}: must be positive")
            if not names:
                raise DataError(f"{source}:{line}: statistics of no parameter")
            slopes = cell.matrix(SLOPES, names) if f"{SLOPES}:{names[0]}|{names[0]}" in row else np.zeros_like(F)
            if np.any(np.diag(slopes) < 0):
                a = names[int(np.argmax(np.diag(slopes) < 0))]
                raise DataError(f"{source}:{line}:{SLOPES}:{a}|{a}: must not be negative")
            meaning = cell.meaning(names)
            statistics = LocalStatistics(
                parameters=names,
                theta0=theta0,
                prior_sigma=sigma,
                s=s,
                F=F,
                V=V,
                n=cell.count("n", least=1),
                chi2=cell.number("chi2"),
                dof=cell.number("dof", positive=True),
                doubt=(A1, A2, Q),
                meaning=meaning,
                slopes=slopes if slopes.any() else None,
            )
            statistics = cell.read_nuisance(statistics)
            _check_physical(statistics, f"{source}:{line}")
        values: dict[str, Any] = {c: row.get(c, "") for c in TEXTS}
        values.update({c: cell.count(c) for c in COUNTS})
        _check_counts(values, statistics, f"{source}:{line}")
        judged_elsewhere = cell.count("extrapolated") if "extrapolated" in row else 0
        values["extrapolation"] = Counter({Extrapolation("", True): judged_elsewhere} if judged_elsewhere else {})
        values[CONDITIONS] = cell.conditions()
        values[SILENT] = tuple(name for name in row.get(SILENT, "").split("; ") if name)
        values.update({c: cell.number(c) if row.get(c, "").strip() else float("nan") for c in TIMES})
        if statistics is None and not values["reason"]:
            values["reason"] = "the file of statistics gives none for this window"
        yield WindowStatistics(**values, statistics=statistics), meaning


def _write_parameters(parameters: Iterable[Parameter]) -> str:
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


def _check_counts(values: Mapping[str, Any], statistics: LocalStatistics | None, place: str) -> None:
    """DataError for counts that contradict each other."""
    judged = statistics.n if statistics is not None else 0
    if judged + values["outside"] + values["incomplete"] > values["records"]:
        raise DataError(f"{place}:records: fewer than were judged, outside and incomplete together")
    if values["sensors"] > values["sensors_of"]:
        raise DataError(f"{place}:sensors: more than the {values['sensors_of']} that there are")


def _check_physical(x: LocalStatistics, place: str) -> None:
    """DataError for matrices that no records give: information F that is negative somewhere, a covariance V of s that
    is not one or has nothing to do with F, and statistics that F cannot have."""
    D = x.prior_sigma
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = {"F": D[:, None] * x.F * D, "V": D[:, None] * x.V * D}
        sizes = {"s": D * x.s, **scaled}
    for what, values in sizes.items():
        if not np.all(np.abs(values) < LARGEST_INFORMATION):
            i = int(np.argmax(~(np.abs(values) < LARGEST_INFORMATION)))
            raise DataError(f"{place}:{_column_name(what, x.parameters, i)}: too large to be that of any records")
    for what, matrix in scaled.items():
        if np.any(np.diag(matrix) < 0):
            i = int(np.argmax(np.diag(matrix) < 0))
            raise DataError(f"{place}:{what}:{x.parameters[i]}|{x.parameters[i]}: must not be negative")
        eigenvalues = np.linalg.eigvalsh(matrix)
        if eigenvalues[0] < -NEGLIGIBLE * max(eigenvalues[-1], 0.0):
            raise DataError(f"{place}:{what}: not positive semi-definite, and so not that of any records")
    space = range_space(x.F, D)
    half = (space.basis / np.sqrt(space.eigenvalues)).T
    variance = np.linalg.eigvalsh(half @ scaled["V"] @ half.T) if space.rank else np.ones(1)
    if not (variance[0] > 1 / LARGEST_VARIANCE and variance[-1] < LARGEST_VARIANCE):
        raise DataError(f"{place}:V: not the covariance of statistics whose information is F")
    if x.chi2 < -NEGLIGIBLE * x.dof or x.doubt[0] < 0 or x.doubt[1] < 0:
        column = "chi2" if x.chi2 < 0 else DOUBT[0] if x.doubt[0] < 0 else DOUBT[1]
        raise DataError(f"{place}:{column}: must not be negative")


def _column_name(what: str, parameters: Sequence[str], i: int) -> str:
    """The column of the i-th entry of a vector or matrix."""
    if what == "s":
        return f"s:{parameters[i]}"
    a, b = sorted(divmod(i, len(parameters)))
    return f"{what}:{parameters[a]}|{parameters[b]}"


class _StatisticsRow:
    """Numbers of one row, with a place to name when one is wrong."""

    def __init__(self, row: Mapping[str, str], place: str):
        self._row, self._place = row, place

    def count(self, column: str, least: int = 0) -> int:
        value = self.number(column)
        if not (least <= value <= MOST and value == int(value)):
            raise DataError(f"{self._place}:{column}: not a whole number from {least} on: {self._row[column]!r}")
        return int(value)

    def number(self, column: str, *, positive: bool = False) -> float:
        text = self._row.get(column)
        if text is None:
            raise DataError(f"{self._place}: missing column {column}")
        try:
            value = float(text)
        except ValueError:
            raise DataError(f"{self._place}:{column}: not a number: {text!r}") from None
        if not np.isfinite(value):
            raise DataError(f"{self._place}:{column}: not a finite number: {text!r}")
        if positive and not value > 0:
            raise DataError(f"{self._place}:{column}: must be positive: {text!r}")
        return value

    def meaning(self, names: Sequence[str]) -> dict[str, Parameter]:
        """What the parameters of these names are."""
        text = self._row.get(MEANING)
        if text is None:
            raise DataError(
                f"{self._place}: missing column {MEANING}: what each parameter is; write it with `residual`"
            )
        return _meaning(text, names, f"{self._place}:{MEANING}")

    def read_nuisance(self, x: LocalStatistics) -> LocalStatistics:
        """The statistics of the monitored parameters x with those of what is uncertain beside them, where there is
        any."""
        described = self._row.get(NUISANCE, "").strip()
        if not described:
            return x
        try:
            found = json.loads(described)
            common, own = int(found["common"]), {str(c): float(v) for c, v in found["own"].items()}
            if common < 0 or not all(0 < v < np.inf for v in own.values()):
                raise ValueError("sizes")
        except (ValueError, TypeError, KeyError, AttributeError):
            raise DataError(f"{self._place}:{NUISANCE}: not a JSON mapping of `common` and `own`") from None
        a, k = len(x.parameters), common + len(own)
        upper = np.triu_indices(k)
        sizes = [k, a * k, len(upper[0]), a * k, len(upper[0])]
        cells = [self._row.get(f"{NUISANCE}:{i + 1}", "") for i in range(len(self._row))]
        text = "".join(cell.removeprefix(MARK) for cell in cells)
        try:
            values = np.frombuffer(base64.b64decode(text, validate=True), "<f8").astype(float)
        except (binascii.Error, ValueError):
            values = np.zeros(0)
        if len(values) != sum(sizes) or not np.all(np.isfinite(values)):
            raise DataError(f"{self._place}:{NUISANCE}:1: not {sum(sizes)} finite numbers in base 64")
        s, *blocks = np.split(values, np.cumsum(sizes)[:-1])
        whole = []
        for M, beside, inner in ((x.F, *blocks[:2]), (x.V, *blocks[2:])):
            full = np.zeros((a + k, a + k))
            full[:a, :a], full[:a, a:] = M, beside.reshape(a, k)
            full[a:, a:][upper] = inner
            whole.append(np.triu(full) + np.triu(full, 1).T)
        normals = tuple(f"nominal.{i + 1}" for i in range(common))
        return replace(
            x,
            parameters=(*x.parameters, *normals, *own),
            theta0=np.append(x.theta0, np.zeros(k)),
            prior_sigma=np.concatenate([x.prior_sigma, np.ones(common), list(own.values())]),
            s=np.append(x.s, s),
            F=whole[0],
            V=whole[1],
            slopes=None if x.slopes is None else np.pad(x.slopes, (0, k)),
            additive=True,
            common=normals,
            own=tuple(own),
        )

    def conditions(self) -> dict[str, float]:
        """Mean of each input, none where the file does not say."""
        text = self._row.get(CONDITIONS, "").strip()
        if not text:
            return {}
        try:
            found = json.loads(text)
            values = {str(column): float(value) for column, value in found.items()}
        except (ValueError, TypeError, AttributeError):
            raise DataError(f"{self._place}:{CONDITIONS}: not a JSON mapping of numbers: {text!r}") from None
        if not np.all(np.isfinite(list(values.values()))):
            raise DataError(f"{self._place}:{CONDITIONS}: not finite numbers: {text!r}")
        return values

    def matrix(self, what: str, names: Sequence[str]) -> np.ndarray:
        full = np.zeros((len(names), len(names)))
        for i, a in enumerate(names):
            for k in range(i, len(names)):
                full[i, k] = full[k, i] = self.number(f"{what}:{a}|{names[k]}")
        return full


CHECKSUM = "checksum"
"""Column that holds the checksum of the other columns of its row."""
PREFIX = "made:"
"""Begins the columns that say how a row was made, `made:nominal` and so on."""
DIGITS = 16
"""Hexadecimal digits of a checksum: an accident in 10¹⁹ passes."""


@dataclass(frozen=True)
class StatisticsOrigin:
    """How statistics were made. nominal: fingerprint of the nominal state and of its engine; reference and last:
    records, 0 for none; recorder: of its file."""

    nominal: str
    window: str = ""
    step: str = ""
    linearise: str = "estimate"
    monitor: str = ""
    reference: str = "0"
    last: str = "0"
    model_error: str = ""
    recorder: str = ""
    engine_instance: str = ""

    def cells(self) -> dict[str, str]:
        """One column per choice."""
        return {f"{PREFIX}{f.name}": getattr(self, f.name) for f in fields(self)}

    def differences(self, other: StatisticsOrigin) -> tuple[tuple[str, str, str], ...]:
        """(what, here, there) of every choice in which the two differ."""
        pairs = ((f.name, getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return tuple((name, here, there) for name, here, there in pairs if here != there)

    @property
    def overlapping(self) -> bool:
        """Whether windows were asked for that share records."""
        return bool(self.step) and self.step != self.window


ORIGIN_COLUMNS = tuple(f"{PREFIX}{f.name}" for f in fields(StatisticsOrigin))


def plan_cells(plan: WindowPlan) -> dict[str, str]:
    """`window` and `step` of a plan as `StatisticsOrigin` keeps them: "60", "600 s", or "" for whole flights."""
    if plan.grid == float("inf"):
        return {"window": "", "step": ""}
    unit = " s" if plan.in_time else ""
    return {"window": f"{plan.length:.10g}{unit}", "step": f"{plan.step:.10g}{unit}"}


def read_origin(row: Mapping[str, str]) -> StatisticsOrigin | None:
    """How a row says that it was made; None when it does not say."""
    if not all(column in row for column in ORIGIN_COLUMNS):
        return None
    return StatisticsOrigin(**{f.name: row[f"{PREFIX}{f.name}"] for f in fields(StatisticsOrigin)})


def add_checksum(row: Mapping[str, Any], made: StatisticsOrigin) -> dict[str, Any]:
    """The row with how it was made and the checksum of it all."""
    whole = {**row, **made.cells()}
    return {**whole, CHECKSUM: checksum(whole)}


def checksum(row: Mapping[str, Any], without: tuple[str, ...] = ()) -> str:
    """Checksum of a row as it is written or as it was read: of the values of its columns, `without` some.

    Neither the order of the columns matters nor how a number is written, only its value; empty cells are as none.
    """
    digest = hashlib.sha256()
    for column in sorted(row):
        text = _canonical_text(row[column]) if column != CHECKSUM and column not in without else ""
        if text:
            digest.update(f"{column}\0{text}\0".encode(errors=UNSPEAKABLE))
    return digest.hexdigest()[:DIGITS]


def _canonical_text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (list, tuple)):
        return "; ".join(map(str, value))
    text = str(value)
    try:
        number = float(text)
    except ValueError:
        return text
    return "" if isnan(number) else repr(number)
