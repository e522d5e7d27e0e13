"""Windows of files: recordings are condensed, statistics that `residual` wrote are read back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from enginediag_cli.errors import DataError
from enginediag_cli.intake.intake import File, Intake
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.flat import is_flat, read_flat
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import WindowStatistics
from enginediag_cli.residuals.reference import windows_against_reference
from enginediag_cli.residuals.windows import WindowPlan

Window = tuple[WindowStatistics, Mapping[str, str]]
"""Statistics of a window, and the unit of each parameter."""


@dataclass(frozen=True)
class Judging:
    """How recordings become windows: the plan of windows; `linearise` as in `window_statistics`; reference and last:
    counts of records per flight and engine, 0 for none; `model_error`: relative error that the model makes about a
    change."""

    plan: WindowPlan = field(default_factory=WindowPlan)
    linearise: str = "estimate"
    reference: int = 0
    last: int = 0
    model_error: float = 0.0

    @property
    def notes(self) -> Mapping[str, str]:
        """Choices that a result depends on, for its provenance."""
        told = {
            "reference": self.reference and f"first {self.reference}",
            "judged": self.last and f"last {self.last}",
            "model_error": self.model_error,
        }
        return {name: str(value) for name, value in told.items() if value}


@dataclass
class JudgedFiles:
    """Windows of the files of an intake; monitor: None where all files hold statistics. `counts`: of records by what
    became of them (`records`, `outside`, `incomplete`, `failed`), of `windows` and of those with `statistics`, as far
    as they have been read.
    passing: sees the chunks of recordings on their way."""

    intake: Intake
    monitor: Monitor | None
    judging: Judging
    passing: Callable[[Iterable[Recording]], Iterable[Recording]] = iter
    counts: Counter[str] = field(default_factory=Counter)

    def windows(self) -> Iterator[Window]:
        """All windows in turn. Raises DataError, NoVerdictError."""
        for file in self.intake.files():
            for window, units in self._flat(file) if is_flat(file.columns) else self._condensed(file):
                self._count(window)
                yield window, units

    def _condensed(self, file: File) -> Iterator[Window]:
        monitor, judging = self.monitor, self.judging
        if monitor is None:
            raise DataError(f"{file.name}: a recording needs --nominal; only what residual has written does without")
        for window in windows_against_reference(
            monitor,
            self.passing(file.masked()),
            judging.plan,
            judging.reference,
            last=judging.last,
            linearise=judging.linearise,
            model_error=judging.model_error,
        ):
            yield window, monitor.units

    @staticmethod
    def _flat(file: File) -> Iterator[Window]:
        for chunk in file.raw():
            numbers = {c: [repr(x) for x in values.tolist()] for c, values in chunk.columns.items()}
            cells = {**chunk.text, **{c: ["" if x == "nan" else x for x in v] for c, v in numbers.items()}}
            rows = (dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True))
            yield from read_flat(rows, chunk.source, chunk.line.tolist())

    def _count(self, window: WindowStatistics) -> None:
        self.counts.update(
            windows=1,
            statistics=window.statistics is not None,
            records=window.records,
            outside=window.outside,
            incomplete=window.incomplete,
            failed=window.failed,
        )
