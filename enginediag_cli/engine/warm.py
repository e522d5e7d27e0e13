"""An engine that begins where it ended: for fits, which solve the same records again and again.

From one iteration of a fit to the next the parameters move a little and the operating points not at all, so the
last solution of the same records is a far better start than any other, and records that do not converge from
afar do so from there.
Records that are new begin at the solution of the nearest operating point. And what was predicted last is known:
a fit asks for it again, for the covariance of its estimates and where its next pass begins.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from enginediag_cli.engine.engine import Engine, Prediction
from enginediag_cli.engine.wrapped import Question, WrappedModel

REMEMBERED = 300_000
"""Records whose solution is kept, 200 bytes each: a fit in blocks comes back to the first after the last."""
KEPT = 5_000_000
"""Numbers of the predictions that are kept, the last ones, 40 MB."""
MOVED, BATCHES = 0.02, 40
"""Share of the largest value of each input by which records may have moved to be taken for the same, and batches, the
last that were solved, among which they are sought. Judgement: from as far as that an iteration converges at once."""
NEIGHBOURS = 4
"""Batches, the last that were solved, among whose operating points new records look for the nearest."""

Model = TypeVar("Model")
Memory = OrderedDict[int, tuple[np.ndarray, np.ndarray]]
"""Operating points (N, d) and unknowns (nx, N) of batches, by what tells them apart, the last one last."""


class WarmEngine(WrappedModel):
    """`engine` with a memory of the unknowns of its last batches, or with that of another engine of the same unknowns,
    `like`; everything else is the engine's own. `walk`: records that had a solution and lose it are sought in every
    way; without, parameters that lose them are too far."""

    def __init__(
        self, engine: Engine, remembered: int = REMEMBERED, *, walk: bool = True, like: WarmEngine | None = None
    ):
        super().__init__(engine, {})
        self._walk, self._remembered = walk, remembered
        self._last: Memory = OrderedDict()
        self._found: OrderedDict[int, _Found] = OrderedDict()
        if like is not None and like.model.unknowns == engine.unknowns:
            self._last = like._last

    def _answer(self, asked: Question) -> Prediction:
        """From the remembered start, on which the answer does not depend beyond the solver's tolerance."""
        points = self._points(asked.inputs)
        key = hash(points.tobytes())
        known = self._last.get(key)
        met = known is not None and np.array_equal(known[0], points)
        before = self._found.get(key)
        if before is not None and before.asked.same(asked):
            return before.prediction
        start = known[1] if known is not None and met else self._moved(points)
        start = self._nearest(points) if start is None else start
        ways = {} if self._walk or not met else {"walk": False}
        found: Prediction = self._ask(asked, options={**asked.options, "start": start, **ways})
        # a point that failed keeps the start that it had: the next parameters may suit it again
        x = np.where(found.ok, found.x, np.nan if start is None else start)
        if len(points) == found.y.shape[0] and np.isfinite(x).any():
            self._last[key] = points, x
            self._last.move_to_end(key)
            while len(self._last) > 1 and sum(len(p) for p, _ in self._last.values()) > self._remembered:
                self._last.popitem(last=False)
        self._found.pop(key, None)
        self._found[key] = _Found(replace(asked, inputs=dict(asked.inputs)), found)
        while sum(f.size for f in self._found.values()) > KEPT:
            self._found.popitem(last=False)
        return found

    @contextmanager
    def apart(self) -> Iterator[None]:
        """What is solved inside is forgotten: whatever comes next begins where it would have begun without it."""
        last, found = self._last.copy(), self._found.copy()
        try:
            yield
        finally:
            self._last.clear()  # others may share it
            self._last.update(last)
            self._found.clear()
            self._found.update(found)

    @property
    def memory(self) -> tuple[Memory, Any]:
        """Where records had their solutions, and what effects remember of recordings, for another process."""
        return self._last, self.model.recalled

    def remember(self, memory: tuple[Memory, Any]) -> None:
        """Begin where another process has ended."""
        self._last, recalled = memory
        self.model.recall_again(recalled)

    def rest(self) -> None:
        """Forget what was predicted last: the fit is over."""
        self._found.clear()

    def _points(self, inputs: Mapping[str, Any]) -> np.ndarray:
        """Operating points (N, d): all inputs that the engine must have."""
        return np.column_stack(np.broadcast_arrays(*(np.atleast_1d(np.asarray(inputs[c], float)) for c in self.inputs)))

    def _moved(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (nx, N) of the remembered batch of which these are the same records, read a little otherwise: as a
        fit reads its inputs when it seeks their errors. None where there is no such batch."""
        size = np.maximum(np.abs(points).max(axis=0, initial=0.0), 1e-9)
        best, found = MOVED, None
        for key in islice(reversed(self._last), BATCHES):
            before, x = self._last[key]
            if before.shape == points.shape and (far := float(np.abs((before - points) / size).max())) < best:
                best, found = far, x
        return found

    def _nearest(self, points: np.ndarray) -> np.ndarray | None:
        """Unknowns (nx, N) of the nearest remembered operating points; None when there are none."""
        from scipy.spatial import cKDTree

        if not self._last or not np.isfinite(points).all():
            return None
        last = [self._last[key] for key in islice(reversed(self._last), NEIGHBOURS)]
        known = np.concatenate([p for p, _ in last])
        x = np.concatenate([x for _, x in last], axis=1)
        solved = np.isfinite(x).all(axis=0) & np.isfinite(known).all(axis=1)
        if not solved.any():
            return None
        scale = np.maximum(np.ptp(known[solved], axis=0), 1e-9)
        return np.asarray(x[:, solved][:, cKDTree(known[solved] / scale).query(points / scale)[1]])


@dataclass(frozen=True)
class _Found:
    """A prediction, and what it was asked for."""

    asked: Question
    prediction: Prediction

    @property
    def size(self) -> int:
        """Numbers that it holds, mostly."""
        return self.prediction.jacobian.size


def warm(model: Model) -> Model | WarmEngine:
    """The model with a memory, if it is an engine; any other model as it is."""
    return WarmEngine(model) if isinstance(model, Engine) else model


def apart(model: Any) -> AbstractContextManager[None]:
    """`WarmEngine.apart` of the engine with a memory that a model wraps, if it does."""
    own = getattr(model, "apart", None)
    return nullcontext() if own is None else own()
