"""What the methods of a study read: the windows of a batch, and their scores, computed once for all methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from time import process_time

import numpy as np

from enginediag_cli.methods.families.base import FittedFamily, Windows
from enginediag_cli.residuals.local import block_statistics
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.relinearise import relinearise
from enginediag_cli.residuals.score import Score, fisher_score

SMALL_STEP = 0.02
"""Step of a parameter, in its prior standard deviations, over which the model is as good as linear: for the 2 % of
health parameters the second order is below 1e-6, the noise of a mean of thousands of records above 1e-5."""


@dataclass
class Evidence:
    """Windows with the number of changes `faults` (W,) in each, which only methods that are told it may read.

    trained(name): a family of residuals that knows the engine; `cost`: CPU seconds spent on shared scores; `used`:
    what the method at work has asked for.
    """

    monitor: Monitor
    windows: Windows
    faults: np.ndarray
    false_alarm: float
    trained: Callable[[str], FittedFamily]
    cost: dict[str, float] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    _nominal: _Prediction | None = None
    _last: _Prediction | None = None
    _scores: dict[str, tuple[list[Score], np.ndarray]] = field(default_factory=dict)

    def scores(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        """Score of each window at its own "estimate" or at "nominal", and which converged (W,)."""
        self.used |= {"predictions", linearise}
        if self._last is None:
            begun = process_time()
            self._last = self._predicted(np.tile(self.monitor.theta0, (len(self._window), 1)))
            self._nominal = self._last.copy()
            self.cost["predictions"] = process_time() - begun
        if linearise not in self._scores:
            begun = process_time()
            self._scores[linearise] = self._linearised(linearise)
            self.cost[linearise] = process_time() - begun
        return self._scores[linearise]

    @property
    def _window(self) -> np.ndarray:
        return np.repeat(np.arange(self.windows.count), self.windows.length)

    def _linearised(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        monitor, nominal = self.monitor, self._nominal
        assert nominal is not None
        W, n, m = self.windows.y.shape
        y = self.windows.y.reshape(-1, m)
        if linearise == "nominal":
            e, J, ok, converged = y - nominal.y, nominal.J, nominal.ok, np.ones(W, bool)
        else:
            found = relinearise(
                self._predict,
                y,
                monitor.theta0,
                monitor.precision,
                monitor.noise,
                window=self._window,
                nominal=(nominal.y, nominal.J, nominal.ok),
                bounds=(monitor.lower, monitor.upper),
            )
            e, J, ok, converged = found.e, found.J, found.ok, found.converged
        lags = np.ones(W * n)
        lags[::n] = np.inf  # windows are unrelated
        blocks = block_statistics(
            np.where(ok[:, None], e, np.nan),
            J,
            monitor.noise,
            np.arange(W) * n,
            parameters=monitor.names,
            theta0=monitor.theta0,
            prior_sigma=monitor.prior_sigma,
            meaning=monitor.meaning,
            lags=lags,
        )
        return [fisher_score(block.statistics) for block in blocks], converged

    def _predict(self, theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Model and sensitivities, evaluated anew where θ has moved by more than SMALL_STEP since the last time."""
        last = self._last
        assert last is not None
        step = theta - last.theta[rows]
        far = np.any(np.abs(step) > SMALL_STEP * self.monitor.prior_sigma, axis=1)
        if far.any():
            at = rows[far]
            last.put(at, self._predicted(theta[far], at, last.x[:, at]))
        beyond = np.where(far[:, None], 0.0, step)
        y = last.y[rows] + np.einsum("kjp,kp->kj", last.J[rows], beyond)
        return y, last.J[rows], last.ok[rows]

    def _predicted(
        self, theta: np.ndarray, rows: np.ndarray | slice = slice(None), start: np.ndarray | None = None
    ) -> _Prediction:
        """One call of the engine for records `rows` at theta (n, p), from the unknowns `start` (nx, n)."""
        names = self.monitor.names
        same = np.all(theta == theta[:1], axis=0)
        values = {name: float(theta[0, i]) if same[i] else theta[:, i] for i, name in enumerate(names)}
        found = self.monitor.engine.predict(  # type: ignore[call-arg]
            {c: v[rows] for c, v in self.windows.flat_inputs().items()},
            values,
            sensors=self.monitor.sensors,
            wrt=names,
            start=start,
        )
        return _Prediction(
            theta, np.asarray(found.y), np.asarray(found.jacobian), np.asarray(found.ok), np.asarray(found.x)
        )


@dataclass
class _Prediction:
    """theta (n, p), y (n, m), J (n, m, p), ok (n,), unknowns x (nx, n) of n records."""

    theta: np.ndarray
    y: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    x: np.ndarray

    def copy(self) -> _Prediction:
        return _Prediction(*(np.array(getattr(self, f.name)) for f in fields(self)))

    def put(self, rows: np.ndarray, new: _Prediction) -> None:
        """Replace the records `rows`."""
        self.theta[rows], self.y[rows], self.J[rows], self.ok[rows] = new.theta, new.y, new.J, new.ok
        self.x[:, rows] = new.x
