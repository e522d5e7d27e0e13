"""Refinement by an effect that switches without any column showing when.

On the flights that are fitted the states come from the search for hidden effects. On an unseen flight they are
inferred by the same forward–backward recursion, now with everything else known from the fit, amplitude included, and
the flight's log predictive density is that of the readings with the states summed over:

    ℓ = ℓ(all off) + ln Σ_s P(s) exp{a g_s − ½ a² |P C s|²}

so that two states a record do not buy a better fit. What the inference does to a flight without the effect is counted
against it. A lower bound is taken where states and identified parameters are dependent (`hidden_states`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.explain.story import hidden_search
from enginediag_cli.mismatch.fit.evidence import Evidence, Flight
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, Identified, Nuisance, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Frame, Projection
from enginediag_cli.mismatch.fit.trial_fit import Trial
from enginediag_cli.mismatch.refine.unseen import (
    BLOCKS,
    FEW_FLIGHTS,
    Unseen,
    compare,
    log_density,
    predicted,
    row_parts,
)
from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding, effects_at
from enginediag_cli.mismatch.unrecorded.states import Bounds, first_guesses, two_states
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, direction
from enginediag_cli.progress import stage

NARROW = 1e-3
"""Prior standard deviation of a known amplitude over its size: its own term is then a constant, taken out again."""


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


def with_states(evidence: Evidence, training: Sequence[int], finding: HiddenFinding, column: str) -> Evidence:
    """The evidence with the finding's states (its records are those of the training flights, in order) in a column;
    0 on all other flights."""
    assert finding.states is not None
    sizes = [_size(evidence.flights[k]) for k in training]
    stacked = np.zeros(sum(sizes))
    stacked[finding.number] = finding.states > 0.5
    parts = dict(zip(training, np.split(stacked, np.cumsum(sizes)[:-1]), strict=True))
    flights = tuple(_with(f, column, parts.get(k, np.zeros(_size(f)))) for k, f in enumerate(evidence.flights))
    return replace(evidence, flights=flights)


@stage("looking for what switches")
def find_switch(training: Evidence, effect: Effect) -> HiddenFinding | None:
    """The likeliest switch on these flights at a place where the effect acts; None when there is none."""
    along = nuisance(training)
    fit = identify_with(training, NO_HYPOTHESIS, along)
    if not fit.converged:
        return None
    base = Trial((), fit, Projection(fit))
    for f in hidden_search(training)(base):
        if f.is_switch and effect.label in {e.label for e in effects_at(f.location, training.engine)}:
            return f
    return None


def in_runs(evidence: Evidence, unseen: Sequence[int]) -> tuple[Evidence, list[int]]:
    """With few unseen flights, each of them cut into runs of records that stand as flights of their own."""
    if len(unseen) >= FEW_FLIGHTS:
        return evidence, list(unseen)
    flights: list[Flight] = []
    positions: list[int] = []
    for k, f in enumerate(evidence.flights):
        pieces = np.array_split(np.arange(_size(f)), BLOCKS) if k in unseen else [np.arange(_size(f))]
        for j, rows in enumerate(pieces):
            if k in unseen:
                positions.append(len(flights))
            label = f"{f.label} run {j + 1}" if k in unseen else f.label
            flights.append(replace(f, label=label, columns={c: np.asarray(v)[rows] for c, v in f.columns.items()}))
    return replace(evidence, flights=tuple(flights)), positions


def joined(evidence: Evidence, whole: Evidence, column: str) -> Evidence:
    """The flights as they were before `in_runs`, with the states that their runs have now."""
    stacked = np.concatenate([f.columns[column] for f in evidence.flights])
    parts = np.split(stacked, np.cumsum([_size(f) for f in whole.flights])[:-1])
    flights = tuple(_with(f, column, part) for f, part in zip(whole.flights, parts, strict=True))
    return replace(whole, flights=flights)


def compare_switched(
    evidence: Evidence, unseen: Sequence[int], before: Trial, after: Trial, along: Nuisance, effect: Effect
) -> tuple[Unseen, Evidence]:
    """As `compare`, states of the unseen flights inferred; also the evidence with these states in its column."""
    column = switch_column(effect)
    found = [inferred(evidence, k, after, along, effect) for k in unseen]
    flights = list(evidence.flights)
    for k, i in zip(unseen, found, strict=True):
        states = np.zeros(_size(flights[k]))
        states[i.number] = i.on > 0.5
        flights[k] = _with(flights[k], column, states)
    there = replace(evidence, flights=tuple(flights))
    seen = compare(there, unseen, before, after, along)
    densities = []
    for k, i in zip(unseen, found, strict=True):
        one = [predicted(evidence, [k], t, along) for t in (before, after)]
        whole = np.zeros(len(one[0].problem.recording), int)
        densities.append((log_density(before, one[0], whole)[0], log_density(after, one[1], whole)[0] + i.evidence))
    a, b = (np.array(x) for x in zip(*densities, strict=True))
    name = "flight" if len(unseen) >= FEW_FLIGHTS and not _runs(evidence, unseen) else "run of records"
    seen = replace(
        seen,
        flights_before=a,
        flights_after=b,
        units_before=a,
        units_after=b,
        unit=name,
        states=_by_state(there, unseen, before, after, along, column),
    )
    return seen, there


def inferred(evidence: Evidence, k: int, after: Trial, along: Nuisance, effect: Effect) -> Inferred:
    """States of flight k (by position), everything else known from the fit."""
    column, name = switch_column(effect), effect.amplitudes[0]
    there = predicted(evidence, [k], after, along)  # its column holds 0: all off
    of = _known(after, there)
    problem = there.problem
    a = after.found.theta[name]
    theta = {**after.found.theta}
    on = there.model.predict({**problem.inputs, column: np.ones(len(there.number))}, theta, sensors=problem.sensors).y
    off = there.model.predict({**problem.inputs, column: np.zeros(len(there.number))}, theta, sensors=problem.sensors).y
    along_it = direction(of, np.nan_to_num((on - off) / a))
    bounds = Bounds(a, a, NARROW * abs(a))
    half = np.full(len(there.number), 0.5)
    one_by_one = np.einsum("nm,nm->n", along_it.own, of.left) / np.maximum(along_it.diagonal, 1e-300)
    starts = np.concatenate([first_guesses(one_by_one / a, both_ways=False), half[None]])
    states = two_states(of, along_it, bounds, starts)
    return Inferred(there.number, states.on, states.evidence + 0.5 / NARROW**2)


def _known(after: Trial, there: Identified) -> Basis:
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


def _by_state(
    evidence: Evidence, unseen: Sequence[int], before: Trial, after: Trial, along: Nuisance, column: str
) -> dict[str, tuple[float, float, int]]:
    """χ² per reading before and after, and readings, within on and within off."""
    pair = [predicted(evidence, unseen, t, along) for t in (before, after)]
    e = [(p.fit.equations.residual / p.problem.sigma) ** 2 for p in pair]
    both = np.isfinite(e[0]) & np.isfinite(e[1])
    on = np.concatenate([np.asarray(evidence.flights[k].columns[column]) for k in unseen])[pair[0].number] > 0.5
    result = {}
    for name, rows in (("on", on), ("off", ~on)):
        keep = both & rows[:, None]
        if keep.any():
            result[name] = float(e[0][keep].mean()), float(e[1][keep].mean()), int(keep.sum())
    return result


def _runs(evidence: Evidence, unseen: Sequence[int]) -> bool:
    return any(" run " in evidence.flights[k].label for k in unseen)


def _with(f: Flight, column: str, values: np.ndarray) -> Flight:
    return replace(f, columns={**f.columns, column: np.asarray(values, float)})


def _size(f: Flight) -> int:
    return len(next(iter(f.columns.values())))
