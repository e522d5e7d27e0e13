"""The contract of a method: choices made, trained once on an engine, then judging any number of windows together.

    METHODS["pca_raw"].with_options({"explained": 0.8}).train(monitor, healthy).diagnose(windows, 0.01) -> Verdicts

A method turns windows of records into detection tests and, where it can, names what changed: parameters (scores of the
local approach, structured parity equations, observers, estimation) or only sensors (PCA). A new one is one file with a
class that says

    HELP     what it does, in a few words
    OPTIONS  its choices, as fields of a YAML section; each is a field of the dataclass with the same default
    learns   whether it needs windows believed healthy to train
    name     under which `--method` and study files know it
    tests    names of its tests
    train    ties it to an engine; the fitted method's `diagnose` judges windows

one line in `registry.py`, and one row of the contract test. What holds for every method (that test asks it of each):
nothing is isolated where there is no alarm; a window without readings has no verdict; filling a window up with empty
records changes nothing; the verdict on one window does not depend on the others.

`Verdicts` is the result of every method: tests, alarms and named changes, window by window. `RecordWindows` is what it
judges; `judge_windows` makes windows of masked chunks of recordings, and a verdict of each.

A window keeps all of its records in their place: one that cannot be judged has no reading, and where time jumps empty
records stand for it, so that methods see how far apart two readings are. Methods judge many windows together.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.detection.verdict import FAULT, HEALTHY, NO_VERDICT
from enginediag_cli.errors import DataError
from enginediag_cli.recordings.repeated import label_runs
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import piece_bookkeeping
from enginediag_cli.residuals.windows import (
    JudgedInputs,
    Key,
    WindowPlan,
    WindowStatistics,
    cut_windows,
    describe_excluded,
    join_bookkeeping,
)

PARAMETERS, SENSORS, NOTHING = "parameters", "sensors", "none"
"""Kinds of name: parameters of the engine; columns of the recording; a method that only detects."""


@dataclass(frozen=True)
class DetectionTest:
    """One test on W windows: alarm where statistic > threshold, at probability `level` when nothing changed.

    statistic, dof, threshold, p_value (W,), NaN where there is nothing to test; `reference`: the distribution
    under "nothing changed", in words.
    """

    name: str
    statistic: np.ndarray
    dof: np.ndarray
    threshold: np.ndarray
    p_value: np.ndarray
    level: float
    reference: str

    @property
    def alarm(self) -> np.ndarray:
        """(W,) bool; False where there is nothing to test."""
        return np.asarray(self.statistic > self.threshold)

    @property
    def judged(self) -> np.ndarray:
        """(W,) bool."""
        return np.isfinite(self.statistic) & np.isfinite(self.threshold)


@dataclass(frozen=True)
class Verdicts:
    """Verdicts of one method on W windows.

    Attributes
    ----------
    method : str
        Its name.
    tests : tuple of DetectionTest
        It alarms when any of them does; they share the false-alarm probability.
    kind, names : str, tuple of str
        The q names of the evidence, and of which kind they are.
    meaning : str
        What the evidence is.
    evidence : ndarray of shape (W, q)
        Evidence for each name.
    isolated : ndarray of bool, shape (W, q), or None
        Nothing where there is no alarm; None for a method that isolates nothing.
    converged : ndarray of bool, shape (W,)
        False where an iteration did not converge; such a window has no verdict.
    likeliest : ndarray of bool, shape (W, q), or None
        What explains each window best, whether it alarms or not; None for a method that does not say so.
    probability : ndarray of shape (W,) or None
        That exactly this is right, NaN where there is none; None for a method that states none.
    withheld : dict of int to str
        Window → why it has no verdict although its tests could be made.
    """

    method: str
    tests: tuple[DetectionTest, ...]
    kind: str
    names: tuple[str, ...]
    meaning: str
    evidence: np.ndarray
    isolated: np.ndarray | None
    converged: np.ndarray
    likeliest: np.ndarray | None = field(default=None, kw_only=True)
    probability: np.ndarray | None = field(default=None, kw_only=True)
    withheld: dict[int, str] = field(default_factory=dict, kw_only=True)

    @property
    def alarm(self) -> np.ndarray:
        """(W,) bool."""
        return np.asarray(np.any([test.alarm for test in self.tests], axis=0) & self.judged)

    @property
    def judged(self) -> np.ndarray:
        """(W,) bool: windows with a verdict."""
        known = np.ones(len(self.converged), bool)
        known[list(self.withheld)] = False
        return np.asarray(np.any([test.judged for test in self.tests], axis=0) & self.converged & known)

    def isolated_names(self, window: int) -> tuple[str, ...] | None:
        """What is isolated in one window; None for a method that isolates nothing."""
        if self.isolated is None:
            return None
        return tuple(name for name, hit in zip(self.names, self.isolated[window], strict=True) if hit)

    def no_verdict_reason(self, window: int) -> str:
        """Why a window has no verdict; empty where it has one."""
        if self.judged[window]:
            return ""
        if not self.converged[window]:
            return "the re-estimate did not converge"
        return self.withheld.get(window, f"too few readings for any test of {self.method}")


def chi_square_test(name: str, statistic: np.ndarray, dof: np.ndarray, false_alarm: float) -> DetectionTest:
    """Test of statistic (W,) that is χ² with dof (W,) degrees of freedom when nothing changed."""
    from scipy.stats import chi2

    if not 0 < false_alarm < 1:
        raise ValueError("`false_alarm` must lie between 0 and 1")
    statistic, dof = np.broadcast_arrays(np.asarray(statistic, float), np.asarray(dof, float))
    usable = dof > 0
    safe = np.where(usable, dof, 1.0)
    return DetectionTest(
        name,
        np.where(usable, statistic, np.nan),
        dof,
        np.where(usable, chi2.isf(false_alarm, safe), np.nan),
        np.where(usable, chi2.sf(statistic, safe), np.nan),
        false_alarm,
        "chi-square",
    )


@dataclass(frozen=True)
class RecordWindows:
    """W windows of n consecutive records.

    Attributes
    ----------
    inputs : mapping of str to ndarray of shape (W, n)
        Column → values.
    y : ndarray of shape (W, n, m)
        Readings, NaN where missing. Windows of unequal length are filled up with records that have no reading (and may
        have no input).
    """

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray

    def __post_init__(self) -> None:
        if self.y.ndim != 3:
            raise ValueError(f"`y` must have shape (windows, records, sensors), not {self.y.shape}")
        for column, values in self.inputs.items():
            if np.shape(values) != self.y.shape[:2]:
                raise ValueError(f"input {column} must have shape {self.y.shape[:2]}, not {np.shape(values)}")

    @property
    def count(self) -> int:
        """W."""
        return int(self.y.shape[0])

    @property
    def length(self) -> int:
        """n."""
        return int(self.y.shape[1])

    @property
    def ends(self) -> np.ndarray:
        """Records (W,) up to the last one with a reading: how long each window is without what fills it up."""
        read = np.isfinite(self.y).any(axis=2)
        return np.where(read.any(axis=1), self.length - np.argmax(read[:, ::-1], axis=1), 0)

    def flat_inputs(self) -> dict[str, np.ndarray]:
        """Inputs column -> (W n,), window after window."""
        return {column: np.asarray(values, float).ravel() for column, values in self.inputs.items()}


def pad_windows(parts: Sequence[tuple[Mapping[str, np.ndarray], np.ndarray]]) -> RecordWindows:
    """Windows of unequal length, each inputs column -> (n_w,) and readings (n_w, m), filled up to the longest."""
    longest = max(len(y) for _, y in parts)

    def fill(values: np.ndarray) -> np.ndarray:
        width = [(0, longest - len(values)), *[(0, 0)] * (values.ndim - 1)]
        return np.pad(values, width, constant_values=np.nan)

    inputs = {c: np.stack([fill(own[c]) for own, _ in parts]) for c in parts[0][0]}
    return RecordWindows(inputs, np.stack([fill(y) for _, y in parts]))


Chosen = TypeVar("Chosen", bound="Method")


@dataclass(frozen=True)
class FittedMethod:
    """A method that knows its engine and, if it learns, the healthy data."""

    monitor: Monitor
    method: Method

    def diagnose(self, windows: RecordWindows, false_alarm: float = 0.01) -> Verdicts:
        """Judge windows of records.

        Parameters
        ----------
        windows : Windows
            W windows of n records. `Evidence` of the same monitor brings its scores with it, which methods share.
        false_alarm : float
            Probability of an alarm per window when nothing changed.

        Returns
        -------
        Verdicts
        """
        return self.method.diagnose(self.monitor, windows, false_alarm)


class Method(ABC):
    """A method with its choices made: a frozen dataclass whose fields are its choices."""

    HELP: ClassVar[str] = ""
    OPTIONS: ClassVar[tuple[Field, ...]] = ()
    learns: ClassVar[bool] = False

    @property
    def help(self) -> str:
        """What it does, in a few words."""
        return self.HELP

    @property
    def options(self) -> tuple[Field, ...]:
        """Its choices, as fields of a YAML section."""
        return self.OPTIONS

    @property
    @abstractmethod
    def name(self) -> str:
        """Under which `--method` and study files know it."""

    @property
    @abstractmethod
    def tests(self) -> tuple[str, ...]:
        """Names of the tests of its verdicts, in their order."""

    @abstractmethod
    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> Verdicts:
        """Judge all windows of this engine, with this probability of a false alarm per window."""

    @property
    def wrong_choice(self) -> str:
        """What is impossible among its choices; empty where nothing is."""
        return ""

    def train(self, monitor: Monitor, healthy: RecordWindows | None = None) -> FittedMethod:
        """Tie the method to an engine; `healthy` windows only matter when the method learns.

        Raises
        ------
        ValueError
            For choices that are impossible.
        DataError
            When a method that learns gets too few healthy windows.
        """
        if self.wrong_choice:
            raise ValueError(self.wrong_choice)
        return FittedMethod(monitor, self)

    def section(self) -> Section:
        """Its choices as a YAML section."""
        return Section(self.name, self.help, self.options)

    def configure(self: Chosen, values: Mapping[str, Any]) -> Chosen:
        """The method with those of its choices that `values` holds; other keys are not asked for."""
        chosen = {f.name: values[f.name] for f in self.options if f.name in values}
        chosen = {name: tuple(value) if isinstance(value, list) else value for name, value in chosen.items()}
        return replace(self, **chosen)  # type: ignore[type-var]


TOGETHER = 5_000
"""Records, filled up ones included, that methods are given at once: one call of the engine costs less than many."""
FARTHEST = 20
"""Empty records that stand for a jump of time, at most: noise of a correlation of 0.8 is forgotten by then."""


@dataclass(frozen=True)
class RecordedWindow:
    """Where a window lies, inputs column -> (n,) and readings y (n, m) of its records, empty ones among them."""

    place: WindowStatistics
    inputs: Mapping[str, np.ndarray]
    y: np.ndarray

    @property
    def judged(self) -> int:
        """Records with a reading that is judged."""
        return int(np.isfinite(self.y).any(axis=1).sum())


@dataclass(frozen=True)
class WindowVerdict:
    """Verdict on one window of recordings.

    Attributes
    ----------
    window : RecordedWindow
        The window.
    verdict, reason : str
        Verdict, and why there is none.
    verdicts : Verdicts or None
        The method's verdicts, of which this is number `number`; None for a window without a judged reading.
    number : int
        Place in `verdicts`.
    """

    window: RecordedWindow
    verdict: str
    reason: str = ""
    verdicts: Verdicts | None = None
    number: int = 0


def recorded_windows(monitor: Monitor, recordings: Iterable[Recording], plan: WindowPlan) -> Iterator[RecordedWindow]:
    """Windows of masked recordings as soon as they are complete; chunks of one file come in order.

    Raises DataError as `cut` does.
    """
    for complete in cut_windows(monitor, recordings, plan, _pieces):
        yield from map(_join_pieces, complete)


def training_windows(monitor: Monitor, recordings: Iterable[Recording], plan: WindowPlan) -> RecordWindows:
    """Collect windows for a method to learn from.

    Parameters
    ----------
    monitor : Monitor
        The engine and its nominal state.
    recordings : iterable of Recording
        Masked recordings, believed healthy.
    plan : WindowPlan
        Length of windows.

    Returns
    -------
    RecordWindows

    Raises
    ------
    DataError
        When none of them holds a record that can be judged.
    """
    found = list(recorded_windows(monitor, recordings, plan))
    usable = [window for window in found if window.judged]
    if not usable:
        why = f": {describe_excluded(join_bookkeeping([w.place for w in found]))}" if found else ""
        raise DataError(f"the healthy recordings hold nothing to learn from{why}")
    return pad_windows([(window.inputs, window.y) for window in usable])


def judge_windows(
    fitted: FittedMethod, windows: Iterable[RecordedWindow], false_alarm: float
) -> Iterator[WindowVerdict]:
    """Judge windows of recordings, many together.

    Parameters
    ----------
    fitted : FittedMethod
        A trained method.
    windows : iterable of RecordedWindow
        As `recorded_windows` makes them.
    false_alarm : float
        Probability of an alarm without a change.

    Yields
    ------
    WindowVerdict
        In the order of the windows.
    """
    batch: list[RecordedWindow] = []
    longest = 0
    for window in windows:
        longer = max(longest, len(window.y))
        if batch and longer * (len(batch) + 1) > TOGETHER:
            yield from _judge_batch(fitted, batch, false_alarm)
            batch, longer = [], len(window.y)
        batch.append(window)
        longest = longer
    yield from _judge_batch(fitted, batch, false_alarm)


def _judge_batch(fitted: FittedMethod, batch: Sequence[RecordedWindow], false_alarm: float) -> Iterator[WindowVerdict]:
    asked = [window for window in batch if window.judged]
    verdicts = (
        fitted.diagnose(pad_windows([(window.inputs, window.y) for window in asked]), false_alarm) if asked else None
    )
    number = 0
    for window in batch:
        if verdicts is None or not window.judged:
            yield WindowVerdict(window, NO_VERDICT, describe_excluded(window.place))
            continue
        reason = verdicts.no_verdict_reason(number)
        verdict = NO_VERDICT if reason else FAULT if verdicts.alarm[number] else HEALTHY
        yield WindowVerdict(window, verdict, reason, verdicts, number)
        number += 1


def _pieces(
    part: Recording, taken: JudgedInputs, key: Key, blocks: np.ndarray, lags: np.ndarray
) -> Iterator[tuple[int, RecordedWindow]]:
    """The records of each block of one group in one chunk."""
    y = np.where(taken.judged[:, None], taken.y, np.nan)
    apart = np.where(np.isfinite(lags), np.minimum(lags, FARTHEST), FARTHEST).astype(int)
    for i, k in label_runs(blocks):
        rows = slice(i, k)
        steps = np.cumsum(apart[rows]) - 1  # empty records before the first stand for a jump from the block before
        inputs = {c: _space_records(v[rows], steps) for c, v in taken.inputs.items()}
        yield (
            int(blocks[i]),
            RecordedWindow(piece_bookkeeping(part, taken, key, rows), inputs, _space_records(y[rows], steps)),
        )


def _space_records(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """values (n, ...) at the positions `steps` (n,) of an otherwise empty array."""
    spread = np.full((int(steps[-1]) + 1, *values.shape[1:]), np.nan)
    spread[steps] = values
    return spread


def _join_pieces(pieces: Sequence[RecordedWindow]) -> RecordedWindow:
    """A window from its pieces, without the empty records before its first."""
    inputs = {c: np.concatenate([piece.inputs[c] for piece in pieces]) for c in pieces[0].inputs}
    y = np.concatenate([piece.y for piece in pieces])
    begun = slice(_first_record(inputs, y), None)
    return RecordedWindow(
        join_bookkeeping([piece.place for piece in pieces]), {c: v[begun] for c, v in inputs.items()}, y[begun]
    )


def _first_record(inputs: Mapping[str, np.ndarray], y: np.ndarray) -> int:
    """The first record that holds anything."""
    held = np.isfinite(y).any(axis=1) | np.any([np.isfinite(v) for v in inputs.values()], axis=0)
    return int(np.argmax(held)) if held.any() else 0
