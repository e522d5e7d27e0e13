"""The harness of every trial: its plan, the diagnosing process, the journal, and rates with 95 % intervals.

A trial draws an engine, conceals something, records flights, asks the diagnosing process about them, and marks its
answer. What a trial conceals and how it is marked is in `explain_trials` and `isolation_trials`; studies use the
journal and the rates alone.

Trials that share operating points or an engine come in blocks. With h_b hits among n_b trials of block b and the rate p
of all, they count as n/d independent trials, with the design effect

    d = B/(B − 1) · Σ_b (h_b − n_b p)² / (p (1 − p) Σ_b n_b),     1 at least

(L. Kish, Survey Sampling (1965) section 5.4), so that intervals hold for the blocks of another seed, too. Studies quote
Clopper and Pearson's interval, which is never too short; score sheets quote Wilson's, whose coverage is right on
average and which is shorter for few trials.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from enginediag_cli import __version__
from enginediag_cli.errors import DataError
from enginediag_cli.parallel import QuestionProcess, run_tasks
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.recordings.write import open_output
from enginediag_cli.validation import kinds

Key = TypeVar("Key")
Value = TypeVar("Value")
Record = Mapping[str, Any]
"""What is kept of a trial."""

DIAGNOSER = "enginediag_cli.validation.diagnoser"
EXPLAIN, LOCATE, PLAN, ISOLATE = "explain", "locate", "plan", "isolate"
"""Tasks of the diagnosing process. Trials have the question EXPLAIN or ISOLATE."""

CONFIDENCE = 0.95
"""Of every interval of a rate: two-sided, as is usual."""


# The plan, and its trials over processes


@dataclass(frozen=True)
class TrialPlan:
    """The trials of a campaign: question, engine files of which each trial has one, seed, truths, kinds of trials, and
    the false-alarm rate that `explain` is run with."""

    question: str
    engines: tuple[str, ...]
    seed: int
    truths: tuple[str, ...]
    kinds: tuple[str, ...]
    false_alarm: float = 0.05

    def group(self, trial: int) -> int:
        """Number of the group of a trial; the trials of a group share an engine and its healthy flights."""
        return trial // kinds.FIELD_JUDGED if self.kinds == (kinds.FIELD,) else trial

    @property
    def key(self) -> str:
        """Hash of all that a trial depends on but its number."""
        isolating = self.question == ISOLATE
        words = [__version__, self.seed, self.truths, self.kinds]
        words = [ISOLATE, *words] if isolating else [*words, self.false_alarm]
        return content_hash(" ".join(map(str, words)), map(Path, dict.fromkeys(self.engines)))


def content_hash(words: str, files: Iterable[Path]) -> str:
    """Hash of words and of the content of files."""
    digest = hashlib.sha256(words.encode())
    for file in files:
        digest.update(b"\0" + file.read_bytes())
    return digest.hexdigest()


def run_trials(
    run_group: Callable[[TrialPlan, Sequence[int]], list[dict[str, Any]]],
    plan: TrialPlan,
    numbers: Iterable[int],
    jobs: int,
) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Run trials over processes.

    Parameters
    ----------
    run_group
        Runs the trials of a group; `run_group` of `explain_trials` or of `isolation_trials`.
    plan
        The campaign.
    numbers
        Numbers of the trials to run.
    jobs
        Number of processes. Results do not depend on it.

    Yields
    ------
    tuple
        Number and record of each trial, those of a group together as they are finished, in any order.
    """
    groups = [tuple(own) for _, own in groupby(numbers, plan.group)]
    for trials, records in run_tasks(partial(run_group, plan), groups, jobs):
        yield from zip(trials, records, strict=True)


@lru_cache(maxsize=1)
def diagnoser() -> QuestionProcess:
    """The diagnosing process of this worker; it ends when the worker, and with it its standard input, does."""
    return QuestionProcess(DIAGNOSER)


def short(x: float | None, digits: int = 6) -> float | None:
    """A number rounded, so that a record is short and the same on every machine; None where it is not finite."""
    return float(f"{x:.{digits}g}") if x is not None and np.isfinite(x) else None


# The journal of finished work


@dataclass(frozen=True)
class JournalFormat(Generic[Key, Value]):
    """Lines of a journal: `line` makes the JSON object of a piece of work, and `entry` reads it back. It may raise
    KeyError, TypeError, ValueError or AttributeError for anything else.

    head: key of the first line that holds the hash of what was run; what, other: name of such a file, and of one that
    belongs to something else; option: the option of the command line that names it.
    """

    head: str
    what: str
    other: str
    option: str
    line: Callable[[Key, Value], Mapping[str, Any]]
    entry: Callable[[Mapping[str, Any]], tuple[Key, Value]]


class Journal(Generic[Key, Value]):
    """Finished work, one JSON line each, from which an interrupted run continues.

    The first line holds `run`, the hash of all that the work depends on: a journal of something else, or of the same
    before it was changed, is refused. Every line is on the disk before the next piece of work is taken; a last line
    that was cut short is dropped.
    """

    def __init__(self, path: Path, run: str, form: JournalFormat[Key, Value]):
        self.path, self._run, self._form = path, run, form

    @property
    def has_lines(self) -> bool:
        """Whether the file holds anything."""
        return self.path.exists() and self.path.stat().st_size > 0

    def read(self) -> dict[Key, Value]:
        """Work that was finished before; nothing when there is no file.

        Raises DataError when the file is the journal of something else, or no journal.
        """
        if not self.has_lines:
            return {}
        form = self._form
        lines = self.path.read_text(encoding="utf-8", errors="replace").split("\n")
        whole, cut = lines[:-1], lines[-1]
        head = _parsed_object(whole[0]) if whole else None
        if head is None or form.head not in head:
            raise DataError(f"{self.path}: not {form.what}; name another one with {form.option}")
        if head[form.head] != self._run:
            raise DataError(f"{self.path}: {form.other}; remove it or name another one with {form.option}")
        if cut:
            self._rewrite(whole)
        finished = {}
        for number, line in enumerate(whole[1:], start=2):
            found = _parsed_object(line)
            try:
                if found is None:
                    raise ValueError("not an object")
                key, value = form.entry(found)
            except (KeyError, TypeError, ValueError, AttributeError):
                raise DataError(f"{self.path}:{number}: not a line of {form.what}") from None
            finished[key] = value
        return finished

    def add(self, key: Key, value: Value) -> None:
        """Append one piece of work and wait until it is on the disk. Raises OSError."""
        lines = [] if self.has_lines else [self._head()]
        text = "".join(line + "\n" for line in (*lines, self._line(key, value)))
        with open(self.path, "ab", buffering=0) as stream:  # whole lines, whoever else adds to the file
            stream.write(text.encode())
            os.fsync(stream.fileno())

    def write(self, finished: Mapping[Key, Value]) -> None:
        """Replace the journal by these pieces of work, in their order. Raises OSError."""
        self._rewrite([self._head(), *(self._line(key, value) for key, value in finished.items())])

    def _head(self) -> str:
        return json.dumps({self._form.head: self._run})

    def _line(self, key: Key, value: Value) -> str:
        return json.dumps(self._form.line(key, value), ensure_ascii=False)

    def _rewrite(self, lines: Iterable[str]) -> None:
        """These lines, completely or not at all."""
        with open_output(self.path) as stream:
            stream.writelines(line + "\n" for line in lines)


def _parsed_object(line: str) -> dict[str, Any] | None:
    """The object of a line; None where it is none, as when it was cut short."""
    try:
        value = json.loads(line)
    except json.JSONDecodeError:
        return None
    return value if isinstance(value, dict) else None


def trials_journal(path: Path, key: str) -> Journal[int, Record]:
    """The journal of the campaign with this key: every trial with what it conceals and its marks, by number."""
    return Journal(path, key, _TRIALS)


def _trial_entry(line: Mapping[str, Any]) -> tuple[int, Record]:
    if not isinstance(line["trial"], int) or "marks" not in line:
        raise ValueError("not a trial")
    return line["trial"], line


_TRIALS = JournalFormat[int, Record](
    "plan",
    "a file of trials",
    "trials of another seed, choice or engine, or of this one before it was changed",
    "--trials-output",
    lambda _, record: record,
    _trial_entry,
)


# Rates


def clopper_pearson(hits: float, n: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Exact interval of a binomial rate: Clopper, C. J. and Pearson, E. S. (1934) Biometrika 26, 404–413."""
    from scipy.stats import beta

    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, hits, n - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, n - hits)) if hits < n else 1.0
    return low, high


def wilson(hits: float, n: float) -> tuple[float, float]:
    """95 % interval of a binomial rate: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209–212."""
    if not n:
        return 0.0, 1.0
    p, z2 = hits / n, NORMAL_95 * NORMAL_95
    centre, half = p + z2 / (2 * n), NORMAL_95 * np.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    return float(max(0.0, (centre - half) / (1 + z2 / n))), float(min(1.0, (centre + half) / (1 + z2 / n)))


def design_effect(hits: Sequence[float] | np.ndarray, counts: Sequence[float] | np.ndarray) -> float:
    """d of the equation above; 1 where there is one block, or all or none are hits."""
    h, n = np.asarray(hits, float), np.asarray(counts, float)
    h, n = h[n > 0], n[n > 0]
    if len(n) < 2:
        return 1.0
    p = h.sum() / n.sum()
    if p in (0.0, 1.0):
        return 1.0
    between = len(n) / (len(n) - 1) * float(np.sum((h - n * p) ** 2))
    return max(1.0, between / float(p * (1.0 - p) * n.sum()))


def exact_rate(hits: float, n: float, effect: float = 1.0) -> dict[str, float] | None:
    """Rate of counts with its exact interval, divided by the design effect; None where there is nothing to count."""
    if not n:
        return None
    low, high = clopper_pearson(hits / effect, n / effect)
    return {"rate": hits / n, "low": low, "high": high}


def _entry(rate: float | None, count: float, n: int, low: float | None, high: float | None) -> dict[str, Any]:
    return {"rate": rate, "count": count, "of": n, "low": low, "high": high}


def mean(values: Sequence[float]) -> dict[str, Any]:
    """Mean over trials with its 95 % interval by their scatter; `count` is their sum."""
    n, m, total = len(values), float(np.mean(values)), float(np.sum(values))
    if n < 2:
        return _entry(m, total, n, None, None)
    half = NORMAL_95 * float(np.std(values, ddof=1)) / np.sqrt(n)
    low, high = m - half, m + half
    if 0.0 <= min(values) and max(values) <= 1.0:  # shares
        low, high = max(low, 0.0), min(high, 1.0)
    return _entry(m, total, n, low, high)


def median(values: Sequence[float]) -> dict[str, Any]:
    """Median over trials with its 95 % interval by order statistics, for any distribution: W. J. Conover, Practical
    Nonparametric Statistics (1999) section 3.2. An end is None where trials are too few; `count` is their sum."""
    from scipy.stats import binom

    x, n = np.sort(np.asarray(values, float)), len(values)
    below = int(binom.ppf((1 - CONFIDENCE) / 2, n, 0.5)) - 1  # P(fewer than below + 1 lie under the median) ≤ 2.5 %
    ends = (float(x[below]), float(x[n - 1 - below])) if 0 <= below < n - 1 - below else (None, None)
    return _entry(float(np.median(x)), float(np.sum(x)), n, *ends)


def rate(marks: Iterable[Any], blocks: Iterable[int] | None = None) -> dict[str, Any]:
    """Rate of the marks of trials with its 95 % interval.

    Parameters
    ----------
    marks
        True or False of each trial; or of each a list of shares or sizes, of which the mean is taken. A list of 0 and 1
        counts each as a mark of its own.
    blocks
        Number of the block of each trial, where trials share something.

    Returns
    -------
    dict
        `rate`, `count`, `of`, `low`, `high`; the rate is None where no trial counts.
    """
    marks = list(marks)
    if not marks:
        return _entry(None, 0, 0, None, None)
    effect = 1.0
    if isinstance(marks[0], bool):
        hits, n = sum(marks), len(marks)
        if blocks is not None:
            _, place = np.unique(np.fromiter(blocks, int), return_inverse=True)
            effect = design_effect(np.bincount(place, np.asarray(marks, float)), np.bincount(place))
    else:
        flat = [float(x) for mark in marks for x in mark]
        if not all(x in (0.0, 1.0) for x in flat):
            return mean([float(np.mean(mark)) for mark in marks])
        hits, n = int(sum(flat)), len(flat)
    return _entry(hits / n, hits, n, *wilson(hits / effect, n / effect))


def right_less_stated(stated: Sequence[tuple[float, bool]], low: float, high: float) -> dict[str, Any]:
    """Rate of right answers less the mean stated probability, of those stated from `low` to `high`."""
    own = [(p, right) for p, right in stated if low <= p < high]
    found = rate(right for _, right in own)
    if not own:
        return found
    mean_stated = float(np.mean([p for p, _ in own]))
    return found | {name: found[name] - mean_stated for name in ("rate", "low", "high")}


def reliability_bin(low: float, high: float, stated: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """A bin of stated probability: how often answers of it are right, and by how much more often than stated."""
    right, n, mean_stated = sum(bool(r) for _, r in stated), len(stated), float(np.mean([p for p, _ in stated]))
    least, most = wilson(right, n)
    row = {"from": low, "to": high, "stated": mean_stated, "rate": right / n, "gap": right / n - mean_stated}
    return row | {"count": right, "of": n, "low": least, "high": most}


# Rates in tables


def numbers(entry: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a rate."""
    return {k: entry[k] for k in ("rate", "count", "of", "low", "high")}


def cell(entry: Mapping[str, Any]) -> str:
    """A rate with its interval and the number of trials, as text."""
    if not entry["of"]:
        return ""
    if entry["low"] is None:
        return f"{entry['rate']:.3f} n {entry['of']}"
    return f"{entry['rate']:.3f} ({entry['low']:.3f}–{entry['high']:.3f}) n {entry['of']}"


def target_words(target: str | None) -> str:
    """A target as people write it."""
    return (target or "").replace(">=", "≥").replace("<=", "≤")


def target_met(value: float | None, target: str | None) -> str:
    """Whether the rate itself, not its interval, meets a target: "yes", "no", or "" without one."""
    if not target or value is None:
        return ""
    if " to " in target:
        low, high = map(float, target.split(" to "))
        return "yes" if low <= value <= high else "no"
    sign, limit = target.split()
    if sign == "within":
        return "yes" if abs(value) <= float(limit) else "no"
    return "yes" if (value >= float(limit) if sign == ">=" else value <= float(limit)) else "no"


def versions() -> dict[str, str]:
    """Versions of the program and of the libraries that its numbers depend on."""
    import scipy

    return {"enginediag": __version__, "numpy": np.__version__, "scipy": scipy.__version__}
