"""What may explain a mismatch: a listed effect, or a change in time of one engine or of one sensor.

A fault begins and stays; an effect repeats with its driver. Both are columns at the same fit, so they are rivals.
Onsets are tried at the flights' beginnings and at the quarters of each flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.extended import Discrepancy, ExtendedModel
from enginediag_cli.mismatch.identified import Hypothesis, Identified
from enginediag_cli.mismatch.projection import Projection, Score, derivatives, lengths
from enginediag_cli.physics.term import Effect

EFFECT, FAULT, SENSOR_FAULT = "effect", "fault", "sensor fault"
PARTS_OF_FLIGHT = 4
LEAST_RECORDS = 8  # on either side of an onset


@dataclass(frozen=True)
class Option:
    """One thing that may be added to the model. `component`: where an engineer would look; `driver`: one of the words
    of `physics.drivers.DRIVERS`, or "time"."""

    kind: str
    label: str
    component: str
    driver: str
    hypothesis: Hypothesis


@dataclass(frozen=True)
class OptionScore:
    """Score of an option; `feasible`: its first one-step coefficient has a sign that physics allows. `columns` (n, k):
    its projected whitened rows."""

    option: Option
    score: Score
    feasible: bool
    columns: np.ndarray
    z: float  # of the first column alone

    @property
    def surprise(self) -> float:
        """−ln p, 0 for what cannot be ranked: absorbed by the nuisance, or of an impossible sign."""
        return 0.0 if self.score.absorbed or not self.feasible else self.score.surprise


def effect_option(effect: Effect) -> Option:
    return Option(EFFECT, effect.label, effect.site.component, effect.term.DRIVER, Hypothesis((effect,)))


def together(*options: Option) -> Hypothesis:
    """All of them at once."""
    hypotheses = [o.hypothesis for o in options]
    return Hypothesis(
        tuple(e for h in hypotheses for e in h.effects),
        tuple(d for h in hypotheses for d in h.discrepancies),
        {k: v for h in hypotheses for k, v in h.curves.items()},
    )


def fault_options(found: Identified) -> list[Option]:
    """A step in time of every health parameter, and of every sensor's scale, that is identified, on each engine."""
    evidence = found.evidence
    parameters = evidence.engine.parameters
    watched = [n for n in found.problem.names if n in parameters and parameters[n].family in ("health", "sensor")]
    watched = [n for n in watched if n in evidence.engine.monitored or n.endswith((".scale", ".bias"))]
    # a sensor's scale and bias step alike within what a flight spans
    watched = [n for n in watched if not (n.endswith(".bias") and n.removesuffix("bias") + "scale" in watched)]
    result = []
    for name, curve in _steps(found).items():
        for n in watched:
            sensor = parameters[n].family == "sensor"
            component = n.rpartition(".")[0] if sensor else n.partition(".")[0]
            d = Discrepancy(n, name, parameters[n].prior_sigma)
            result.append(Option(SENSOR_FAULT if sensor else FAULT, f"{n} {name}", component, "time",
                                 Hypothesis((), (d,), {name: curve})))
    return result


def _steps(found: Identified) -> dict[str, np.ndarray]:
    """Curves (records of the evidence,) that step from 0 to 1, per engine, by a name that says when."""
    steps: dict[str, np.ndarray] = {}
    evidence, first = found.evidence, 0
    of_engine, place = [], []
    for f in evidence.flights:
        n = len(next(iter(f.columns.values())))
        of_engine += [f.engine] * n
        place.append((f, first, n))
        first += n
    engines, number = np.array(of_engine), np.arange(first)
    for f, start, n in place:
        for part in range(PARTS_OF_FLIGHT):
            onset = start + part * n // PARTS_OF_FLIGHT
            mine = engines == f.engine
            curve = (mine & (number >= onset)).astype(float)
            if min(curve.sum(), mine.sum() - curve.sum()) >= LEAST_RECORDS:
                steps[f"since record {onset - start + 1} of {f.label}"] = curve
    return steps


def option_scores(found: Identified, projection: Projection, options: Sequence[Option]) -> list[OptionScore]:
    """Scores of options that the fit does not carry."""
    carried = set(found.hypothesis.names)
    options = [o for o in options if not carried & set(o.hypothesis.names)]
    if not options:
        return []
    effects = [e for o in options for e in o.hypothesis.effects]
    targets = dict.fromkeys(d.target for o in options for d in o.hypothesis.discrepancies)
    names = [*(a for e in effects for a in e.amplitudes), *targets]
    engine = found.evidence.engine
    model = ExtendedModel(
        engine.with_effects((*engine.effects, *found.hypothesis.effects, *effects)), found.model.discrepancies
    )
    J = derivatives(found, names, model)
    at = {n: j for j, n in enumerate(names)}
    stack, sizes = [], []
    for o in options:
        own = [J[:, :, at[a]] for e in o.hypothesis.effects for a in e.amplitudes]
        own += [J[:, :, at[d.target]] * o.hypothesis.curves[d.curve][found.number][:, None]
                for d in o.hypothesis.discrepancies]
        stack += own
        sizes.append(len(own))
    wide = np.stack(stack, axis=2)
    C, full = projection.projected(wide), lengths(projection.frame, wide)
    result, j = [], 0
    for o, k in zip(options, sizes, strict=True):
        columns = C[:, j : j + k]
        score = projection.score(columns, float(full[j]))
        length = max(float(np.linalg.norm(columns[:, 0])), 1e-300)
        z = float(columns[:, 0] @ projection.left) / length
        result.append(OptionScore(o, score, _feasible(o, score), columns, z))
        j += k
    return result


def _feasible(option: Option, score: Score) -> bool:
    """Whether the first coefficient of an effect moves to where physics lets it."""
    if not score.dof:
        return False
    for effect in option.hypothesis.effects:
        first = effect.term.amplitudes()[0]
        at, to = first.absent, first.absent + score.coefficients[0]
        return bool(not (first.lower >= at and to < at) and not (first.upper <= at and to > at))
    return True
