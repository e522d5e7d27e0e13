"""Identification of everything that is sought, together, on all flights: the fit that a hypothesis is judged by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.drivers import drivers
from enginediag_cli.engine.term import DriverValues, Effect
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.identification.gauss_newton import HOPE, Fit, solve
from enginediag_cli.identification.nominal import add_regimes
from enginediag_cli.identification.problem import (
    IdentificationProblem,
    IdentificationSettings,
    TrainingRecording,
    build_problem,
)
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import NUMBER, Discrepancy, ExtendedModel
from enginediag_cli.mismatch.fit.nuisance import constants, floor, found_floor, read_wrong
from enginediag_cli.physics.registry import library_drivers
from enginediag_cli.progress import stage

TOLERANCE = 0.03  # standard errors from the optimum: 0.001 of χ²
ITERATIONS, ROUNDS = 25, 4
"""Iterations of one round, and rounds of a fresh start, at most (see SETTLED)."""
CLOSE_BY = 5
"""Iterations of one round of a fit that begins at the optimum of few of its records, within some standard errors of its
own: a smooth misfit needs two; what more finds is kinks, of which a fresh round tells whether they still matter."""
ROUGHLY, NEARLY_SETTLED = (10, 3), 1.0
"""Of a fit that goes on from one of fewer members or records: iterations of one round, and further rounds; and the fall
of χ² over a round of ITERATIONS by which it has settled. What it errs by is less than sets must differ by."""
NEARER = 1
"""Iterations towards an optimum at which nothing is judged."""
SETTLED, SETTLED_SHARE, STUCK_SHARE = 0.1, 1e-3, 0.02
"""Maps read linearly have kinks, at which the search may zigzag: a fit has settled, too, when a fresh round of
iterations lowers χ² by less than 0.1, or by less than a thousandth of what is unexplained, unless the Newton step
promises a fiftieth of it: then it is stuck."""

FEW = 4000
"""Records of the search for where a fit of more begins. The fit itself is of all, and settles in a few iterations from
there, which is exact; only what is to be gained by a good start depends on these."""

BETWEEN_ENGINES = 1.4
"""What one engine differs from another by, in standard deviations of an engine from its type: √2, both vary."""

MAX_LOST = 0.1
"""A fit that has no prediction for more than this share of the records is no verdict."""


@dataclass(frozen=True)
class FitBudget:
    """How far a fit is worth its time. `hopeless`: the objective (`objective_of`) above which nobody wants it, and it
    is given up; `behind`: above which it is only ranked: there it has settled as soon as it cannot come below."""

    hopeless: float = np.inf
    behind: float = np.inf


ANY_REACH = FitBudget()


@dataclass(frozen=True)
class Hypothesis:
    """What is sought beside the nuisance: effects (their amplitudes) and discrepancies with their curves (N,) over
    all records of the evidence in order."""

    effects: tuple[Effect, ...] = ()
    discrepancies: tuple[Discrepancy, ...] = ()
    curves: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that are sought."""
        return (*(a for e in self.effects for a in e.amplitudes), *(d.name for d in self.discrepancies))

    @property
    def sizes(self) -> tuple[str, ...]:
        """Those without which there is nothing of it."""
        return (*(a for e in self.effects for a in e.sizes), *(d.name for d in self.discrepancies))

    @property
    def label(self) -> str:
        return " + ".join((*(e.label for e in self.effects), *(d.name for d in self.discrepancies))) or "nothing"


NULL_HYPOTHESIS = Hypothesis()


@dataclass(frozen=True)
class IdentifiedHypothesis:
    """A fit of the nuisance and a hypothesis to the evidence. Look at `converged` first.

    `number` (N,): place of each record of the problem in the evidence; `nuisance` curves and discrepancies are those
    of the floor and of the fleet.
    """

    evidence: Dataset
    hypothesis: Hypothesis
    model: ExtendedModel
    problem: IdentificationProblem
    fit: Fit
    settled: bool
    rho: np.ndarray  # (m,)

    @property
    def converged(self) -> bool:
        return self.settled and self.lost <= MAX_LOST

    @property
    def lost(self) -> float:
        """Share of the records without a prediction."""
        return float(self.fit.failed.mean())

    @property
    def reason(self) -> str:
        if self.settled and not self.converged:
            return f"{100 * self.lost:.0f} % of the records have no prediction at the fit"
        return self.fit.reason

    @property
    def theta(self) -> dict[str, float]:
        """Parameters of the engine and coefficients at the fit."""
        return self.problem.to_physical(self.fit.x)

    @property
    def number(self) -> np.ndarray:
        return self.problem.inputs[NUMBER].astype(int)


def stack_column(evidence: Dataset, column: str, default: float = np.nan) -> np.ndarray:
    """A column over all flights, (N,); `default` where a flight has none."""
    parts = []
    for f in evidence.flights:
        n = len(next(iter(f.columns.values())))
        parts.append(np.asarray(f.columns.get(column, np.full(n, default)), float))
    return np.concatenate(parts)


def input_values(evidence: Dataset) -> dict[str, np.ndarray]:
    """The engine's inputs over all flights, (N,) each."""
    engine = evidence.engine
    found = {c: stack_column(evidence, c) for c in engine.inputs}
    for c, default in engine.optional_inputs.items():
        found[c] = stack_column(evidence, c, default)
    return found


def driver_values(evidence: Dataset, theta: Mapping[str, float]) -> list[DriverValues]:
    """Drivers of all records of the evidence, with its further columns, at the engine's parameters among `theta`."""
    engine = evidence.engine
    at = {n: v for n, v in theta.items() if n in engine.parameters}
    recorded = {c: stack_column(evidence, c) for c in evidence.drivers}
    return drivers(engine, input_values(evidence), at, recorded, library_drivers())


@dataclass(frozen=True)
class Nuisance:
    """Discrepancies and curves that every hypothesis carries along, and constants with their prior."""

    sigma: Mapping[str, float]
    discrepancies: tuple[Discrepancy, ...]
    curves: Mapping[str, np.ndarray]


def nuisance(evidence: Dataset) -> Nuisance:
    """Floor and fleet of the evidence, at the prior mean of its parameters."""
    s, engine = evidence.settings, evidence.engine
    inputs = input_values(evidence)
    known = {n: v for n, v in s.prior_mean.items() if n in engine.parameters}
    if s.maps is not None and s.map_accuracy > 0.0:
        discrepancies, curves = found_floor(engine, inputs, s.maps)
    else:
        discrepancies, curves = floor(engine, inputs, known, s.map_accuracy)
    of_engine = np.concatenate(
        [np.full(len(next(iter(f.columns.values()))), evidence.engines.index(f.engine)) for f in evidence.flights]
    )
    # what is told of a recording's offsets is all that its sensors may be wrong by
    plain = [c for c in evidence.noise.sigma if c not in s.offsets and c not in s.scale_offsets]
    own = {**s.nuisance, **read_wrong(engine, plain, s.nuisance)}
    for k, name in enumerate(evidence.engines[1:], start=1):
        curves[f"engine {name}"] = (of_engine == k).astype(float)
        for n, sigma in own.items():
            # sensors and health belong to one engine, the design to all of them
            if engine.parameters[n].family in ("health", "sensor"):
                discrepancies.append(Discrepancy(n, f"engine {name}", BETWEEN_ENGINES * sigma))
    return Nuisance({**own, **constants(engine, s.map_accuracy, s.nuisance)}, tuple(discrepancies), curves)


@stage("fitting the model")
def identify_with(
    evidence: Dataset,
    hypothesis: Hypothesis,
    along: Nuisance,
    start: IdentifiedHypothesis | None = None,
    of_few: Fit | None = None,
    reach: FitBudget = ANY_REACH,
    roughly: bool = False,
) -> IdentifiedHypothesis:
    """Fit nuisance and hypothesis together, from another fit where one is given; `of_few`: from what `fit_of_few` has
    found of the same hypothesis. A start from a share of the records is as good as one from few of them. `reach`:
    how far it is worth its time; `roughly`: only to compare it with others."""
    model, problem, rho = problem_with(evidence, hypothesis, along, start)
    first, iterations = _start(problem, start, hypothesis) or _begun(problem, hypothesis), ITERATIONS
    few = _few(problem)
    if start is not None and len(start.problem.recording) < len(problem.recording):
        few, iterations = None, CLOSE_BY
    if few is not None:
        fit, settled = (of_few, True) if of_few is not None else _fit(few, first)
        first, iterations = ((fit.x, fit.z), CLOSE_BY) if settled else (first, ITERATIONS)
    if roughly:
        fit, settled = _fit(problem, first, ROUGHLY[0], reach, (ROUGHLY[0] * ROUGHLY[1], NEARLY_SETTLED))
    else:
        fit, settled = _fit(problem, first, iterations, reach)
    return IdentifiedHypothesis(evidence, hypothesis, model, problem, fit, settled, rho)


def nearer(
    evidence: Dataset, hypothesis: Hypothesis, along: Nuisance, start: IdentifiedHypothesis
) -> IdentifiedHypothesis:
    """NEARER steps of a fit from one of a share of the records: nearer the optimum, which lies far off where the model
    lacks something. A projection goes the last one."""
    model, problem, rho = problem_with(evidence, hypothesis, along, start)
    fit = solve(problem, _start(problem, start, hypothesis), max_iterations=NEARER, tolerance=TOLERANCE)
    return IdentifiedHypothesis(evidence, hypothesis, model, problem, fit, fit.converged, rho)


def fit_of_few(evidence: Dataset, hypothesis: Hypothesis, along: Nuisance, start: IdentifiedHypothesis) -> Fit | None:
    """A fit to few records, evenly chosen, to compare hypotheses by and to go on from; None where there are few anyway,
    or where it did not settle. Another fit is where it begins if it is of the same hypothesis, else the prior means:
    what the other lacks has bent it."""
    _, problem, _ = problem_with(evidence, hypothesis, along, start)
    few = _few(problem)
    if few is None:
        return None
    same = hypothesis.names == start.hypothesis.names
    fit, settled = _fit(few, _start(problem, start) if same else _begun(problem, hypothesis))
    return fit if settled else None


def objective_of(fit: Fit) -> float:
    """χ² of readings and priors that a fit has searched the lowest of."""
    return 2.0 * fit.iterations[-1].cost


def _few(problem: IdentificationProblem) -> IdentificationProblem | None:
    """The same problem of few records, evenly chosen, whose optimum is where to begin; None where they are few."""
    step = len(problem.recording) // FEW
    return problem.select(np.arange(len(problem.recording)) % step == 0) if step > 1 else None


def _fit(
    problem: IdentificationProblem,
    start: tuple[np.ndarray, np.ndarray] | None,
    iterations: int = ITERATIONS,
    reach: FitBudget = ANY_REACH,
    enough: tuple[int, float] = (ROUNDS * ITERATIONS, SETTLED),
) -> tuple[Fit, bool]:
    """The fit, and whether it has converged or settled; `enough`: iterations after the first round at most, and what
    is settled. In rounds of `iterations`; given up, or settled, as its `reach` says."""
    fit = solve(problem, start, max_iterations=iterations, tolerance=TOLERANCE, hopeless=reach.hopeless)
    readings = int(np.isfinite(problem.measured).sum())
    rounds = enough[0] // iterations
    for _ in range(rounds):
        if fit.converged:
            return fit, True
        if not fit.iterations:
            raise NoVerdictError("the engine has no prediction for any record that could be fitted")
        before = objective_of(fit)
        if before - HOPE * fit.decrement**2 > reach.hopeless:
            return fit, False
        fit = solve(problem, (fit.x, fit.z), max_iterations=iterations, tolerance=TOLERANCE, hopeless=reach.hopeless)
        fall = before - objective_of(fit)
        # where a search zigzags at a bound its next step promises what it never gains
        if min(fit.decrement**2, rounds * fall) < objective_of(fit) - reach.behind:
            return fit, True
        near = fit.decrement**2 < STUCK_SHARE * max(before, readings)
        # the same fall by iteration, however long the rounds
        if near and fall < max(enough[1], SETTLED_SHARE * (before - readings)) * iterations / ITERATIONS:
            return fit, True
    return fit, fit.converged


def problem_with(
    evidence: Dataset, hypothesis: Hypothesis, along: Nuisance, start: IdentifiedHypothesis | None = None
) -> tuple[ExtendedModel, IdentificationProblem, np.ndarray]:
    """Model and problem of nuisance and hypothesis together, and each sensor's lag-1 correlation (m,). Readings that
    another fit, `start`, has as well are held once."""
    s = evidence.settings
    effects = (*evidence.engine.effects, *hypothesis.effects)
    discrepancies = (*along.discrepancies, *hypothesis.discrepancies)
    model = ExtendedModel(evidence.engine.replace_effects(effects), discrepancies, like=start.model if start else None)
    curves = {**along.curves, **hypothesis.curves}
    names = [*along.sigma, *(d.name for d in discrepancies), *(a for e in hypothesis.effects for a in e.amplitudes)]
    recorded = [c for c in evidence.noise.sigma if c in evidence.engine.sensors]
    settings = IdentificationSettings(
        parameters=tuple(names),
        prior_sigma=dict(along.sigma),
        # an effect that is tried at a size begins there, but nothing is known before of its size
        prior_mean={n: v for n, v in s.prior_mean.items() if n in model.parameters} | _absent(hypothesis),
        noise_sigma={c: evidence.noise.sigma[c] for c in recorded},
        noise="specified",
        loss=s.loss,
        loss_scale=s.loss_scale,
        recording_bias_sigma=s.offsets,
        recording_scale_sigma=s.scale_offsets,
    )
    problem = build_problem(model, add_regimes(evidence.engine, _recordings(evidence, curves)), settings)
    problem = replace(problem, offsets=(*problem.offsets, *s.instruments))
    rho = np.array([evidence.noise.rho.get(c, 0.0) for c in problem.sensors])
    problem = problem.replace_noise(problem.sigma, (1 + rho) / (1 - rho))
    return model, _shared(problem, start.problem) if start else problem, rho


def _shared(problem: IdentificationProblem, other: IdentificationProblem) -> IdentificationProblem:
    """The problem with the other's arrays where they hold the same."""

    def same(a: np.ndarray, b: np.ndarray | None) -> np.ndarray:
        return b if b is not None and a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f") else a

    return replace(
        problem,
        inputs={c: same(v, other.inputs.get(c)) for c, v in problem.inputs.items()},
        measured=same(problem.measured, other.measured),
        recording=same(problem.recording, other.recording),
        regimes=same(problem.regimes, other.regimes),
    )


def _recordings(evidence: Dataset, curves: Mapping[str, np.ndarray]) -> list[TrainingRecording]:
    found, first = [], 0
    for f in evidence.flights:
        n = len(next(iter(f.columns.values())))
        rows = slice(first, first + n)
        own = {k: v[rows] for k, v in curves.items()}
        found.append(TrainingRecording(f.label, {**f.columns, NUMBER: np.arange(first, first + n, dtype=float), **own}))
        first += n
    return found


def _absent(hypothesis: Hypothesis) -> dict[str, float]:
    """Amplitudes of the effects that are tried at some size: where they are absent."""
    return {
        e.parameter_name(c.name): c.absent for e in hypothesis.effects if e.trial_names for c in e.term.amplitudes()
    }


def _begun(problem: IdentificationProblem, hypothesis: Hypothesis) -> tuple[np.ndarray, np.ndarray] | None:
    """The prior means, but effects at the size that they are tried at; None where none is."""
    tried = _absent(hypothesis)
    if not tried:
        return None
    x = [
        (p.nominal - problem.prior_mean[j]) / problem.prior_sigma[j] if p.name in tried else 0.0
        for j, p in enumerate(problem.parameters)
    ]
    return np.array(x), np.zeros((len(problem.labels), len(problem.offsets)))


def _start(
    problem: IdentificationProblem, other: IdentifiedHypothesis | None, hypothesis: Hypothesis = NULL_HYPOTHESIS
) -> tuple[np.ndarray, np.ndarray] | None:
    """The other fit's values for what both estimate."""
    if other is None:
        return None
    theirs, begun = other.theta, _begun(problem, hypothesis)
    x = np.zeros(len(problem.parameters))
    for j, p in enumerate(problem.parameters):
        if p.name in theirs:
            x[j] = (theirs[p.name] - problem.prior_mean[j]) / problem.prior_sigma[j]
        elif begun is not None:
            x[j] = begun[0][j]
    z = np.zeros((len(problem.labels), len(problem.offsets)))
    theirs_of = {label: r for r, label in enumerate(other.problem.labels)}
    if other.fit.z.shape == z.shape:
        z = other.fit.z.copy()
    elif other.fit.z.shape[1] == z.shape[1] and len(theirs_of) == len(other.problem.labels):
        for r, label in enumerate(problem.labels):
            if label in theirs_of:
                z[r] = other.fit.z[theirs_of[label]]
    return x, z
