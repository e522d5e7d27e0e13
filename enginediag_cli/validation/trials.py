"""The journal of trials: finished work, one JSON line each, from which an interrupted run goes on.

The first line says what was run: a journal of something else, or of the same before it was changed, is refused. Every
line is on the disk before the next piece of work counts as begun; a last line cut short is dropped.

Rates and means with 95 % intervals: of counts, exact; of the marks of many trials, by Wilson.

Studies quote Clopper and Pearson's interval, which is never too short; score sheets Wilson's, whose coverage is right
on average and which is shorter for few trials. Documents quote both, so both stay.

Trials that share something, operating points or an engine, come in blocks: with h_b hits among n_b trials of block b
and the rate p of all, they are worth n/d independent trials, with the design effect

    d = B/(B − 1) · Σ_b (h_b − n_b p)² / (p (1 − p) Σ_b n_b),     1 at least

(L. Kish, Survey Sampling (1965) section 5.4), so that intervals hold for other blocks, those of another seed, too.

The diagnosing process, which knows nothing but what it is asked.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.parallel import QuestionProcess
from enginediag_cli.recordings.write import output

Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Form(Generic[Key, Value]):
    """How finished work stands in a journal: `line` makes the JSON object of a piece, `entry` reads it back and may
    raise KeyError, TypeError, ValueError or AttributeError for something else.

    head: key of the first line under which stands what was run; what, other: what such a file is called, and one that
    belongs to something else; option: that of the command line which names it.
    """

    head: str
    what: str
    other: str
    option: str
    line: Callable[[Key, Value], Mapping[str, Any]]
    entry: Callable[[Mapping[str, Any]], tuple[Key, Value]]


class Journal(Generic[Key, Value]):
    """A file to which finished work is added, each piece at once and to stay; `run`: hash of all that it depends on."""

    def __init__(self, path: Path, run: str, form: Form[Key, Value]):
        self.path, self._run, self._form = path, run, form

    @property
    def begun(self) -> bool:
        """Whether the file holds anything."""
        return self.path.exists() and self.path.stat().st_size > 0

    def read(self) -> dict[Key, Value]:
        """What was finished before; nothing when there is no file.

        Raises DataError when the file is the journal of something else, or no journal.
        """
        if not self.begun:
            return {}
        form = self._form
        lines = self.path.read_text(encoding="utf-8", errors="replace").split("\n")
        whole, cut = lines[:-1], lines[-1]
        head = _parsed(whole[0]) if whole else None
        if head is None or form.head not in head:
            raise DataError(f"{self.path}: not {form.what}; name another one with {form.option}")
        if head[form.head] != self._run:
            raise DataError(f"{self.path}: {form.other}; remove it or name another one with {form.option}")
        if cut:
            self._rewrite(whole)
        finished = {}
        for number, line in enumerate(whole[1:], start=2):
            found = _parsed(line)
            try:
                if found is None:
                    raise ValueError("not an object")
                key, value = form.entry(found)
            except (KeyError, TypeError, ValueError, AttributeError):
                raise DataError(f"{self.path}:{number}: not a line of {form.what}") from None
            finished[key] = value
        return finished

    def add(self, key: Key, value: Value) -> None:
        """Append one piece and see it on the disk. Raises OSError."""
        lines = [] if self.begun else [self._head()]
        text = "".join(line + "\n" for line in (*lines, self._line(key, value)))
        with open(self.path, "ab", buffering=0) as stream:  # whole lines, whoever else adds to the file
            stream.write(text.encode())
            os.fsync(stream.fileno())

    def write(self, finished: Mapping[Key, Value]) -> None:
        """Replace the journal by one of these pieces, in their order. Raises OSError."""
        self._rewrite([self._head(), *(self._line(key, value) for key, value in finished.items())])

    def _head(self) -> str:
        return json.dumps({self._form.head: self._run})

    def _line(self, key: Key, value: Value) -> str:
        return json.dumps(self._form.line(key, value), ensure_ascii=False)

    def _rewrite(self, lines: Iterable[str]) -> None:
        """These lines, completely or not at all."""
        with output(self.path) as stream:
            stream.writelines(line + "\n" for line in lines)


def _parsed(line: str) -> dict[str, Any] | None:
    """The object of a line; None where it is none, as when it was cut short."""
    try:
        value = json.loads(line)
    except json.JSONDecodeError:
        return None
    return value if isinstance(value, dict) else None


CONFIDENCE = 0.95
"""Of every interval of a rate: two-sided, as is usual."""


def clopper_pearson(hits: float, n: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Exact interval of a binomial rate: Clopper, C. J. and Pearson, E. S. (1934) Biometrika 26, 404–413."""
    from scipy.stats import beta

    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, hits, n - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, n - hits)) if hits < n else 1.0
    return low, high


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


def counted(hits: float, n: float, effect: float = 1.0) -> dict[str, float] | None:
    """Rate of counts with its exact interval, of as many trials as they are worth; None where there is nothing to
    count."""
    if not n:
        return None
    low, high = clopper_pearson(hits / effect, n / effect)
    return {"rate": hits / n, "low": low, "high": high}


def wilson(count: float, of: float) -> tuple[float, float]:
    """95 % interval of a binomial rate: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209–212."""
    if not of:
        return 0.0, 1.0
    p, z2 = count / of, NORMAL_95 * NORMAL_95
    centre, half = p + z2 / (2 * of), NORMAL_95 * np.sqrt(p * (1 - p) / of + z2 / (4 * of * of))
    return float(max(0.0, (centre - half) / (1 + z2 / of))), float(min(1.0, (centre + half) / (1 + z2 / of)))


def mean(values: Sequence[float]) -> dict[str, Any]:
    """Mean of trials with its 95 % interval by their scatter; `count` is their sum."""
    n = len(values)
    m = float(np.mean(values))
    if n < 2:
        return {"rate": m, "count": float(np.sum(values)), "of": n, "low": None, "high": None}
    half = NORMAL_95 * float(np.std(values, ddof=1)) / np.sqrt(n)
    low, high = m - half, m + half
    if 0.0 <= min(values) and max(values) <= 1.0:  # shares
        low, high = max(low, 0.0), min(high, 1.0)
    return {"rate": m, "count": float(np.sum(values)), "of": n, "low": low, "high": high}


def median(values: Sequence[float]) -> dict[str, Any]:
    """Median of trials with its 95 % interval by order statistics, whatever they are distributed like: W. J. Conover,
    Practical Nonparametric Statistics (1999) section 3.2. None for an end that too few trials have; `count` is their
    sum."""
    from scipy.stats import binom

    x, n = np.sort(np.asarray(values, float)), len(values)
    below = int(binom.ppf((1 - CONFIDENCE) / 2, n, 0.5)) - 1  # P(fewer than below + 1 lie under the median) ≤ 2.5 %
    ends = (float(x[below]), float(x[n - 1 - below])) if 0 <= below < n - 1 - below else (None, None)
    return {"rate": float(np.median(x)), "count": float(np.sum(x)), "of": n, "low": ends[0], "high": ends[1]}


def rate(marks: Iterable[Any], blocks: Iterable[int] | None = None) -> dict[str, Any]:
    """Of the marks of trials, which may come in numbered `blocks`: True or False each; or each a list of shares or
    sizes, of which the mean is taken. A list of 0 and 1 counts each as a mark of its own. Empty values where no
    trial counts."""
    marks = list(marks)
    if not marks:
        return {"rate": None, "count": 0, "of": 0, "low": None, "high": None}
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
    low, high = wilson(hits / effect, n / effect)
    return {"rate": hits / n, "count": hits, "of": n, "low": low, "high": high}


DIAGNOSER = "enginediag_cli.validation.diagnoser"
EXPLAIN, LOCATE, PLAN, ISOLATE = "explain", "locate", "plan", "isolate"
"""What the diagnosing process may be asked."""


@lru_cache(maxsize=1)
def diagnoser() -> QuestionProcess:
    """The diagnosing process of this worker; it ends when the worker, and with it its standard input, does."""
    return QuestionProcess(DIAGNOSER)
