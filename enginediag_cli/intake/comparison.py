"""How far a recording is from an engine: the misfit that is left when the engine differs as engines of its kind do.

Of a bounded sample of K records, the readings y of m sensors are compared with the model at the recorded inputs:

    e_ks = ln(y_ks / Φ_s(u_k, θ)),      r = e − J δ,      J = ∂ ln Φ/∂θ

δ are changes of the parameters in which engines of the kind, and their instruments, differ (health, errors of sensors
and inputs; what identification may move, where nothing has been identified), each with a standard deviation. A sensor
may be misfitted by a factor f_s of what noise and maps allow, σ_s, and no less than by its noise, f_s ≥ noise_s/σ_s;
with n independent records in the sample

    ln p = −n Σ_s ln f_s − ½ Σ_j (δ_j/spread_j)²

is maximised over δ and f: by how much the model is wrong is found with every explanation, and one that brings readings
down to their noise is the likelier for it. One sensor that is wrong by any amount costs its own f alone, a deteriorated
or damaged engine its δ; readings of another engine, or in another unit, cost both. Mistakes are compared by it
(mistakes.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.instrument_errors import InputErrors

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.engine.wrapped import MonitoredModel

Columns = Mapping[str, np.ndarray]

INDEPENDENT = 6
"""Records of a sample that count as independent: a model's own error follows the operating point, and a recording is at
a handful of them, however many records it has."""
SPREAD = 2.0
"""Standard deviations of the prior of a health parameter by which an identified engine departs from its nominal state:
deterioration and damage go farther than manufacture, of which priors speak. A fault of 8 % is then two of them."""
ROUNDS = 8
"""Times that δ and f are found in turn; they come to rest within five."""
REPEATABLE = 0.003
"""Least relative deviation that is one, beside noise: engines repeat, and models follow them, no better. What the maps
are wrong by beyond shows in f, of a right file and of a wrong one alike."""
HUBER = 2.0
"""Scatters of a sensor beyond which a reading counts less: spikes are tens of them."""
AT_REST = 0.01
"""Change of the log-likelihood that is none."""
SETTLED = 0.3
"""Spreads; a change of less does not need another linearisation."""
FARTHEST = 4.0
"""Spreads that a parameter moves by at most before the model is linearised anew."""
FAILED = 1.0
"""|ln(y/Φ)| of a record that the model cannot compute at all: as wrong as a factor of 2.7."""
MAD = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values."""
SMALL = 0.1
"""Share of a sensor's largest predicted reading below which a deviation is no longer relative to the reading: power
and thrust pass through zero."""
LEAST_READ, STILL = 5, 0.5
"""Readings from which it is seen that a sensor stands still, and the share of them at one value from which it does:
records of a sample lie all over a recording, where the engine moves."""
GROSS = 12.0
"""|ln(y/Φ)| beyond which a reading is not looked at more closely: a bar for a pascal is a factor of e^11.5."""
QUIET = 0.05
"""Share of σ that every reading has as noise, 0.015 % of it where REPEATABLE is all that is known: none repeats
better."""


def _is_read(values: np.ndarray) -> bool:
    """Whether a column (K,) holds readings: one that is at one value in most records is a dead sensor's, which no
    unit puts right."""
    known = values[np.isfinite(values)]
    if len(known) < LEAST_READ:
        return bool(known.size)
    return bool(np.unique(known, return_counts=True)[1].max() <= STILL * len(known))


@dataclass(frozen=True)
class Misfit:
    """The residual between a sample and an engine. Of m sensors with readings: `sensors`, `before`: median of ln(y/Φ)
    where the engine is expected, `after`: standard deviation of it when the engine differs as it may, both relative.
    `factor` (m,): f; `departure`: δ over spreads (p,); `log_likelihood`: the sum in the module's head; computed: share
    of records that the model could compute; `values`: parameters at the end; lacking (m,): n ln(f/least f); count
    (m,): n."""

    sensors: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    factor: np.ndarray
    departure: np.ndarray
    log_likelihood: float
    computed: float
    values: Mapping[str, float] = field(default_factory=dict)
    lacking: np.ndarray = field(default_factory=lambda: np.zeros(0))
    count: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def tail(self) -> float:
        """Share of engines of the kind, rightly recorded and as their priors say, that lack more: −2 ln p is a χ² of
        one for each sensor, since an engine is off its model much alike wherever it is run."""
        return self._tail(self.lacking)

    @property
    def tail_but_worst(self) -> float:
        """The same of all sensors but the one that fits worst: any one may have failed."""
        return self._tail(np.sort(self.lacking)[:-1])

    @property
    def missing(self) -> float:
        """Log-likelihood that the best of all files would have more: no mistake can bring more than that."""
        return self._missing(self.lacking)

    def _missing(self, lacking: np.ndarray) -> float:
        return float(np.sum(lacking)) + 0.5 * float(self.departure @ self.departure)

    def _tail(self, lacking: np.ndarray) -> float:
        from scipy.special import chdtrc  # only of recordings that are far from the engine

        return float(chdtrc(max(len(lacking), 1), 2.0 * self._missing(lacking)))

    @property
    def typical(self) -> float:
        """Root mean square over the sensors of the relative deviation that is left; infinite where there is none."""
        return float(np.sqrt(np.mean(self.after**2))) if len(self.after) else np.inf


@dataclass(frozen=True)
class SamplePrediction:
    """Predictions y (K, m), sensitivities (K, m, p), and whether they could be computed (K,)."""

    y: np.ndarray
    jacobian: np.ndarray
    ok: np.ndarray


@dataclass(frozen=True)
class EngineReference:
    """What recordings are compared with: a model, `values` of its parameters where the engine is expected, parameters
    `names` in which engines differ, by `spread` (p,), `sensors` with the `noise` of a reading (m,) in their units, and
    the relative `accuracy` of the model. identified: whether `values` were identified from recordings."""

    engine: MonitoredModel
    values: Mapping[str, float]
    names: tuple[str, ...]
    spread: np.ndarray
    sensors: tuple[str, ...]
    noise: np.ndarray
    accuracy: float
    identified: bool = False

    @property
    def input_columns(self) -> tuple[str, ...]:
        """Input columns, optional ones last."""
        return (*self.engine.inputs, *self.engine.optional_inputs)

    def predict(self, columns: Columns, values: Mapping[str, float] | None = None) -> Any:
        """The model's prediction at the inputs of K records, with derivatives along `names`."""
        inputs = fill_inputs(self.engine, columns)
        here = {**self.values, **(values or {})}
        return self.engine.predict(inputs, here, sensors=self.sensors, wrt=self.names, walk=False)  # type: ignore[call-arg]

    def predict_several(self, several: Sequence[Columns]) -> list[SamplePrediction]:
        """The predictions for each of several recordings, computed at once: many short ones cost their calls."""
        sizes = [len(next(iter(columns.values()))) for columns in several]
        if not sizes:
            return []
        names = [c for c in self.input_columns if any(c in columns for columns in several)]
        missing = [np.full(size, np.nan) for size in sizes]
        whole = {c: np.concatenate([x.get(c, nan) for x, nan in zip(several, missing, strict=True)]) for c in names}
        found = self.predict(whole)
        ends = np.cumsum(sizes)[:-1]
        parts = (np.split(np.asarray(each), ends) for each in (found.y, found.jacobian, found.ok))
        return [SamplePrediction(*part) for part in zip(*parts, strict=True)]

    def misfit(
        self, columns: Columns, steps: int = 2, values: Mapping[str, float] | None = None, answer: Any = None
    ) -> Misfit:
        """The misfit of K records, linearised `steps` times; `values`: parameters that are not where expected;
        `answer`: the prediction there, where it is known."""
        size = len(next(iter(columns.values())))
        place = [j for j, s in enumerate(self.sensors) if s in columns and _is_read(columns[s])]
        sensors = tuple(self.sensors[j] for j in place)
        read = np.column_stack([columns[s] for s in sensors]) if sensors else np.zeros((size, 0))
        base = {**self.values, **(values or {})}
        centre = np.array([base.get(n, self.engine.parameters[n].nominal) for n in self.names])
        moved, best, before = np.zeros(len(self.names)), None, None
        here = base
        for _ in range(steps):
            answer = self.predict(columns, here) if answer is None else answer
            e, J, sigma = _relative_deviations(answer, place, read, self.noise[place], self.accuracy)
            usual = np.median(sigma, axis=0)
            quiet = np.sqrt(np.maximum(1.0 - (self.accuracy / usual) ** 2, QUIET**2))
            least = np.where(self.noise[place] > 0.0, quiet, 1.0)
            if before is None:
                before = e
            J = J * self.spread
            found = _fit_misfit(e + J @ moved, J, sigma, least)
            reached = Misfit(
                sensors,
                _median(before),
                found.factor * usual,
                found.factor,
                found.moved,
                found.log_likelihood,
                float(np.mean(answer.ok)),
                here,
                found.count * np.log(found.factor / least),
                found.count,
            )
            if best is None or reached.log_likelihood > best.log_likelihood:
                best = reached
            step, answer = found.moved - moved, None
            if np.all(np.abs(step) < SETTLED):
                break
            moved = moved + np.clip(step, -FARTHEST, FARTHEST)
            here = {**base, **dict(zip(self.names, (centre + moved * self.spread).tolist(), strict=True))}
        assert best is not None
        return best

    def deviations(self, columns: Columns) -> tuple[np.ndarray, np.ndarray]:
        """ln(y/Φ) where the engine is expected, (K, m), and its standard deviation by noise and maps (K, m)."""
        size = len(next(iter(columns.values())))
        read = np.column_stack([columns.get(s, np.full(size, np.nan)) for s in self.sensors])
        inputs = fill_inputs(self.engine, columns)
        answer = self.engine.predict(inputs, self.values, sensors=self.sensors, walk=False)  # type: ignore[call-arg]
        e, _, sigma = _relative_deviations(answer, range(len(self.sensors)), read, self.noise, self.accuracy)
        return e, sigma

    def recentre(self, values: Mapping[str, float]) -> EngineReference:
        """The same, with an engine that is expected elsewhere."""
        return replace(self, values={**self.values, **values})


def fill_inputs(engine: MonitoredModel, columns: Columns) -> dict[str, np.ndarray]:
    """Every input (K,), with the value that stands for "not recorded" where there is one."""
    size = len(next(iter(columns.values())))
    inputs = {c: np.asarray(columns[c], float) for c in engine.inputs}
    for column, default in engine.optional_inputs.items():
        values = np.asarray(columns.get(column, np.full(size, default)), float)
        inputs[column] = np.where(np.isfinite(values), values, default)
    return inputs


def _relative_deviations(
    answer: Any, place: Sequence[int], read: np.ndarray, noise: np.ndarray, accuracy: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """e (K, m), ∂ ln Φ/∂θ (K, m, p) and σ (K, m) of a prediction. The logarithm is that of the ratio where both are
    positive; for what passes through zero the difference over the larger of prediction and a share of the largest."""
    y, slope, ok = np.asarray(answer.y)[:, place], np.asarray(answer.jacobian)[:, place], np.asarray(answer.ok)
    with np.errstate(all="ignore"):
        largest = np.nanmax(np.abs(np.where(ok[:, None], y, np.nan)), axis=0, initial=0.0)
        small = SMALL * largest
        ratio = np.log(read / y)
        e = np.where((read > 0.0) & (y > small), ratio, (read - y) / np.maximum(np.abs(y), small))
        e = np.where(np.isfinite(read), np.clip(e, -GROSS, GROSS), np.nan)
        # an error of an instrument is small beside its reading as well, which may be a thousand times the prediction
        scale = np.fmax(np.maximum(np.abs(y), small), np.abs(read))
        J = slope / scale[:, :, None]
        sigma = np.hypot(accuracy, noise / scale)
    wrong = ~ok[:, None] | ~np.isfinite(y)
    e = np.where(wrong & np.isfinite(read), FAILED, e)
    J = np.where(wrong[:, :, None] | ~np.isfinite(J), 0.0, J)
    return e, J, np.where(wrong | ~np.isfinite(sigma), accuracy, sigma)


@dataclass(frozen=True)
class _FittedMisfit:
    """δ over spreads (p,), f (m,), the log-likelihood, and independent readings of each sensor (m,)."""

    moved: np.ndarray
    factor: np.ndarray
    log_likelihood: float
    count: np.ndarray


def _fit_misfit(e: np.ndarray, J: np.ndarray, sigma: np.ndarray, least: np.ndarray) -> _FittedMisfit:
    """δ over spreads and f ≥ least (m,) that maximise the sum in the head; e (K, m), J (K, m, p) per spread, σ (K, m).
    The sum has maxima with sensors that are believed and others that are not: sought from all believed, and as they
    look."""
    there = np.isfinite(e)
    r = np.where(there, e, 0.0) / sigma
    A = np.where(there[:, :, None], J / sigma[:, :, None], 0.0).reshape(r.size, J.shape[2])
    count = there.sum(axis=0)
    n = np.minimum(count, INDEPENDENT)
    share = np.where(count > 0, n / np.maximum(count, 1), 0.0)

    def scored(left: np.ndarray, moved: np.ndarray) -> _FittedMisfit:
        factor = np.maximum(least, MAD * np.nan_to_num(_median(np.where(there, np.abs(left), np.nan))))
        return _FittedMisfit(moved, factor, float(-np.sum(n * np.log(factor)) - 0.5 * moved @ moved), n)

    begin = scored(r, np.zeros(A.shape[1]))
    ends = [begin]
    for factor in (np.ones(len(n)), begin.factor):
        left = r
        for _ in range(ROUNDS):
            # Huber's weights: readings beyond two of what their sensor scatters by count less
            weight = share / factor**2 * np.minimum(1.0, HUBER * factor / np.maximum(np.abs(left), 1e-9))
            W = A * weight.reshape(-1, 1)
            moved = np.linalg.solve(W.T @ A + np.eye(A.shape[1]), W.T @ r.ravel())
            left = r - (A @ moved).reshape(r.shape)
            ends.append(scored(left, moved))
            factor = ends[-1].factor
            if abs(ends[-1].log_likelihood - ends[-2].log_likelihood) < AT_REST:
                break
    return max(ends, key=lambda one: one.log_likelihood)


def _median(values: np.ndarray) -> np.ndarray:
    """Of each column (K, m), NaN where it is empty. np.nanmedian takes thirty times as long for a few records."""
    ordered, count = np.sort(values, axis=0), np.isfinite(values).sum(axis=0)
    if not len(values):
        return np.full(values.shape[1], np.nan)
    column = np.arange(values.shape[1])
    below = ordered[np.maximum(count - 1, 0) // 2, column]
    above = ordered[np.minimum(count // 2, len(values) - 1), column]
    return np.where(count > 0, (below + above) / 2, np.nan)


def engine_reference(engine: Engine) -> EngineReference:
    """Of an engine as its file describes it: it differs in health and instruments, and in what identification may move.
    Raises DataError for an `identification:` block with unknown names."""
    from enginediag_cli.identification.problem import match_names, settings_from_mapping

    stated = settings_from_mapping(engine.declared.get("identification"))
    model = InputErrors.wrap(engine)
    own = list(engine.parameters)
    chosen = match_names(stated.parameters, own, "parameter") if stated.parameters else own
    fixed = set(match_names(stated.fixed, own, "parameter"))
    names = _differing_parameters(model, [n for n in chosen if n not in fixed])
    spread = [stated.prior_sigma.get(n, model.parameters[n].prior_sigma) for n in names]
    sensors = tuple(engine.sensors)
    noise = [stated.noise_sigma.get(s) or engine.sensors[s].noise_sigma or 0.0 for s in sensors]
    return EngineReference(
        model,
        {n: v for n, v in stated.prior_mean.items() if n in model.parameters},
        names,
        np.array(spread),
        sensors,
        np.array(noise),
        REPEATABLE,
    )


def _differing_parameters(model: MonitoredModel, chosen: Sequence[str]) -> tuple[str, ...]:
    """Chosen parameters, with health and errors of instruments; those without a finite spread cannot be searched."""
    always = [n for n, p in model.parameters.items() if p.family == "health" or p.belongs_to_instrument]
    kept = dict.fromkeys([*chosen, *always])
    return tuple(n for n in kept if np.isfinite(s := model.parameters[n].prior_sigma) and s > 0.0)


def nominal_reference(
    engine: MonitoredModel, values: Mapping[str, float], sensors: Sequence[str], noise: np.ndarray
) -> EngineReference:
    """Of an engine that has been identified: it differs from its nominal state in health and instruments. `values`:
    identified parameters of the engine itself; `noise`: of a reading of each sensor, in its unit."""
    model = InputErrors.wrap(engine)
    known = {n: v for n, v in values.items() if n in model.parameters}
    names = _differing_parameters(model, ())
    known_by = [model.parameters[n] for n in names]
    spread = np.array([p.prior_sigma if p.belongs_to_instrument else SPREAD * p.prior_sigma for p in known_by])
    return EngineReference(model, known, names, spread, tuple(sensors), np.asarray(noise, float), REPEATABLE, True)
