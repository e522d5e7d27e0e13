"""Whether a recording can be used, as data: which columns are there, whether their units can be, and how time runs.

Switch columns: a valve, a bleed, an anti-ice command holds 0 or 1, or nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.masking import Judged, MaskCounts, Masker, mask_chunks
from enginediag_cli.recordings.read import Absent, absent_columns
from enginediag_cli.recordings.repeated import frozen
from enginediag_cli.recordings.table import FlightNumbers, Recording
from enginediag_cli.units import UNITS, find_unit, split_column

SHOWN = 5
"""Offending records that are named; the others are counted."""


@dataclass(frozen=True)
class SwitchFault:
    """A column declared as a switch that holds other values: how many, and the first of them with their lines."""

    column: str
    count: int
    lines: tuple[int, ...]
    values: tuple[str, ...]


def switch_faults(recording: Recording, switches: Iterable[str]) -> tuple[SwitchFault, ...]:
    """One fault for each of the columns that are there and hold anything but 0, 1 or nothing."""
    faults = []
    for column in switches:
        if column in recording.columns:
            values = recording[column]
            bad = np.flatnonzero(np.isfinite(values) & (values != 0.0) & (values != 1.0) | np.isinf(values))
            shown = [f"{values[k]:g}" for k in bad[:SHOWN]]
        elif column in recording.text:
            cells = [cell.strip() for cell in recording.text[column]]
            bad = np.array([k for k, cell in enumerate(cells) if not _is_switch(cell)], dtype=np.int64)
            shown = [cells[k] for k in bad[:SHOWN]]
        else:
            continue
        if bad.size:
            lines = tuple(int(n) for n in recording.line[bad[:SHOWN]])
            faults.append(SwitchFault(column, int(bad.size), lines, tuple(shown)))
    return tuple(faults)


def _is_switch(cell: str) -> bool:
    from enginediag_cli.recordings.formats.table_file import is_missing

    if is_missing(cell):
        return True
    try:
        return float(cell) in (0.0, 1.0)
    except ValueError:
        return False


GAP = 3.5
"""Usual steps of time from which one is a gap: three records in a row are lost, and the fourth is there."""
PLACES_SHOWN = 20
"""Stretches of a kind that are listed; further ones are counted."""

Stretches = tuple["Stretch", ...]


@dataclass(frozen=True)
class Range:
    """What the readings of a quantity usually lie within, in SI; narrower than what a sensor can give."""

    pattern: str
    low: float
    high: float


USUAL = {
    "temperature": (
        Range(r"(ambient_)?(temperature|SAT|sat|OAT|oat)|T0", 190.0, 335.0),
        Range(r"T1\d*|T2|TAT|tat", 200.0, 360.0),
        Range(r"T21\d*|T25\d*", 230.0, 700.0),
        Range(r"T3\d*", 350.0, 1050.0),
        Range(r"T4\d*|TIT|ITT|itt", 600.0, 2300.0),
        Range(r"T5\d*|T6\d*|EGT|egt|TGT", 350.0, 1500.0),
    ),
    "pressure": (
        Range(r"(ambient_)?pressure|P0", 5e3, 1.1e5),
        Range(r"P1\d*|P2", 1.8e4, 2.5e5),
        Range(r"P21\d*|P25\d*", 1.5e4, 1e6),
        Range(r"Ps?3\d*|Ps?4", 5e4, 6e6),
        Range(r"P4\d|P5\d*|P6\d*", 1.5e4, 2e6),
    ),
    "rotational speed": (Range(r"N\d*|Np|Ng", 200.0, 2.5e5),),
    "mass flow": (Range(r"Wf|fuel_flow|fuel", 3e-4, 15.0),),
    "length": (Range(r"altitude|alt", -500.0, 20_000.0),),
}
"""Dimension → ranges of quantities by ARP755 station, of gas turbines from 10 kW to 400 MW, from idle up. They say
whether a unit can be: a median outside is a question to the user, never a mask."""


@dataclass(frozen=True)
class UnitDoubt:
    """A column whose median cannot be in its unit, and the units of its dimension in which it could."""

    column: str
    unit: str
    median: float
    low: float
    high: float
    plausible: tuple[str, ...]


@dataclass(frozen=True)
class Stretch:
    """Records from a line to a line; amount: records of a frozen stretch, seconds of a gap or of a step back."""

    first_line: int
    last_line: int
    amount: float


@dataclass(frozen=True)
class Timing:
    """How time runs within the flights of a file. step_s: the usual step, NaN without time; missing: records without
    a time; gaps, backward: the first SHOWN of gap_count and backward_count; repeated: records that are there twice."""

    step_s: float = float("nan")
    missing: int = 0
    gap_count: int = 0
    gaps: Stretches = ()
    backward_count: int = 0
    backward: Stretches = ()
    repeated: int = 0


@dataclass(frozen=True)
class Acceptance:
    """What a file holds of the `wanted` columns. numeric: columns of numbers but time (0 is not ok); timed: whether
    there is `time_s`, too; absent: those wanted that are not there, with a near match; empty: those there without a
    single reading."""

    records: int
    numeric: int
    found: tuple[str, ...]
    absent: tuple[Absent, ...]
    empty: tuple[str, ...]
    units: tuple[UnitDoubt, ...]
    frozen: Stretches
    timing: Timing
    switches: tuple[SwitchFault, ...] = ()
    masks: MaskCounts = field(default_factory=MaskCounts)
    timed: bool = False

    @property
    def usable(self) -> bool:
        """Whether there is anything to judge: records, a number column, and one of the wanted columns if any are."""
        return self.records > 0 and self.numeric > 0 and bool(self.found or not self.absent)


def accept(
    recording: Recording,
    inputs: Iterable[str] = (),
    sensors: Iterable[str] = (),
    switches: Iterable[str] = (),
    judged: Judged | None = None,
) -> Acceptance:
    """Look over a whole file of N records, before anything is masked, for the columns that an engine needs; without
    any, for all its columns of numbers. judged: how it will be masked, where that is known better than by its columns.
    """
    numbers = [c for c in recording.columns if c != "time_s"]
    inputs, sensors = list(inputs), list(sensors)
    wanted = [*inputs, *sensors] or numbers
    readings = [c for c in sensors or numbers if c in numbers and c not in inputs]
    judged = judged or Judged(readings, [c for c in inputs if c in numbers])
    masker = Masker(judged)
    for _ in mask_chunks([recording], masker):
        pass
    return Acceptance(
        records=len(recording),
        numeric=len(numbers),
        found=tuple(c for c in wanted if c in numbers),
        absent=absent_columns(wanted, recording.order),
        empty=tuple(c for c in wanted if c in numbers and not np.isfinite(recording[c]).any()),
        units=tuple(d for c in wanted if c in numbers and (d := unit_doubt(c, recording[c])) is not None),
        frozen=_frozen_lines(recording, judged),
        timing=_timing(recording, masker.counts.repeated),
        switches=switch_faults(recording, switches),
        masks=masker.counts,
        timed="time_s" in recording,
    )


def unit_doubt(column: str, values: np.ndarray) -> UnitDoubt | None:
    """The doubt about a column's unit, or None where its median (N values) can be, or nothing is known about it."""
    quantity, suffix = split_column(column)
    finite = values[np.isfinite(values)]
    if not suffix or not finite.size:
        return None
    unit = find_unit(suffix)
    usual = usual_range(quantity, unit.dimension)
    median = median_of(finite)
    if usual is None or usual.low <= median * unit.factor + unit.offset <= usual.high:
        return None
    plausible = tuple(
        name
        for name, other in UNITS.items()
        if other.dimension == unit.dimension and usual.low <= median * other.factor + other.offset <= usual.high
    )
    low, high = ((limit - unit.offset) / unit.factor for limit in (usual.low, usual.high))
    return UnitDoubt(column, suffix, median, low, high, plausible)


def median_of(values: np.ndarray) -> float:
    """The median of the values (N,) that are there; infinite where it is at the end of what a float holds."""
    with np.errstate(over="ignore"):
        return float(np.nanmedian(values))


def usual_range(quantity: str, dimension: str) -> Range | None:
    """The usual range of a quantity of that name, perhaps behind an engine's prefix (`lh_T3`)."""
    for known in USUAL.get(dimension, ()):
        if re.fullmatch(rf"([A-Za-z]+\d*_)?({known.pattern})", quantity):
            return known
    return None


def _frozen_lines(recording: Recording, judged: Judged) -> Stretches:
    flights = FlightNumbers().of(recording)
    mask = frozen(recording, flights, judged.sensors, judged.inputs, judged.settings.frozen_records)
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    ends = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return tuple(Stretch(int(recording.line[a]), int(recording.line[b]), float(b - a + 1)) for a, b in ends)


def _timing(recording: Recording, repeated: int) -> Timing:
    if "time_s" not in recording:
        return Timing()
    time, line = recording["time_s"], recording.line
    known = np.flatnonzero(np.isfinite(time))
    flights = FlightNumbers().of(recording)[known]
    order = known[np.argsort(flights, kind="stable")]
    within = np.diff(np.sort(flights, kind="stable")) == 0
    step = np.diff(time[order])
    forward = step[within & (step > 0.0)]
    usual = float(np.median(forward)) if forward.size else float("nan")
    gaps = np.flatnonzero(within & (step > GAP * usual)) if forward.size else np.zeros(0, dtype=np.int64)
    back = np.flatnonzero(within & (step < 0.0))

    def listed(places: np.ndarray) -> Stretches:
        return tuple(
            Stretch(int(line[order[k]]), int(line[order[k + 1]]), float(abs(step[k]))) for k in places[:PLACES_SHOWN]
        )

    lost = len(time) - len(known)
    return Timing(usual, lost, len(gaps), listed(gaps), len(back), listed(back), repeated)
