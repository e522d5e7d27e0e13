"""Refinement by an effect that switches without any column showing when.

On the flights that are fitted the states come from the search for hidden effects. On an unseen flight they are
inferred by the same forward–backward recursion, now with everything else known from the fit, amplitude included, and
the flight's log predictive density is that of the readings with the states summed over:

    ℓ = ℓ(all off) + ln Σ_s P(s) exp{a g_s − ½ a² |P C s|²}

so that two states a record do not buy a better fit. Point predictions of a sensor are judged at the states that other
sensors show (`criteria`). A lower bound is taken where states and identified parameters are dependent
(`hidden_states`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search, refit_noise_without_switches
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    IdentifiedHypothesis,
    Nuisance,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.projection import Frame, Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.refine.criteria import Prediction, Records
from enginediag_cli.mismatch.refine.prediction import Change
from enginediag_cli.mismatch.refine.unseen import (
    Unseen,
    comparable,
    log_density,
    only,
    predicted,
    row_parts,
    unseen_of,
    with_residual,
)
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, effects_at
from enginediag_cli.mismatch.unrecorded.states import Bounds, first_guesses, two_states
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, direction
from enginediag_cli.progress import stage

NARROW = 1e-3
"""Prior standard deviation of a known amplitude over its size: its own term is then a constant, taken out again."""
FOLDS = 3
"""Parts of the sensors, each judged by the states that the rest shows: three sensors are the fewest that an engine
has."""
LEAST_ON = 5
"""Records of a flight in which the effect must be on for the flight to judge it: a few are taken for on by chance."""


@dataclass(frozen=True)
class Inferred:
    """States of one unseen flight: `on` (n,) of the records `number` (n,) of the flight, and what summing over them
    adds to the flight's log density with the effect off."""

    number: np.ndarray
    on: np.ndarray
    evidence: float


def switch_column(effect: Effect) -> str:
    """Name of the column with an effect's states."""
    return f"{effect.term.NAME}_{effect.site.name}_on"


def with_states(evidence: Dataset, training: Sequence[int], finding: HiddenFinding, column: str) -> Dataset:
    """The evidence with the finding's states (its records are those of the training flights, in order) in a column;
    0 on all other flights."""
    assert finding.states is not None
    sizes = [_size(evidence.flights[k]) for k in training]
    stacked = np.zeros(sum(sizes))
    stacked[finding.number] = finding.states > 0.5
    parts = dict(zip(training, np.split(stacked, np.cumsum(sizes)[:-1]), strict=True))
    flights = tuple(_with(f, column, parts.get(k, np.zeros(_size(f)))) for k, f in enumerate(evidence.flights))
    return replace(evidence, flights=flights)


def judged_by_trained_noise(evidence: Dataset, unseen: Sequence[int]) -> Dataset:
    """The evidence with noise and priors that the flights that are fitted show, freed of what switches in them, as the
    search for what is missing takes them: fit, search and judgement rest on one and the same."""
    training = evidence.only([k for k in range(len(evidence.flights)) if k not in unseen])
    freed = refit_noise_without_switches(training)
    return replace(evidence, noise=freed.noise, settings=freed.settings, owed=freed.owed)


@stage("looking for what switches")
def find_switch(training: Dataset, effect: Effect) -> HiddenFinding | None:
    """The likeliest switch on these flights at a place where the effect acts; None when there is none."""
    along = nuisance(training)
    fit = identify_with(training, NULL_HYPOTHESIS, along)
    if not fit.converged:
        return None
    base = HypothesisFit((), fit, Projection(fit))
    for f in hidden_search(training)(base).refitted():
        if f.significant and f.is_switch and effect.label in {e.label for e in effects_at(f.location, training.engine)}:
            return f
    return None


def compare_switched(
    evidence: Dataset,
    unseen: Sequence[int],
    before: HypothesisFit,
    after: HypothesisFit,
    along: Nuisance,
    effect: Effect,
) -> tuple[Unseen, tuple[Prediction, ...], Dataset]:
    """As `compare`, states of the unseen flights inferred; also the evidence with these states in its column. What a
    sensor is judged by are the states that the others show: with its own it would be fitted, not predicted. A flight
    in which the effect is never on cannot judge it, and is left to the log density."""
    column = switch_column(effect)
    flights = [OneFlight.put(evidence, k, after, along, effect) for k in unseen]
    there, density, often = list(evidence.flights), [], []
    for k, f in zip(unseen, flights, strict=True):
        i = f.inferred()
        states = np.zeros(_size(there[k]))
        states[i.number] = i.on > 0.5
        there[k] = _with(there[k], column, states)
        often.append(np.full(len(i.on), np.sum(i.on > 0.5) >= LEAST_ON))
        one = predicted(evidence, [k], before, along)
        whole = np.zeros(len(one.number), int)
        density.append((log_density(before, one, whole)[0], log_density(after, f.there, whole)[0] + i.evidence))
    pair, lost = comparable(*(predicted(evidence, unseen, t, along) for t in (before, after)))
    moves = np.concatenate([f.moves for f in flights])
    ever, on = np.concatenate(often), np.zeros(moves.shape, bool)
    changes = {of: Change(len(on)) for of in (Records.ON, Records.CONTRAST)}
    for fold in _folds(len(pair[0].problem.sensors)):
        own = np.concatenate([f.inferred(~fold).on > 0.5 for f in flights])
        on[:, fold] = own[:, None]
        judged = tuple(only(p, fold & ever[:, None]) for p in pair)
        e1 = judged[1].fit.equations.residual - np.where(own[:, None], moves, 0.0)
        both = judged[0], with_residual(judged[1], e1)
        parts = row_parts(before, both[0])
        for of, change in changes.items():
            change.add(both, parts, of, own)
    switched = with_residual(pair[1], pair[1].fit.equations.residual - np.where(on, moves, 0.0))
    densities = [np.array(x) for x in zip(*density, strict=True)]
    seen = unseen_of((pair[0], switched), densities, lost, on)
    return seen, tuple(c.judged(of) for of, c in changes.items()), replace(evidence, flights=tuple(there))


def _folds(sensors: int) -> list[np.ndarray]:
    """Which sensors (m,) are judged at a time, by states of the others; a single one cannot be."""
    count = min(FOLDS, sensors)
    return [np.arange(sensors) % count == k for k in range(count)] if count > 1 else []


@dataclass(frozen=True)
class OneFlight:
    """An unseen flight by the fit with the effect, all off: `moves` (N, m), what the effect on moves the prediction by,
    and its amplitude."""

    there: IdentifiedHypothesis
    moves: np.ndarray
    amplitude: float
    after: HypothesisFit

    @classmethod
    def put(cls, evidence: Dataset, k: int, after: HypothesisFit, along: Nuisance, effect: Effect) -> OneFlight:
        """Flight k (by position); the column of its states holds 0."""
        column = switch_column(effect)
        there = predicted(evidence, [k], after, along)
        p = there.problem
        off, on = (
            there.model.predict(
                {**p.inputs, column: np.full(len(there.number), x)}, after.found.theta, sensors=p.sensors
            ).y
            for x in (0.0, 1.0)
        )
        return cls(there, np.nan_to_num(on - off), after.found.theta[effect.amplitudes[0]], after)

    def inferred(self, by: np.ndarray | None = None) -> Inferred:
        """States, everything else known from the fit; `by` (m,): by these sensors only."""
        a = self.amplitude
        there = self.there if by is None else only(self.there, np.broadcast_to(by, self.moves.shape))
        of = _known(self.after, there)
        along_it = direction(of, self.moves / a)
        bounds = Bounds(a, a, NARROW * abs(a))
        half = np.full(len(there.number), 0.5)
        one_by_one = np.einsum("nm,nm->n", along_it.own, of.left) / np.maximum(along_it.diagonal, 1e-300)
        starts = np.concatenate([first_guesses(one_by_one / a, both_ways=False), half[None]])
        states = two_states(of, along_it, bounds, starts)
        return Inferred(there.number, states.on, states.evidence + 0.5 / NARROW**2)


def inferred(evidence: Dataset, k: int, after: HypothesisFit, along: Nuisance, effect: Effect) -> Inferred:
    """States of flight k (by position), everything else known from the fit."""
    return OneFlight.put(evidence, k, after, along, effect).inferred()


def _known(after: HypothesisFit, there: IdentifiedHypothesis) -> Basis:
    """Rows of an unseen flight with the fit's posterior, and the flight's own offsets, as nuisance of prior N(0, 1)."""
    e, B = row_parts(after, there)
    n, q = B.shape
    Q = np.linalg.qr(np.concatenate([B, np.eye(q)]))[0]
    frame = Frame(there)
    pull = Q[:n].T @ e
    rows, residual, left = (np.zeros((*frame.keep.shape, *tail)) for tail in ((q,), (), ()))
    rows[frame.keep], residual[frame.keep], left[frame.keep] = Q[:n], e, e - Q[:n] @ pull
    return Basis(
        frame,
        rows,
        e=residual,
        left=left,
        objective=float(e @ e - pull @ pull),
        pull=pull,
        prior_rows=Q[n:],
        gap=frame.neighbours.gap,
    )


def _with(f: Flight, column: str, values: np.ndarray) -> Flight:
    return replace(f, columns={**f.columns, column: np.asarray(values, float)})


def _size(f: Flight) -> int:
    return len(next(iter(f.columns.values())))
