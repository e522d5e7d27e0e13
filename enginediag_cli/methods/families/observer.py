"""Observers: parameters as random-walk states, measured through the engine, filtered record by record.

    x_k = x_{k−1} + w_k,  w ~ N(0, Q)          y_k = Φ(u_k, θ0 + D x_k) + v_k,  v ~ N(0, R)      (D: prior sigmas)

The engine is a static map, so the parameters are the only states (paper, section 4.2). Nuisance parameters are
constant states of the covariance that identification left them. A filter starts at nominal with covariance
P_0 = C + initial²; over a window of n records its parameters may wander `walk` prior standard deviations.

    innovation  ν = y − ŷ,  S = H P Hᵀ + R,  K = P Hᵀ S⁻¹,  x ← x + K ν,  P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ

How H P Hᵀ and P Hᵀ are found is what tells the extended and the unscented filter apart. All windows advance
together, one record at a time. Tests: see `innovation_tests`.
Jazwinski, A. H. (1970) Stochastic Processes and Filtering Theory; Mehra, R. K. and Peschon, J. (1971)
Automatica 7, 637–640 (innovations for fault detection).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.families.innovations import (
    NO_VARIANCE,
    Healthy,
    Innovation,
    InnovationRecord,
    final_state_test,
    innovation_tests,
)
from enginediag_cli.methods.families.sums import holm
from enginediag_cli.methods.verdicts import PARAMETERS, Verdicts
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor

TESTS = ("nis", "whiteness", "state")
OBSERVER_OPTIONS = (
    Field("walk", "number", "how far parameters may wander in a window, in prior deviations", 0.1, minimum=0.0),
    Field("initial", "number", "how far they may be off at its start, in prior deviations", 0.0, minimum=0.0),
    Field("lags", "integer", "lags of the whiteness test", 3, minimum=1),
    Field("tests", "texts", "which tests may raise the alarm: nis, whiteness, state", TESTS),
)


@dataclass(frozen=True)
class Linearisation:
    """A record of every window seen from the filter's state, readings in units of their noise.

    mean (W, m); spread (W, m, m) = H P Hᵀ; cross (W, p, m) = P Hᵀ; H (W, m, p); ok (W,).
    """

    mean: np.ndarray
    spread: np.ndarray
    cross: np.ndarray
    H: np.ndarray
    ok: np.ndarray


@dataclass(frozen=True)
class Earlier:
    """The record before, about the state x (W, p) of that time: y (W, m), H (W, m, p), weight c = ρ (W, m).

    Noise of lag-1 correlation ρ is whitened by subtracting ρ times the record before, carried linearly to
    the present state; c is zero where either reading is missing.
    """

    x: np.ndarray
    y: np.ndarray
    H: np.ndarray
    c: np.ndarray

    def share(self, points: np.ndarray) -> np.ndarray:
        """c · (ŷ of the record before) at the states points (W, q, p) -> (W, q, m)."""
        moved = (points - self.x[:, None]) @ np.swapaxes(self.H, 1, 2)
        return np.asarray(self.c[:, None] * (self.y[:, None] + moved))


@dataclass(frozen=True)
class ObserverResult(Verdicts):
    """Adds the trajectories of the monitored parameters (W, n, p) with their standard deviations, in their units,
    and the normalised innovations squared of every record (W, n)."""

    trajectory: np.ndarray
    deviation: np.ndarray
    nis: np.ndarray


@dataclass(frozen=True)
class Observer(Method, ABC):
    """Common to the filters. walk, initial: tuning in prior standard deviations; lags of the whiteness test.

    tests: which of "nis", "whiteness" and "state" may raise the alarm; they share its false-alarm probability.
    """

    OPTIONS: ClassVar[tuple[Field, ...]] = OBSERVER_OPTIONS
    walk: float = 0.1
    initial: float = 0.0
    lags: int = 3
    tests: tuple[str, ...] = TESTS

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> FittedMethod:
        if not (self.walk >= 0 and self.initial >= 0 and self.walk + self.initial > 0):
            raise ValueError("`walk` and `initial` must not be negative, and one of them must be positive")
        if not self.tests or set(self.tests) - set(TESTS):
            raise ValueError(f"`tests` must be among {', '.join(TESTS)}")
        if self.lags < 1:
            raise ValueError("`lags` must be at least 1")
        return _Fitted(monitor, self)

    @abstractmethod
    def linearise(self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: Earlier) -> Linearisation:
        """Record k of every window seen from the states x (W, p) of covariance P (W, p, p)."""


@dataclass(frozen=True)
class ScaledModel:
    """The engine with states in prior standard deviations and readings in units of their noise."""

    monitor: Monitor
    inputs: Mapping[str, np.ndarray]

    def __call__(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (W, m), H (W, m, p), ok (W,) at the states x (W, p) for record k of every window."""
        monitor = self.monitor
        y, J, ok, _ = monitor.predict({c: v[:, k] for c, v in self.inputs.items()}, self._theta(x))
        H = J * (monitor.prior_sigma / monitor.noise.sigma[:, None])
        return np.where(ok[:, None], y / monitor.noise.sigma, 0.0), np.where(ok[:, None, None], H, 0.0), ok

    def outputs(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """y (W, q, m) at q states per window x (W, q, p), and ok (W,) where all of them can be computed."""
        W, q, p = x.shape
        blind = replace(self.monitor, monitored=())  # no sensitivities: the engine is asked for outputs only
        inputs = {c: np.repeat(v[:, k], q) for c, v in self.inputs.items()}
        y, _, computed, _ = blind.predict(inputs, self._theta(x.reshape(-1, p)), nuisance=False)
        ok = np.asarray(np.all(computed.reshape(W, q), axis=1))
        return np.where(ok[:, None, None], (y / self.monitor.noise.sigma).reshape(W, q, -1), 0.0), ok

    def _theta(self, x: np.ndarray) -> np.ndarray:
        theta = self.monitor.theta0 + self.monitor.prior_sigma * x
        return np.clip(theta, self.monitor.lower, self.monitor.upper)


@dataclass(frozen=True)
class _Fitted(FittedMethod):
    monitor: Monitor
    family: Observer

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> ObserverResult:
        from scipy.stats import chi2

        monitor, family = self.monitor, self.family
        a, scale = len(monitor.monitored), monitor.prior_sigma
        record, x, P, healthy, path, spread = self._filter(windows)
        level = false_alarm / len(family.tests)
        tests = {test.name: test for test in innovation_tests(record, family.lags, level)}
        tests["state"] = final_state_test(x[:, :a], healthy.state_covariance()[:, :a, :a], level)
        wald = x[:, :a] ** 2 / np.maximum(np.einsum("wii->wi", P)[:, :a], NO_VARIANCE)
        chosen = tuple(tests[name] for name in family.tests)
        alarm = np.asarray(np.any([test.alarm for test in chosen], axis=0))
        return ObserverResult(
            family.name,
            chosen,
            PARAMETERS,
            monitor.monitored,
            "Wald statistic of the final state, chi-square with 1 degree of freedom",
            wald,
            holm(chi2.sf(wald, 1), false_alarm) & alarm[:, None],
            np.ones(windows.count, bool),
            monitor.theta0[:a] + scale[:a] * path,
            scale[:a] * spread,
            record.nis,
        )

    def _filter(
        self, windows: Windows
    ) -> tuple[InnovationRecord, np.ndarray, np.ndarray, Healthy, np.ndarray, np.ndarray]:
        """Innovations of all records, final state (W, p) and covariance, and the path of the monitored states."""
        monitor, family = self.monitor, self.family
        W, n, m = windows.y.shape
        a, p, scale = len(monitor.monitored), len(monitor.names), monitor.prior_sigma
        C = monitor.uncertainty / scale / scale[:, None]
        own = np.arange(p) < a
        ends = windows.ends
        Q = np.where(own, family.walk**2, 0.0) / np.maximum(ends, 1)[:, None]
        x, P = np.zeros((W, p)), np.tile(C + np.diag(np.where(own, family.initial**2, 0.0)), (W, 1, 1))
        healthy = Healthy.start(C, W, family.lags)
        model, readings = ScaledModel(monitor, windows.inputs), windows.y / monitor.noise.sigma
        correlation = _between_sensors(monitor)
        record = InnovationRecord.empty(W, n, m, family.lags)
        path, spread, diagonal = np.zeros((W, n, a)), np.zeros((W, n, a)), np.arange(p)
        earlier = Earlier(x, np.zeros((W, m)), np.zeros((W, m, p)), np.zeros((W, m)))
        before, earlier_reading = np.zeros((W, m), bool), np.zeros((W, m))
        for k in range(n):
            # what fills a window up is no time in which anything could have wandered
            P[:, diagonal, diagonal] += np.where((k < ends)[:, None], Q, 0.0)
            present = np.isfinite(readings[:, k])
            c = np.where(present & before, monitor.noise.rho, 0.0)
            earlier = Earlier(earlier.x, earlier.y, earlier.H, c)
            seen = family.linearise(model, x, P, k, earlier)
            present = present & seen.ok[:, None]
            reading = np.where(present, readings[:, k], 0.0)
            nu = np.where(present, reading - c * earlier_reading - seen.mean, 0.0)
            both = present[:, :, None] & present[:, None, :]
            H = np.where(present[:, :, None], seen.H, 0.0)
            R = np.where(both, correlation, 0.0) + np.einsum("wi,ij->wij", ~present * 1.0, np.eye(m))
            R = R - np.einsum("wi,ij->wij", c**2 * present, np.eye(m))
            S = np.where(both, seen.spread, 0.0) + R
            K = np.swapaxes(np.linalg.solve(S, np.swapaxes(np.where(present[:, None], seen.cross, 0.0), 1, 2)), 1, 2)
            healthy = record.add(k, Innovation(nu, S, H, R, K, present), healthy)
            # the record itself, without the share of the one before, is what the next one looks back to
            own_H = seen.H + c[:, :, None] * earlier.H
            own_y = seen.mean + earlier.share(x[:, None])[:, 0]
            earlier, earlier_reading, before = Earlier(x, own_y, own_H, c), reading, present
            x = x + np.einsum("wpm,wm->wp", K, nu)
            P = P - K @ S @ np.swapaxes(K, 1, 2)
            P = (P + np.swapaxes(P, 1, 2)) / 2
            path[:, k], spread[:, k] = x[:, :a], np.sqrt(np.maximum(np.einsum("wii->wi", P)[:, :a], 0.0))
        return record, x, P, healthy, path, spread


def _between_sensors(monitor: Monitor) -> np.ndarray:
    """Correlation (m, m) between the noises of sensors at the same time, in units of sigma."""
    sigma, covariance = monitor.noise.sigma, monitor.noise.covariance
    return np.eye(len(sigma)) if covariance is None else covariance / sigma / sigma[:, None]
