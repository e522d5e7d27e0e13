"""One window: its statistics, and what was counted, rejected, flown and read in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.intake.agreement import Disagreement
from enginediag_cli.intake.left_out import GrossCounts
from enginediag_cli.residuals.admission import Elsewhere
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class WindowStatistics:
    """Statistics of the monitored parameters over one window; `statistics` is None where there is no verdict.

    records: in the window; outside: too far from the operating points seen; elsewhere: how many were not seen, by where
    they lie and whether they are judged; incomplete: without an input or without any reading; failed: not computed by
    the engine; reason: why there is no verdict, or empty. sensors: how many of the `sensors_of` that the nominal has
    gave a reading in a record that was judged (0 of 0: not known); silent: the monitored errors of those that gave
    none, of which nothing can be said and which are no suspects. conditions: mean of each input over the
    records that were judged; readings: mean of each sensor over them; flown: inputs of a few of them, evenly chosen,
    column -> (k,), and read: their readings (k, m), NaN where missing; of so few records as cannot be checked against
    each other these are all. checked: whether they could be, for gross errors.
    solution: the engine's unknowns (nx, n) at nominal in the records that were judged, where
    they are known, from which whoever asks the engine again of these records may begin. gross: readings and records
    that were rejected as gross errors. instruments: those that are stuck or scatter; weights (n, m, m): what multiplies
    the readings of each record that was judged, where some scatter. disagreement: that the recording is hardly of this
    engine, or in these units, which was accepted.
    """

    source: str
    flight: str
    engine: str
    first_line: int
    last_line: int
    start_s: float
    end_s: float
    records: int
    outside: int
    incomplete: int
    failed: int
    statistics: LocalStatistics | None
    reason: str = ""
    notes: tuple[str, ...] = ()
    sensors: int = 0
    sensors_of: int = 0
    silent: tuple[str, ...] = ()
    elsewhere: Counter[Elsewhere] = field(default_factory=Counter)
    conditions: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)
    flown: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)
    read: np.ndarray | None = field(default=None, repr=False, compare=False)
    checked: bool = True
    solution: np.ndarray | None = field(default=None, repr=False, compare=False)
    gross: GrossCounts = field(default_factory=GrossCounts)
    instruments: tuple[InstrumentFault, ...] = ()
    weights: np.ndarray | None = field(default=None, repr=False, compare=False)
    disagreement: Disagreement | None = field(default=None, repr=False, compare=False)

    def without(self, names: Collection[str]) -> WindowStatistics:
        """The window without the suspects `names` and those that are silent, in its statistics, too."""
        silent = tuple(dict.fromkeys((*self.silent, *names)))
        statistics = self.statistics and self.statistics.without(silent)
        return replace(self, silent=silent, statistics=statistics)

    @property
    def doubtful(self) -> bool:
        """Whether the recording is likelier wrong than the engine."""
        return self.disagreement is not None and self.disagreement.doubtful

    @property
    def counts(self) -> dict[str, int]:
        """What is counted of a window, and summed over many."""
        return {
            "windows": 1,
            "statistics": self.statistics is not None,
            "records": self.records,
            "outside": self.outside,
            "incomplete": self.incomplete,
            "failed": self.failed,
        }

    @property
    def extrapolated(self) -> int:
        """Records that are judged although training did not cover where they lie."""
        return sum(n for where, n in self.elsewhere.items() if where.judged)


def not_read(source: str, reason: str) -> WindowStatistics:
    """A recording that could not be read, or not to its end, in the place of its windows."""
    nan = float("nan")
    return WindowStatistics(source, "", "", 0, 0, nan, nan, 0, 0, 0, 0, None, reason)


def joined(parts: Sequence[WindowStatistics]) -> WindowStatistics:
    """Bookkeeping of a window from that of its pieces, in order."""
    first, last = parts[0], parts[-1]

    def total(name: str) -> int:
        return sum(getattr(part, name) for part in parts)

    return replace(
        first,
        last_line=last.last_line,
        end_s=last.end_s,
        records=total("records"),
        outside=total("outside"),
        incomplete=total("incomplete"),
        failed=total("failed"),
        elsewhere=sum((part.elsewhere for part in parts), Counter()),
        instruments=tuple(fault for part in parts for fault in part.instruments),
    )


def nothing_judged(window: WindowStatistics) -> str:
    """Why a window has no verdict, where none of its records could be judged."""
    counts = [
        (window.outside, "outside the operating points identified"),
        (window.incomplete, "incomplete"),
        (window.failed, "not computed by the engine"),
    ]
    return "no record could be judged: " + ", ".join(f"{n} {what}" for n, what in counts if n)
