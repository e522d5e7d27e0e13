"""One free amplitude per record at one place: where does whatever varies from record to record act?

For effects that move the engine far (guide vanes close a compressor by a quarter) no column at the nominal point is
good enough. Each place in turn gets an amplitude a_k of its own in every record, with no prior at all, and the
nuisance is identified along with them, nonlinearly:

    min over θ, a of  Σ_k |(y_k − Φ(u_k, θ, a_k))/σ|² + |x|²        x = θ in prior standard deviations

Every a_k meets only its own record, so it is eliminated from the normal equations: with J_k, c_k and e_k whitened,

    S = Σ_k J_kᵀ P_k J_k + 1,   P_k = 1 − c_k c_kᵀ/|c_k|²,   dx = −S⁻¹ g,   da_k = c_kᵀ(e_k − J_k dx)/|c_k|²

Places are compared by the χ² per record that is left; all have the same number of amplitudes. The right place fits
with every sensor; a wrong one trades one against the other. Needs two sensors or more that the place moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import INLET_TEMPERATURE, drivers
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import NUMBER
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, Hypothesis, Nuisance, input_values, problem_with
from enginediag_cli.mismatch.unrecorded.refit import with_lever
from enginediag_cli.progress import each

ITERATIONS = 150
"""Of θ with all amplitudes; thousands of unknowns with stops move slowly."""
TOLERANCE, SHARE = 1e-4, 1e-3
"""A fit has converged when a full step lowers χ² by less than the first per record, or by less than the second of χ²
itself, where it fits badly anyway."""

LONGEST = 0.05
"""Longest step of an amplitude, in the parameter's size at nominal (10 prior standard deviations where that is 0)."""

FAINT = 1e-3
"""An amplitude whose prior standard deviation moves no reading by this many σ leaves no trace in that record."""

DAMPING, RELIEF, UNDAMPED, HEAVY = 1e-3, 0.2, 0.02, 1e4
"""Levenberg–Marquardt: the first damping, its factor after a step that gained, up to where a step counts as undamped
and may end the fit, and from where it has given up. Judgement."""
SETTLED = 0.01  # standard errors of one record
FOLLOW = 2
"""Iterations of the amplitudes after a trial step of θ: enough to judge the step."""
ALONE = 8  # iterations of the amplitudes before θ moves


@dataclass(frozen=True)
class PerRecord:
    """A fit of N records of m sensors with a free amplitude in each; look at `converged`.

    `amplitude` (N,) of `parameter` about its value in `theta`, NaN where no reading shows it; `standard_error` (N,)
    of one record alone at given θ; `residual` (N, m) in σ, NaN where there is no reading; `at_bound`: identified
    parameters at a physical bound, which is the cheapest alarm of missing physics; `rows`, `direction`: whitened
    derivatives (N, m, p) by x and (N, m) by the amplitude, for tests at the fit.
    """

    location: Location | None
    hypothesis: Hypothesis
    theta: Mapping[str, float]
    x: np.ndarray
    amplitude: np.ndarray
    standard_error: np.ndarray
    residual: np.ndarray
    rows: np.ndarray
    direction: np.ndarray
    sensors: tuple[str, ...]
    sigma: np.ndarray
    number: np.ndarray
    recording: np.ndarray
    inputs: Mapping[str, np.ndarray]
    at_bound: tuple[str, ...]
    failed: int
    converged: bool

    @property
    def name(self) -> str:
        return "nothing" if self.location is None else self.location.name

    @property
    def words(self) -> str:
        return "nothing" if self.location is None else self.location.words

    @property
    def objective(self) -> float:
        """χ² of readings and priors."""
        return float(np.nansum(self.residual**2) + self.x @ self.x)

    @property
    def per_record(self) -> float:
        """χ² of the readings per record."""
        there = np.isfinite(self.residual).any(axis=1)
        return float(np.nansum(self.residual**2) / max(1, there.sum()))


def fit_per_record(
    evidence: Dataset,
    place: Location | None,
    along: Nuisance,
    hypothesis: Hypothesis = NULL_HYPOTHESIS,
    starts: Sequence[PerRecord | None] = (None,),
) -> PerRecord:
    """The best of the fits from the starts (None: prior means): from one start only, a local optimum of the rivals
    would flatter the winner. The amplitude's own parameter is not identified beside it."""
    found = [_Fit(evidence, place, along, hypothesis).run(s) for s in starts]
    return min(found, key=lambda f: (f.failed > 0.1 * len(f.amplitude), f.objective))


def scan(
    evidence: Dataset, places: Sequence[Location], along: Nuisance, hypothesis: Hypothesis = NULL_HYPOTHESIS
) -> list[PerRecord]:
    """Every place with a free amplitude per record, best first, the fit without any among them. Rivals of the winner
    are fitted again from its θ."""
    none = fit_per_record(evidence, None, along, hypothesis)
    found = [fit_per_record(evidence, p, along, hypothesis) for p in each(places, "fitting places", len(places))]
    found.sort(key=lambda f: f.objective)
    best = found[0]
    again = [
        fit_per_record(evidence, f.location, along, hypothesis, (best,))
        for f in each(found[1:], "fitting places again", len(found) - 1)
    ]
    found[1:] = [min((a, b), key=lambda f: f.objective) for a, b in zip(found[1:], again, strict=True)]
    return sorted([none, *found], key=lambda f: f.objective)


def amplitudes_at(evidence: Dataset, trained: PerRecord, along: Nuisance, sensors: Sequence[str]) -> PerRecord:
    """Amplitudes of other recordings at the trained θ, from some of the sensors alone; residuals are of all sensors,
    so those left out are predicted."""
    fit = _Fit(evidence, trained.location, along, trained.hypothesis)
    return fit.run(trained, sensors=tuple(sensors))


def thin_records(evidence: Dataset, every: int) -> Dataset:
    """Every so many-th record of each flight."""
    flights = [replace(f, columns={c: v[::every] for c, v in f.columns.items()}) for f in evidence.flights]
    return replace(evidence, flights=tuple(flights))


def inlet_temperature(evidence: Dataset, fit: PerRecord) -> np.ndarray:
    """Of each record of the fit, (N,); their order in time where it does not move."""
    found = drivers(evidence.engine, input_values(evidence), {})
    values = next((d.values[fit.number] for d in found if d.driver == INLET_TEMPERATURE), None)
    return fit.number.astype(float) if values is None or not np.isfinite(values).all() else values


class _Fit:
    """Problem and present point of one fit."""

    def __init__(self, evidence: Dataset, place: Location | None, along: Nuisance, hypothesis: Hypothesis):
        if place is not None:
            sigma = {n: s for n, s in along.sigma.items() if n != place.parameter}
            evidence, along = with_lever(evidence, place), replace(along, sigma=sigma)
        self.place, self.hypothesis = place, hypothesis
        self.model, self.problem, _ = problem_with(evidence, hypothesis, along)
        p = self.problem
        self.low, self.high = ((b - p.prior_mean) / p.prior_sigma for b in (p.lower, p.upper))
        self.N = len(p.recording)
        if place is not None:
            q = self.model.parameters[place.parameter]
            self.base = evidence.settings.prior_mean.get(q.name, q.nominal)
            self.a_low, self.a_high = q.lower - self.base, q.upper - self.base
            self.unit = q.prior_sigma
            self.longest = LONGEST * abs(q.nominal) or 10.0 * q.prior_sigma

    def run(self, start: PerRecord | None, sensors: tuple[str, ...] | None = None) -> PerRecord:
        """From another fit's θ (and amplitudes, where it is of the same place and records); with `sensors`, θ stays
        and only the amplitudes are sought, from these."""
        x, a = self._from(start)
        used = np.ones(len(self.problem.sensors), bool)
        if sensors is not None:
            used = np.isin(self.problem.sensors, sensors)
        now = self._amplitudes(self._at(x, a), used, ALONE if sensors is None else ITERATIONS)
        if sensors is not None:
            return self._result(now, True, used)
        mu, converged, polished = DAMPING, False, False
        for _ in range(ITERATIONS):
            dx, da = self._step(now, mu, used)
            # in a curved valley the amplitudes must follow before the step can be judged
            trial = self._amplitudes(
                self._at(np.clip(now.x + dx, self.low, self.high), self._inside(now.a + da)), used, FOLLOW
            )
            ok = now.ok & trial.ok
            fall = now.cost(used, ok) - trial.cost(used, ok) + now.x @ now.x - trial.x @ trial.x
            if fall >= 0.0 and int((now.ok & ~trial.ok).sum()) <= 0.02 * self.N:
                # a small fall of a short step says nothing
                least = max(TOLERANCE * ok.sum(), SHARE * (trial.cost(used, ok) - used.sum() * ok.sum()))
                converged = bool(fall < least and mu <= UNDAMPED)
                now, mu, polished = trial, mu * RELIEF, False
                if converged:
                    break
            elif mu < HEAVY:
                mu = max(mu, 1e-4) * 8.0
            elif polished:
                converged = True  # settled: neither θ at any damping nor any amplitude gains, as beside a kink of a map
                break
            else:
                # θ can move no further before every record has the amplitude that suits it
                now, mu, polished = self._amplitudes(now, used, ALONE), DAMPING, True
        return self._result(now, converged, used)

    def _amplitudes(self, now: _Point, used: np.ndarray, most: int) -> _Point:
        """The point with θ as it is and every record's amplitude improved, each record for itself."""
        if self.place is None:
            return now
        damp = np.full(self.N, DAMPING)
        for _ in range(most):
            c, e = now.c * used, np.nan_to_num(now.e) * used
            length = self._length(c)
            da = np.divide((c * e).sum(axis=1), length**2, out=np.zeros(self.N), where=length > 0) / (1.0 + damp)
            trial = self._at(now.x, self._inside(now.a + np.clip(da, -self.longest, self.longest)))
            before, after = (np.nansum(q.e[:, used] ** 2, axis=1) for q in (now, trial))
            better = trial.ok & (~now.ok | (after <= before))
            damp = np.where(better, damp * RELIEF, np.maximum(damp, 0.1) * 8.0)
            settled = np.abs(trial.a - now.a) * length < SETTLED
            now = now.taking(trial, better)
            if settled[now.ok].all():
                break
        return now

    def _from(self, start: PerRecord | None) -> tuple[np.ndarray, np.ndarray]:
        x, a, p = np.zeros(len(self.problem.parameters)), np.zeros(self.N), self.problem
        if start is not None:
            known = [start.theta.get(n, m) for n, m in zip(p.names, p.prior_mean, strict=True)]
            x = (np.array(known) - p.prior_mean) / p.prior_sigma
            if start.name == (self.place.name if self.place else "nothing"):
                if np.array_equal(start.number, p.inputs[NUMBER].astype(int)) and len(start.amplitude) == self.N:
                    a = np.nan_to_num(start.amplitude)
        return np.clip(x, self.low, self.high), a

    def _inside(self, a: np.ndarray) -> np.ndarray:
        return a if self.place is None else np.clip(a, self.a_low, self.a_high)

    def _at(self, x: np.ndarray, a: np.ndarray) -> _Point:
        p = self.problem
        theta: dict = dict(p.to_physical(x))
        wrt = p.names
        if self.place is not None:
            theta[self.place.parameter] = self.base + a
            wrt = (*wrt, self.place.parameter)
        y = self.model.predict(p.inputs, theta, sensors=p.sensors, wrt=wrt)
        J = np.asarray(y.jacobian, float) / p.sigma[:, None]
        ok = (y.status <= 1) & np.isfinite(J).all(axis=(1, 2))
        e = np.where(ok[:, None], (p.measured - y.y) / p.sigma, np.nan)
        J = np.where(np.isfinite(e)[:, :, None], J, 0.0)
        k = len(p.names)
        c = J[:, :, k] if self.place is not None else np.zeros(e.shape)
        return _Point(x, a, ok, e, J[:, :, :k] * p.prior_sigma, c)

    def _step(self, now: _Point, mu: float, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """dx (p,) and da (N,)."""
        e, J, c = np.nan_to_num(now.e) * used, now.J * used[:, None], now.c * used
        length = self._length(c)
        own = np.divide(c, length[:, None], out=np.zeros_like(c), where=length[:, None] > 0)  # unit vectors
        if self.place is not None:
            # an amplitude that is pushed against its physical bound is no longer free
            push = (own * e).sum(axis=1)
            own[((now.a <= self.a_low) & (push < 0)) | ((now.a >= self.a_high) & (push > 0))] = 0.0
        dx = np.zeros(len(now.x))
        # what the amplitudes leave of residual and derivatives
        left = e - own * (own * e).sum(axis=1)[:, None]
        along = np.einsum("nm,nmp->np", own, J)
        S = np.einsum("nmp,nmq->pq", J, J) - along.T @ along + np.eye(len(dx))
        g = now.x - np.einsum("nmp,nm->p", J, left)
        free = ~(((now.x <= self.low) & (g > 0)) | ((now.x >= self.high) & (g < 0)))
        for _ in range(len(dx)):
            A = S[np.ix_(free, free)]
            dx[:] = 0.0
            dx[free] = -np.linalg.solve(A + mu * np.diag(np.diag(A)), g[free])
            out = free & ((now.x + dx < self.low) | (now.x + dx > self.high))
            if not (out & ((now.x <= self.low) | (now.x >= self.high))).any():
                break
            free &= ~(out & ((now.x <= self.low) | (now.x >= self.high)))
        dx = np.clip(now.x + dx, self.low, self.high) - now.x
        gap = e - np.einsum("nmp,p->nm", J, dx)
        da = np.divide((own * gap).sum(axis=1), length, out=np.zeros(self.N), where=length > 0)
        if self.place is not None:
            da = np.clip(da / (1.0 + mu), -self.longest, self.longest)
        return dx, da

    def _length(self, c: np.ndarray) -> np.ndarray:
        length = np.sqrt((c**2).sum(axis=1))
        return np.where(length * (self.unit if self.place is not None else 0.0) > FAINT, length, 0.0)

    def _result(self, now: _Point, converged: bool, used: np.ndarray) -> PerRecord:
        p = self.problem
        length = self._length(now.c * used)
        error = np.divide(1.0, length, out=np.full(self.N, np.nan), where=length > 0)
        amplitude = np.where((length > 0) & now.ok, now.a, np.nan)
        bound = (now.x <= self.low) | (now.x >= self.high)
        theta = dict(p.to_physical(now.x))
        if self.place is not None:
            theta[self.place.parameter] = self.base
        return PerRecord(
            self.place,
            self.hypothesis,
            theta,
            now.x,
            amplitude,
            error,
            now.e,
            now.J,
            now.c,
            p.sensors,
            p.sigma,
            p.inputs[NUMBER].astype(int),
            p.recording,
            p.inputs,
            tuple(n for n, b in zip(p.names, bound, strict=True) if b),
            int((~now.ok).sum()),
            converged,
        )


@dataclass(frozen=True)
class _Point:
    """x (p,), amplitudes (N,), which records have a prediction (N,), residual (N, m) and derivatives in σ."""

    x: np.ndarray
    a: np.ndarray
    ok: np.ndarray
    e: np.ndarray
    J: np.ndarray
    c: np.ndarray

    def taking(self, other: _Point, rows: np.ndarray) -> _Point:
        """This point with the other's values in these rows; θ is the same."""
        return _Point(
            self.x,
            np.where(rows, other.a, self.a),
            np.where(rows, other.ok, self.ok),
            np.where(rows[:, None], other.e, self.e),
            np.where(rows[:, None, None], other.J, self.J),
            np.where(rows[:, None], other.c, self.c),
        )

    def cost(self, used: np.ndarray, records: np.ndarray) -> float:
        return float(np.nansum(self.e[records][:, used] ** 2))
