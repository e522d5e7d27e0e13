"""Files of statistics read back: whole, unedited, of one making, each window once.

Several files may have been put together with `cat`: their `#` lines and repeated headers are passed over.

Statistics that add over windows, flights and files, and what is marginalised at which level.

Of s ~ N(F (Δθ, x), V) with Δθ what is monitored and x ~ N(0, C) what is uncertain beside it, the sums s, F, V and N of
two windows add as long as both hold x. x is of two kinds:

- *common*: nominal as identified, errors of its maps: one draw for all windows. It stays a parameter in every sum, in
  unit normals (`reduced.py`), and is marginalised last, once.
- *own*: errors of instruments that each recording has anew. Windows of one recording are added first, then it is
  marginalised, then recordings are added.

V of two windows that follow each other in one recording lacks what noise that is correlated from record to record adds
across their border. At nominal the sum is that of the whole; windows that are linearised at their own estimates are
carried back to θ0, and their sum is about all these points, not about the estimate of the whole.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.flat import CHECKSUM, StatisticsOrigin, checksum, is_flat, read_flat, read_origin
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import Condense, condense_statistics
from enginediag_cli.residuals.reduced import ReducedMonitor
from enginediag_cli.residuals.statistics import LocalStatistics, covariance_root
from enginediag_cli.residuals.windows import WindowStatistics

MAKE_ANEW = "make them anew with `enginediag residual` from the recordings"
IGNORED = {
    "window": "--window",
    "step": "--step",
    "linearise": "--linearise",
    "monitor": "--monitor",
    "recorder": "--recorder",
    "engine_instance": "--engine-instance",
    "reference": "--reference",
    "last": "--last",
    "model_error": "--model-error",
}
"""Choices that were made when the statistics were, and the options that make them."""

Span = tuple[int, int]
Place = tuple[str, str, str]


@dataclass
class Ledger:
    """What one run has read of statistics. nominal: fingerprint of the nominal given beside them, "" for none;
    summed: windows of one flight are added up, so that no record may stand in two of them.

    repeated: rows left out, for they had been there before; overlapping: windows that share records with another,
    though none were asked for that do (two recordings of one name, or one made twice).
    """

    nominal: str = ""
    summed: bool = False
    repeated: int = 0
    overlapping: int = 0
    _origin: tuple[StatisticsOrigin, str] | None = None
    _rows: set[str] = field(default_factory=set)
    _spans: dict[Place, list[Span]] = field(default_factory=dict)

    def admit(self, row: Mapping[str, str], place: str) -> bool:
        """Whether a row may count, and not only repeats an earlier one. DataError names the place of one that is
        edited, old, or made otherwise than the rest."""
        made = read_origin(row)
        if made is None or not row.get(CHECKSUM):
            raise DataError(f"{place}: the row does not say how it was made, nor its checksum: {MAKE_ANEW}")
        if checksum(row) != row[CHECKSUM]:
            what = "the row's checksum does not fit: it was edited after residual wrote it"
            raise DataError(f"{place}:{CHECKSUM}: {what}; {MAKE_ANEW}")
        if self.nominal and made.nominal != self.nominal:
            raise DataError(f"{place}: made with another nominal than the one given; {MAKE_ANEW}")
        first, where = self._origin or (made, place)
        self._origin = first, where
        if differ := made.differences(first):
            what = "; ".join(f"{IGNORED.get(n, n)} {a or 'none'}, there {b or 'none'}" for n, a, b in differ)
            raise DataError(f"{place}: made otherwise than {where}: {what}; {MAKE_ANEW}, all alike")
        # the same records under another file's name give the same numbers; without statistics nothing shows it
        content = checksum(row, without=("source",) if row.get("n", "").strip() else ())
        if content in self._rows:
            self.repeated += 1
            return False
        self._rows.add(content)
        return True

    def place(self, window: WindowStatistics, place: str) -> None:
        """Note the records of a window. DataError when windows are added up and this one shares some with another."""
        if window.statistics is None or self._origin is None:
            return
        if self._origin[0].overlapping and not self.summed:
            return
        spans = self._spans.setdefault((window.source, window.flight, window.engine), [])
        span = (window.first_line, window.last_line)
        latest = spans[0][1] if spans else 0
        shared = span[0] <= latest and any(first <= span[1] and span[0] <= last for first, last in spans[1:])
        spans[:1] = [
            (0, max(latest, span[1]))
        ]  # the first entry holds the last line of all: most windows come in order
        spans.append(span)
        if shared and self.summed:
            raise DataError(
                f"{place}: lines {span[0]} to {span[1]} of {window.source} stand in another window, too, and would "
                "count twice: windows that overlap, or two recordings of one name, cannot be added up"
            )
        self.overlapping += shared


def read_statistics(
    lines: Iterable[str], source: str, ledger: Ledger
) -> Iterator[tuple[WindowStatistics, dict[str, Parameter]]]:
    """Windows, and what their parameters are, of an open file of statistics, each once.

    Raises DataError naming file and line.
    """
    for row, line in _rows(lines, source):
        place = f"{source}:{line}"
        if ledger.admit(row, place):
            for window, known in read_flat([row], source, [line]):
                ledger.place(window, place)
                yield window, known


def refuse_ignored_options(given: Mapping[str, object], source: str) -> None:
    """DataError when options are given that statistics, which are made already, would ignore.

    given: name of a choice as in `IGNORED` → whether the user made it.
    """
    options = [option for name, option in IGNORED.items() if given.get(name)]
    if options:
        raise DataError(
            f"{source} holds statistics, for which {', '.join(options)} would do nothing: give the option to "
            "`enginediag residual`, which makes them"
        )


class _Uncommented:
    """Lines of a CSV file without the `#` lines outside quotes; `number` is that of the line read last."""

    def __init__(self, lines: Iterable[str]):
        self._lines = iter(lines)
        self._quoted = False
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        for text in self._lines:
            self.number += 1
            text = text.lstrip("\ufeff") if not self._quoted else text
            if not self._quoted and text.startswith("#"):
                continue
            self._quoted ^= text.count('"') % 2 == 1
            return text
        raise StopIteration


def _rows(lines: Iterable[str], source: str) -> Iterator[tuple[dict[str, str], int]]:
    """Rows by column, and the line on which each begins."""
    bare = _Uncommented(lines)
    reader = csv.reader(bare, strict=True)
    header: list[str] | None = None
    try:
        while True:
            before = bare.number
            row = next(reader, None)
            if row is None:
                return
            line = min(before + 1, bare.number) if any("\n" in cell for cell in row) else bare.number
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            if header is None or cells == header:
                header = _checked_header(cells, source, line)
            elif is_flat(cells):
                raise DataError(
                    f"{source}:{line}: another header in the middle of the file "
                    f"({_header_difference(header, cells)}): the rows below it hold other statistics than those above; "
                    f"{MAKE_ANEW}, all alike"
                )
            elif len(row) != len(header):
                raise DataError(f"{source}:{line}: {len(row)} fields where the header has {len(header)}")
            else:
                yield dict(zip(header, row, strict=True)), line
    except csv.Error as error:
        raise DataError(f"{source}:{bare.number}: {error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{source}: not UTF-8 text ({error.reason})") from error
    except (gzip.BadGzipFile, EOFError) as error:
        raise DataError(f"{source}: damaged gzip file ({error})") from error


def _checked_header(cells: Sequence[str], source: str, line: int) -> list[str]:
    for position, cell in enumerate(cells):
        if not cell:
            raise DataError(f"{source}:{line}: column {position + 1} has no name")
        if cells.index(cell) != position:
            raise DataError(f"{source}:{line}:{cell}: two columns have this name")
    return list(cells)


def _header_difference(header: Sequence[str], cells: Sequence[str]) -> str:
    more = [c for c in cells if c not in header]
    fewer = [c for c in header if c not in cells]
    if not more and not fewer:
        return "its columns stand in another order"
    return "; ".join(f"{what} {', '.join(names[:3])}" for what, names in (("new", more), ("gone", fewer)) if names)


def keep_nuisance(monitor: Monitor) -> Condense:
    """Statistics of all parameters of a monitor. How uncertain the noise is, and what wrong slopes make of a change, is
    that of the window alone, marginalised."""
    a = len(monitor.monitored)
    own = monitor.names[len(monitor.names) - len(monitor.offsets) :]

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        alone = condense_statistics(monitor, statistics, monitor.uncertainty)
        whole = statistics if isinstance(monitor, ReducedMonitor) else _to_unit_normals(monitor, statistics)
        p = len(whole.parameters)
        whole = replace(
            whole,
            by_sensor=None,
            rows=None,
            kurtosis=None,
            points=None,
            doubt=alone.doubt,
            additive=True,
            slopes=None if alone.slopes is None else np.pad(alone.slopes, (0, p - a)),
            common=whole.parameters[a : p - len(own)],
            own=own,
        )
        return replace(window, statistics=whole)

    return condense


def count_nuisance(monitor: Monitor) -> int:
    """How many parameters `keep_nuisance` statistics have beside the monitored ones."""
    k = len(monitor.names) - len(monitor.offsets)
    if isinstance(monitor, ReducedMonitor):
        return len(monitor.names) - len(monitor.monitored)
    return covariance_root(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k]).shape[1] + len(monitor.offsets)


def _to_unit_normals(monitor: Monitor, statistics: LocalStatistics) -> LocalStatistics:
    """The statistics with unit normals n in place of what is uncertain but for offsets, x = L n with L Lᵀ = C:

    s' = Tᵀ s,   F' = Tᵀ F T,   V' = Tᵀ V T,   T = (1, L) for the monitored and the normals.
    """
    a, k, p = len(monitor.monitored), len(monitor.names) - len(monitor.offsets), len(monitor.names)
    root = covariance_root(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k])
    r = root.shape[1]
    T = np.zeros((p, a + r + p - k))
    T[:a, :a], T[:k, a : a + r], T[k:, a + r :] = np.eye(a), root, np.eye(p - k)
    return replace(
        statistics,
        parameters=(*monitor.monitored, *(f"nominal.{i + 1}" for i in range(r)), *monitor.names[k:]),
        theta0=np.concatenate([statistics.theta0[:a], np.zeros(r + p - k)]),
        prior_sigma=np.concatenate([statistics.prior_sigma[:a], np.ones(r), statistics.prior_sigma[k:]]),
        s=T.T @ statistics.s,
        F=T.T @ statistics.F @ T,
        V=T.T @ statistics.V @ T,
    )
