"""Which step or ramp of power would separate two explanations of which one remembers.

Effects with memory differ by how they answer: a rate limit takes longer for a larger step, a lag does not, a delay is
late by as much on a ramp. Both explanations fly the same manoeuvres, as fitted; what is left between them when the
second has adapted its coefficients to what the first would show is what a recording of it would tell:

    λ_sep = min over r of Σ ((y_first − y_second(r))/σ)² (1 − ρ)/(1 + ρ)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.tape import MOMENT
from enginediag_cli.mismatch.explain.alias_advice import MANOEUVRE, SEPARATED, Advice, Suggestion, advise
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.fit.identified import Identified, inputs_of
from enginediag_cli.progress import stage

DURATION_S = 300
"""Of a manoeuvre, recorded once a second."""
BEGIN_S, BLIP_S = 30.0, 10.0
"""When power begins to change, and how long a blip lasts."""
STEPS, SMALLEST = 6, 1e-6
"""Gauss–Newton steps of what the second explanation adapts, and the ridge of their normal equations: an answer to a
hundredth is enough."""
MOST_TIMES = 100
"""Repetitions beyond which a manoeuvre is told as of no use."""

Profile = Callable[[np.ndarray], np.ndarray]


def _ramp(low: float, high: float, seconds: float) -> Profile:
    return lambda t: np.interp(t, [BEGIN_S, BEGIN_S + seconds], [low, high])


def _blip(low: float, high: float) -> Profile:
    return lambda t: np.where((t >= BEGIN_S) & (t < BEGIN_S + BLIP_S), high, low)


MANOEUVRES: Mapping[str, Profile] = {
    "a step of power from 10 to 90 % of its range": _ramp(0.1, 0.9, 1.0),
    "a step of power from 90 to 10 % of its range": _ramp(0.9, 0.1, 1.0),
    "a step of power from 45 to 55 % of its range": _ramp(0.45, 0.55, 1.0),
    "a ramp of power from 10 to 90 % in a minute": _ramp(0.1, 0.9, 60.0),
    "a ramp of power from 10 to 90 % in three minutes": _ramp(0.1, 0.9, 180.0),
    "power raised from 10 to 90 % for ten seconds": _blip(0.1, 0.9),
}
"""What may be flown, in words, and its course of power, 0 to 1, along time in seconds."""


def remembers(explanation: Explanation) -> bool:
    """Whether any of its effects does."""
    return any(MOMENT in e.term.INPUTS for o in explanation.options for e in o.hypothesis.effects)


@stage("looking for manoeuvres that separate rivals")
def advise_manoeuvres(base: Identified, first: Explanation, second: Explanation, most: int = 3) -> Advice | None:
    """The best manoeuvres to tell two explanations fitted to the evidence of `base`; None for an engine of which it is
    not known how much power it may be asked for."""
    one, other = (_engine_with(base, e) for e in (first, second))
    told = []
    for words, profile in MANOEUVRES.items():
        inputs = _flown(base, profile)
        if inputs is None:
            return None
        lam = _left(base, (one, other), inputs, tuple(c.name for c in second.coefficients))
        times = float(np.ceil(SEPARATED / lam)) if lam * MOST_TIMES > SEPARATED else np.inf
        told.append(Suggestion(MANOEUVRE, words, {}, lam, times))
    told.sort(key=lambda s: (s.records, -s.gain))
    return Advice((first.label, second.label), max(second.objective - first.objective, 0.0), tuple(told[:most]))


def _engine_with(base: Identified, explanation: Explanation) -> Engine:
    """The engine at the fit, with the effects of an explanation as it was fitted."""
    engine = base.evidence.engine
    effects = [e for o in explanation.options for e in o.hypothesis.effects]
    carrying = engine.with_effects((*engine.effects, *effects))
    values = base.theta | {c.name: c.value for c in explanation.coefficients}
    return carrying.at({n: v for n, v in values.items() if n in carrying.parameters})


def _flown(base: Identified, profile: Profile) -> dict[str, np.ndarray] | None:
    """Inputs along a manoeuvre, once a second, at the conditions in the middle of the flights."""
    engine = base.evidence.engine
    time = np.arange(float(DURATION_S))
    demand = engine.network.demand
    asked = engine.power_setting if demand is None else demand.column
    recorded = inputs_of(base.evidence)
    middle = {c: np.full(len(time), np.nanmedian(recorded[c])) for c in engine.inputs if c != asked}
    if engine.power_range is not None:
        middle[asked] = engine.power_from_fraction(profile(time), middle)
    elif asked in engine.envelope:
        low, high = engine.envelope[asked]
        middle[asked] = low + (high - low) * profile(time)
    else:
        return None
    return {"time_s": time, **middle}


def _left(
    base: Identified, engines: tuple[Engine, Engine], flown: Mapping[str, np.ndarray], adapted: tuple[str, ...]
) -> float:
    """λ_sep of one recording of a manoeuvre."""
    problem = base.problem
    weight = np.sqrt((1.0 - base.rho) / (1.0 + base.rho)) / problem.sigma
    inputs = {c: v for c, v in flown.items() if c in engines[0].inputs}
    one, other = ({**inputs, MOMENT: e.tapes.add(flown)} for e in engines)
    wanted = engines[0].predict(one, sensors=problem.sensors)
    r = {n: engines[1].parameters[n].nominal for n in adapted if n in engines[1].parameters}
    least = np.inf
    for _ in range(STEPS):
        p = engines[1].predict(other, r, sensors=problem.sensors, wrt=tuple(r))
        ok = wanted.ok & p.ok
        e = ((wanted.y - p.y) * weight)[ok].ravel()
        least = min(least, float(e @ e))
        J = (p.jacobian * weight[:, None])[ok].reshape(-1, len(r))
        G = J.T @ J
        step = np.linalg.solve(G + SMALLEST * (np.trace(G) + 1e-300) * np.eye(len(r)), J.T @ e)
        bounds = engines[1].parameters
        r = {
            n: float(np.clip(v + d, bounds[n].lower, bounds[n].upper))
            for (n, v), d in zip(r.items(), step, strict=True)
        }
    return least


def _within(engine: Engine, name: str, value: float) -> float:
    p = engine.parameters[name]
    return min(max(value, p.lower), p.upper)


def advice_between(base: Identified, explanations: Sequence[Explanation], most: int = 2) -> list[Advice]:
    """Between the best explanation and the next `most` of its alias set, which of manoeuvres or of operating conditions
    would tell."""
    first = explanations[0]
    found = [
        (advise_manoeuvres if remembers(first) or remembers(e) else advise)(base, first, e)
        for e in explanations[1 : most + 1]
    ]
    return [a for a in found if a is not None]
