"""What would flip the name of an explanation: the smallest single error of a map, an instrument or an input.

At a fit with nuisance and options, e⊥ is the whitened residual and c⊥ what of a column survives the projection
(`fit/projection.py`). An error of size a along columns C, in the readings of all recordings, changes its χ² to

    χ²(a) = χ² + 2 aᵀC⊥ᵀe⊥ + aᵀC⊥ᵀC⊥a,

so that between the named explanation and a rival, each in the linear model at its own fit, the gap

    Δ(a) = Δ(0) + 2 aᵀ(g₂ − g₁) + aᵀ(G₂ − G₁)a,        g = C⊥ᵀe⊥,  G = C⊥ᵀC⊥

is a quadric, and the shortest a with Δ(a) = 0 lies at a = −μ (1 + μ(G₂ − G₁))⁻¹(g₂ − g₁) for one μ > 0. Of a map the
columns are the curves by which it may be wrong, beside what identification takes up of them; of an instrument its
zero and its span. Rivals are the fits that were worse, and that nothing is missing: what is left is then below the
gate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from enginediag_cli.engine.instrument_errors import suspected
from enginediag_cli.error_model.maps import QUANTITIES
from enginediag_cli.isolation.sensitivity_analysis import (
    INPUT,
    MAP,
    MOST,
    PERCENT,
    PLAUSIBLE,
    PRIOR,
    SENSOR,
    STATED,
    ConclusionChange,
    SensitivityAnalysis,
    SingleError,
)
from enginediag_cli.mismatch.explain.answer import FORMULA, IDENTIFIED, Answer
from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.progress import stage

RIVALS = 3
"""Worse fits that are compared, the best of them: what brings a far one to the front brings a near one, too."""
USUAL_ODDS = 2.0
"""Factor by which the prior odds of two explanations are open. Judgement, as of isolation."""
TURNS = 200
"""Halvings of the interval of the multiplier at most."""


@dataclass(frozen=True)
class _Direction:
    """Columns of one error, (name, curve) among those of a family, and what it is; sign: of the readings."""

    error: SingleError
    candidates: np.ndarray
    sign: float = 1.0


@stage("looking for what would flip the answer")
def flips_of_answer(answer: Answer, fits: Fits) -> SensitivityAnalysis | None:
    """Of the first explanation; None where nothing is named, or where what is named was not fitted to these records."""
    if answer.status not in (IDENTIFIED, FORMULA) or not answer.explanations:
        return None
    named = fits.fitted.get(answer.explanations[0].label)
    if named is None or not named.converged:
        return None
    others = [t for t in fits.fitted.values() if t.label != named.label and _comparable(t, named)]
    rivals = [(t, t.weighed - named.weighed) for t in sorted(others, key=lambda t: t.weighed)[:RIVALS]]
    rivals.append((fits.base, named_gain(fits, named)))
    directions, names, curves, blocks = _directions(fits.base.found)
    own = _products(named, directions, names, curves, blocks)
    nearest: dict[int, tuple[float, float, tuple[str, ...]]] = {}
    for rival, gap in rivals:
        theirs = _products(rival, directions, names, curves, blocks)
        for k, direction in enumerate(directions):
            g, G = theirs[k][0] - own[k][0], theirs[k][1] - own[k][1]
            unit = direction.error.scale
            found = shortest(gap, unit * g, unit**2 * G)
            if found is None:
                continue
            size = float(np.linalg.norm(found))
            if size <= MOST * direction.error.stated and size < nearest.get(k, (np.inf, 0.0, ()))[0]:
                sign = float(np.sign(found[0])) * direction.sign if len(found) == 1 else 1.0
                nearest[k] = size, sign, tuple(o.label for o in rival.options)
    told = [
        ConclusionChange(d.name, d.kind, sign * size, d.unit, d.stated, becomes, d)
        for k, (size, sign, becomes) in nearest.items()
        for d in (directions[k].error,)
    ]
    second = min(rivals, key=lambda rival: rival[1])
    odds = float(np.exp(np.clip(0.5 * second[1], 0.0, 700.0)))
    told.append(
        ConclusionChange("prior odds", PRIOR, odds, "times", USUAL_ODDS, tuple(o.label for o in second[0].options))
    )
    first = tuple(o.label for o in named.options)
    return SensitivityAnalysis(tuple(sorted(_the_nearer(told), key=lambda flip: flip.times)), first, len(directions))


def named_gain(fits: Fits, named: HypothesisFit) -> float:
    """By how much χ² falls with what is named beyond what chance alone reaches at the gate of detection."""
    coefficients = max(len(named.hypothesis.names), 1)
    gate = float(special.chdtri(coefficients, np.exp(-min(fits.detect.effects, 600.0))))
    return fits.base.objective - named.objective - gate


def shortest(gap: float, g: np.ndarray, G: np.ndarray) -> np.ndarray | None:
    """The shortest a (k,) with gap + 2 aᵀg + aᵀGa ≤ 0, G (k, k) symmetric; None where there is none."""
    if gap <= 0:
        return np.zeros(len(g))
    values, vectors = np.linalg.eigh(G)
    pull = vectors.T @ g
    least = float(values[0])

    def at(mu: float) -> np.ndarray:
        return np.asarray(-mu * pull / (1 + mu * values))

    def left(mu: float) -> float:
        a = at(mu)
        return gap + 2 * float(a @ pull) + float(values @ a**2)

    if least < 0:
        high = -(1 - 1e-12) / least  # from below to the pole, where the gap falls without bound
        if left(high) >= 0:  # but for where nothing pulls along the softest direction: the rest of the way is its
            a = at(high)
            a[0] = 0.0
            rest = gap + 2 * float(a @ pull) + float(values @ a**2)
            a[0] = float(np.sqrt(max(rest, 0.0) / -least))
            return np.asarray(vectors @ a)
    else:
        high = 1.0
        for _ in range(TURNS):
            if left(high) < 0:
                break
            high *= 2
        else:
            return None
    low = 0.0
    for _ in range(TURNS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if left(middle) < 0 else (middle, high)
    return np.asarray(vectors @ at(high))


def _comparable(trial: HypothesisFit, named: HypothesisFit) -> bool:
    """Whether a fit is another story of the same size, behind the one that is named."""
    same = len(trial.options) == len(named.options) and trial.converged
    return same and not trial.at_bound and trial.weighed >= named.weighed


def _products(
    trial: HypothesisFit,
    directions: Sequence[_Direction],
    names: Sequence[str],
    curves: np.ndarray,
    blocks: Sequence[Sequence[int]],
) -> list[tuple[np.ndarray, np.ndarray]]:
    """g (k,) and G (k, k) of each direction at the fit of a trial."""
    columns = Columns(trial.found, names, ())
    sums = Sums(trial.projection, columns, grid(names, curves, blocks))
    found = [(sums.pulls(d.candidates), sums.gram(d.candidates)) for d in directions]
    columns.rest()
    trial.projection.rest()
    return found


def _directions(found: IdentifiedHypothesis) -> tuple[list[_Direction], list[str], np.ndarray, list[list[int]]]:
    """Errors that are tried at a fit, names of the parameters and inputs along which they act, curves (N, Φ), and
    which of these stand together."""
    N = len(found.problem.recording)
    columns, blocks = [np.ones(N)], [[0]]
    names: list[str] = []
    directions = []
    for name, error, curve, sign in _instruments(found):
        if curve is not None:
            columns.append(curve)
            blocks.append([len(columns) - 1])
        if name not in names:
            names.append(name)
        at = 0 if curve is None else len(columns) - 1
        directions.append(_Direction(error, np.array([[names.index(name), at]]), sign))
    accuracy = found.evidence.settings.map_accuracy
    by_target: dict[str, list[str]] = {}
    for d in found.model.discrepancies:
        if found.model.parameters[d.target].quantity in QUANTITIES and d.curve in found.problem.inputs:
            by_target.setdefault(d.target, []).append(d.curve)
    place: dict[str, int] = {}
    for target, keys in by_target.items() if accuracy > 0 else ():
        for key in keys:
            if key not in place:
                columns.append(np.nan_to_num(np.asarray(found.problem.inputs[key], float)))
                place[key] = len(columns) - 1
        blocks.append([place[key] for key in keys])
        names.append(target)
        error = SingleError(target, MAP, -1, "", "%", 1 / PERCENT, PERCENT * accuracy, STATED)
        directions.append(_Direction(error, np.array([[len(names) - 1, place[key]] for key in keys])))
    return directions, names, np.stack(columns, axis=1), blocks


def _instruments(found: IdentifiedHypothesis) -> Iterator[tuple[str, SingleError, np.ndarray | None, float]]:
    """Zero and span of each instrument: the parameter or input along which it acts, its error, the curve where it is
    not constant, and the sign of what is recorded where readings fall with the column."""
    engine, problem = found.evidence.engine, found.problem
    for column, sensor in engine.sensors.items():
        if column not in problem.sensors:
            continue
        reading = float(np.nanmean(np.abs(problem.measured[:, list(problem.sensors).index(column)])))
        for p in sensor.parameters():
            if p.quantity not in ("bias", "scale"):
                continue
            share = p.quantity == "scale"
            scale, unit = (1 / PERCENT, "%") if share else (1.0, p.shown_unit)
            error = SingleError(p.name, SENSOR, -1, column, unit, scale, p.prior_sigma / scale, PLAUSIBLE, reading)
            yield p.name, error, None, 1.0
    for column in engine.inputs:
        wrong = suspected(engine, column)
        if wrong is None or column not in problem.inputs:
            continue
        p, values = wrong.parameter, np.asarray(problem.inputs[column], float)
        scale, unit = (1 / PERCENT, "%") if wrong.multiplies else (1.0, p.shown_unit)
        reading = float(np.mean(np.abs(values)))
        error = SingleError(p.name, INPUT, -1, column, unit, scale, p.prior_sigma / scale, PLAUSIBLE, reading)
        # what reads too high is predicted for another operating point: the residual falls by ∂y/∂u
        yield column, error, values if wrong.multiplies else None, -1.0


def _the_nearer(flips: Sequence[ConclusionChange]) -> list[ConclusionChange]:
    """Of zero and span of one instrument the one that is nearer by what is stated."""
    best: dict[str, ConclusionChange] = {}
    for flip in flips:
        key = flip.error.column if flip.error is not None and flip.error.column else flip.name
        if key not in best or flip.times < best[key].times:
            best[key] = flip
    return list(best.values())
