"""Whether a recording can be used, as data for `check`: columns, units, time, switches, and the engine.

Files are read, mapped and masked by the same rules as for judging (`loader.py`), but each at once, since what is wrong
with a file shows in the whole of it. A switch column (a valve, a bleed, an anti-ice command) has 0 or 1, or nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.intake.agreement import (
    FEWEST,
    AgreementCheck,
    RecordingMismatch,
    check_against_engine,
    check_against_nominal,
)
from enginediag_cli.intake.loader import CHUNK, ExcludedData, choose_engines, engine_rows, masking_rules, select_engine
from enginediag_cli.intake.selection import RequiredColumns, required_columns
from enginediag_cli.recordings.masking import MaskCounts, MaskingRules, RecordMasker, mask_chunks, mask_recording
from enginediag_cli.recordings.read import read
from enginediag_cli.recordings.recorder import ColumnConversion
from enginediag_cli.recordings.repeated import find_frozen
from enginediag_cli.recordings.table import (
    FlightNumbers,
    MissingColumn,
    ReadingCounts,
    Recording,
    concat,
    find_missing_columns,
)
from enginediag_cli.recordings.unit_inference import UnitDoubt, unit_doubt
from enginediag_cli.units import UNITS, find_unit, split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.identification.nominal import Nominal
    from enginediag_cli.recordings.recorder import Recorder


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
    from enginediag_cli.recordings.table import is_missing

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

Stretches = tuple["TimeStretch", ...]


@dataclass(frozen=True)
class TimeStretch:
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
class RecordingCheck:
    """What a file holds of the `wanted` columns. numeric: columns of numbers but time (0 is not ok); timed: whether
    there is `time_s`, too; absent: those wanted that are not there, with a near match; empty: those there without a
    single reading."""

    records: int
    numeric: int
    found: tuple[str, ...]
    absent: tuple[MissingColumn, ...]
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


def check_recording(
    recording: Recording,
    inputs: Iterable[str] = (),
    sensors: Iterable[str] = (),
    switches: Iterable[str] = (),
    judged: MaskingRules | None = None,
) -> RecordingCheck:
    """Look over a whole file of N records, before anything is masked, for the columns that an engine needs; without
    any, for all its columns of numbers. judged: how it will be masked, where that is known better than by its columns.
    """
    numbers = [c for c in recording.columns if c != "time_s"]
    inputs, sensors = list(inputs), list(sensors)
    wanted = [*inputs, *sensors] or numbers
    readings = [c for c in sensors or numbers if c in numbers and c not in inputs]
    judged = judged or MaskingRules(readings, [c for c in inputs if c in numbers])
    masker = RecordMasker(judged)
    for _ in mask_chunks([recording], masker):
        pass
    return RecordingCheck(
        records=len(recording),
        numeric=len(numbers),
        found=tuple(c for c in wanted if c in numbers),
        absent=find_missing_columns(wanted, recording.order),
        empty=tuple(c for c in wanted if c in numbers and not np.isfinite(recording[c]).any()),
        units=tuple(d for c in wanted if c in numbers and (d := unit_doubt(c, recording[c])) is not None),
        frozen=_frozen_lines(recording, judged),
        timing=_timing(recording, masker.counts.repeated),
        switches=switch_faults(recording, switches),
        masks=masker.counts,
        timed="time_s" in recording,
    )


def _frozen_lines(recording: Recording, judged: MaskingRules) -> Stretches:
    flights = FlightNumbers().numbers(recording)
    mask = find_frozen(recording, flights, judged.sensors, judged.inputs, judged.settings.frozen_records)
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    ends = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return tuple(TimeStretch(int(recording.line[a]), int(recording.line[b]), float(b - a + 1)) for a, b in ends)


def _timing(recording: Recording, repeated: int) -> Timing:
    if "time_s" not in recording:
        return Timing()
    time, line = recording["time_s"], recording.line
    known = np.flatnonzero(np.isfinite(time))
    flights = FlightNumbers().numbers(recording)[known]
    order = known[np.argsort(flights, kind="stable")]
    within = np.diff(np.sort(flights, kind="stable")) == 0
    step = np.diff(time[order])
    forward = step[within & (step > 0.0)]
    usual = float(np.median(forward)) if forward.size else float("nan")
    gaps = np.flatnonzero(within & (step > GAP * usual)) if forward.size else np.zeros(0, dtype=np.int64)
    back = np.flatnonzero(within & (step < 0.0))

    def listed(places: np.ndarray) -> Stretches:
        return tuple(
            TimeStretch(int(line[order[k]]), int(line[order[k + 1]]), float(abs(step[k])))
            for k in places[:PLACES_SHOWN]
        )

    lost = len(time) - len(known)
    return Timing(usual, lost, len(gaps), listed(gaps), len(back), listed(back), repeated)


MOST_CHECKED = 300_000
"""Records that are looked over, from the first on: half a kilobyte each in memory. What is wrong shows there."""
BEYOND = 0.5
"""Share of the range seen, beyond its ends, from which an input's median is doubted to be in its unit."""


@dataclass(frozen=True)
class InputExceedance:
    """One input outside the range identified in so many `records`: beyond `limit`, up to `farthest`, from `line` on."""

    column: str
    records: int
    limit: float
    farthest: float
    line: int


@dataclass(frozen=True)
class Coverage:
    """Of the records with all inputs and a reading (`complete` of `records`), those `inside` the operating points
    identified (`known`: whether any are; else all count as inside); beyond: those outside by the input that is
    farthest beyond its range; combination: those with every input within its range, but not in this combination."""

    records: int
    complete: int
    inside: int
    beyond: tuple[InputExceedance, ...] = ()
    combination: int = 0
    known: bool = True


@dataclass(frozen=True)
class CheckedFile:
    """What is known of one `file`, and one `engine` of it where they are distinguished. text: columns of text; units:
    doubts by what readings usually are, where there is no engine to compare them with; wrong: why it cannot be of the
    engine, or in these units; coverage: None without an engine;
    refused: why the recorder kept no record at all; goes_on: there are more records than were looked over."""

    file: str
    engine: str
    text: int
    acceptance: RecordingCheck
    left: ExcludedData
    wanted: RequiredColumns | None = None
    units: tuple[UnitDoubt, ...] = ()
    wrong: tuple[RecordingMismatch, ...] = ()
    coverage: Coverage | None = None
    refused: str = ""
    is_partial: bool = False

    @property
    def missing_inputs(self) -> tuple[str, ...]:
        """Inputs without a column, or without a reading."""
        needed = self.wanted.inputs if self.wanted is not None else ()
        gone = {a.column for a in self.acceptance.absent} | set(self.acceptance.empty)
        return tuple(c for c in needed if c in gone)

    @property
    def usable(self) -> bool:
        """Whether it can be judged at all: columns of numbers, every input, a sensor, units that can be, and a record
        that is neither masked nor outside."""
        impossible = any(d.plausible for d in self.units) or bool(self.wrong)
        enough = (self.coverage is None or self.coverage.inside > 0) and not self.refused
        return (
            self.acceptance.usable and not self.missing_inputs and not self.lacks_sensors and not impossible and enough
        )

    @property
    def lacks_sensors(self) -> bool:
        """Whether none of the sensors has a reading."""
        if self.wanted is None:
            return False
        found = set(self.acceptance.found) - set(self.acceptance.empty)
        return not found & set(self.wanted.sensors)


@dataclass(frozen=True)
class CheckReference:
    """What recordings are compared with: nothing, an `engine`, or one with its `nominal` state; `recorder` maps them,
    `instance`: only this engine of them."""

    engine: Engine | None = None
    nominal: Nominal | None = None
    recorder: Recorder | None = None
    instance: str = ""
    wanted: RequiredColumns | None = field(init=False)
    agreement: AgreementCheck | None = field(init=False)

    def __post_init__(self) -> None:
        sensors = self.nominal.sensors if self.nominal is not None else None
        wanted = required_columns(self.engine, sensors) if self.engine is not None else None
        object.__setattr__(self, "wanted", wanted)
        agreement = None
        if self.engine is not None and self.nominal is not None:
            agreement = check_against_nominal(self.engine, self.nominal)
        elif self.engine is not None:
            agreement = check_against_engine(self.engine)
        object.__setattr__(self, "agreement", agreement)

    @property
    def switches(self) -> tuple[str, ...]:
        return self.engine.switches if self.engine is not None else ()


def check_file(file: str, against: CheckReference) -> Iterator[CheckedFile]:
    """Check a file before anything is judged, once for each of its engines that the recorder distinguishes.

    Parameters
    ----------
    file : str
        Path; ``-`` is standard input.
    against : CheckReference
        Engine, nominal state and recorder to compare it with.

    Yields
    ------
    CheckedFile

    Raises
    ------
    DataError
        For a file that cannot be read.
    """
    if against.recorder is not None:
        yield from _check_foreign_file(file, against, against.recorder)
        return
    wanted = against.wanted
    left, counts = ExcludedData(file), ReadingCounts()
    chunks = read(file, declared=wanted.declared if wanted else (), chunk_records=CHUNK, counts=counts)
    raw, goes_on = _read_first_records(select_engine(chunks, against.instance))
    left.reading = counts
    if wanted is None:
        yield replace(_check_masked(file, against, check_recording(raw), raw, None, left), is_partial=goes_on)
        return
    judged = masking_rules(wanted, raw)
    found = check_recording(raw, wanted.input_columns, wanted.sensors, against.switches, judged)
    clean, _ = mask_recording(raw, judged)
    yield replace(
        _check_masked(file, against, _drop_optional_inputs(found, wanted), raw, clean, left), is_partial=goes_on
    )


def _read_first_records(chunks: Iterator[Recording]) -> tuple[Recording, bool]:
    """The first `MOST_CHECKED` records, and whether there are more."""
    held: list[Recording] = []
    for chunk in chunks:
        held.append(chunk)
        if sum(map(len, held)) > MOST_CHECKED:
            return concat(held).select(slice(0, MOST_CHECKED)), True
    return concat(held), False


def _drop_optional_inputs(found: RecordingCheck, wanted: RequiredColumns | None) -> RecordingCheck:
    """Without the absent inputs that have a value which stands for "not recorded", unless one seems to be misspelt."""
    optional = wanted.optional if wanted is not None else ()
    return replace(found, absent=tuple(a for a in found.absent if a.near or a.column not in optional))


def _check_foreign_file(file: str, against: CheckReference, recorder: Recorder) -> Iterator[CheckedFile]:
    wanted = against.wanted
    given = wanted.input_columns if wanted is not None else ()
    counts = ReadingCounts()
    raw, goes_on = _read_first_records(recorder.chunks(file, counts=counts))
    for name in choose_engines(recorder.engines, against.instance, file, fleet=True):
        one = replace(recorder, engines={name: recorder.engines[name]})
        whole = one.derive(ColumnConversion(one, name).add(raw, end=True))
        found = check_recording(
            whole, given, wanted.sensors if wanted is not None else (), against.switches, one.judged(given)
        )
        left, refused = ExcludedData(file, name), ""
        left.reading = counts
        try:
            mapped = next(one.map(raw, inputs=given))
        except NoVerdictError as error:
            kept, refused = whole.select(slice(0, 0)), str(error)
        else:
            kept, left.gate = mapped.recording, mapped.gate
        if against.instance and name != against.instance:
            kept = kept.select(engine_rows(kept, against.instance))
        report = _check_masked(file, against, _drop_optional_inputs(found, wanted), whole, kept, left)
        yield replace(report, refused=refused, is_partial=goes_on)


def _check_masked(
    file: str,
    against: CheckReference,
    found: RecordingCheck,
    raw: Recording,
    clean: Recording | None,
    left: ExcludedData | None = None,
) -> CheckedFile:
    """clean: what would be judged of the recording; None where nothing is known of what should be in it."""
    left = left or ExcludedData(file)
    left.records = len(raw)
    left.take_mask_counts(found.masks)
    report = CheckedFile(file, left.engine, len(raw.text), found, left, against.wanted, found.units)
    engine, wanted = against.engine, against.wanted
    if engine is None or wanted is None or clean is None or report.missing_inputs or report.lacks_sensors:
        return report
    inputs = _inputs(engine, clean)
    read = [clean[c] for c in wanted.sensors if c in clean.columns]
    complete = np.all([np.isfinite(inputs[c]) for c in wanted.inputs], axis=0) & np.isfinite(read).any(axis=0)
    coverage, of_inputs = _coverage(against.nominal, inputs, complete, clean)
    wrong: tuple[RecordingMismatch, ...] = ()
    agreement = against.agreement
    if agreement is not None:
        steady = clean if left.gate is not None and len(clean) else raw
        wrong = tuple(agreement.find_mismatches(steady, report.engine, against.recorder))
    # what readings usually are is no better known than by the model
    compared = agreement is not None and bool(complete.sum() >= FEWEST)
    units = () if compared else found.units
    known = {d.column for d in units} | {d.trial.mistake.column for d in wrong if d.trial is not None}
    return replace(
        report,
        units=(*units, *(d for d in of_inputs if d.column not in known and not wrong)),
        wrong=wrong,
        coverage=coverage,
    )


def _inputs(engine: Engine, recording: Recording) -> dict[str, np.ndarray]:
    """Every input (N,), with the value that stands for "not recorded" where there is one."""
    n = len(recording)
    inputs = {c: recording.columns[c] for c in engine.inputs}
    for column, default in engine.optional_inputs.items():
        values = recording.columns.get(column, np.full(n, default))
        inputs[column] = np.where(np.isfinite(values), values, default)
    return inputs


def _coverage(
    nominal: Nominal | None, inputs: Mapping[str, np.ndarray], complete: np.ndarray, recording: Recording
) -> tuple[Coverage, tuple[UnitDoubt, ...]]:
    """How much lies where identification has been, and the inputs whose units cannot be by that."""
    n, m = len(complete), int(complete.sum())
    if nominal is None or not m:
        return Coverage(n, m, m, known=False), ()
    envelope = nominal.envelope
    u = np.column_stack([np.broadcast_to(inputs[c], n)[complete] for c in envelope.inputs])
    outside = envelope.outside({c: u[:, j] for j, c in enumerate(envelope.inputs)})
    over = np.maximum(u - envelope.high, envelope.low - u) / envelope.scale
    worst = np.where(outside & (over.max(axis=1) > 0.0), over.argmax(axis=1), -1)
    lines = recording.line[complete]
    beyond = []
    for j, column in enumerate(envelope.inputs):
        rows = np.flatnonzero(worst == j)
        if rows.size:
            k = rows[int(np.argmax(over[rows, j]))]
            limit = envelope.high[j] if u[k, j] > envelope.high[j] else envelope.low[j]
            beyond.append(InputExceedance(column, int(rows.size), float(limit), float(u[k, j]), int(lines[rows[0]])))
    coverage = Coverage(n, m, int(m - outside.sum()), tuple(beyond), int((outside & (worst < 0)).sum()))
    doubts = (_input_doubt(c, u[:, j], nominal, j) for j, c in enumerate(envelope.inputs))
    return coverage, tuple(d for d in doubts if d is not None)


def _input_doubt(column: str, values: np.ndarray, nominal: Nominal, j: int) -> UnitDoubt | None:
    """The doubt about an input far outside what was seen, which another unit would bring inside."""
    suffix = split_column(column)[1]
    low, high = float(nominal.envelope.low[j]), float(nominal.envelope.high[j])
    median, room = float(np.median(values)), max(high - low, float(nominal.envelope.scale[j]))
    if not suffix or low - BEYOND * room <= median <= high + BEYOND * room:
        return None
    unit = find_unit(suffix)
    fits = []
    for name, other in UNITS.items():
        value = (median * other.factor + other.offset - unit.offset) / unit.factor
        if other.dimension == unit.dimension and low <= value <= high:
            fits.append(name)
    return UnitDoubt(column, suffix, median, low, high, tuple(fits)) if fits else None
