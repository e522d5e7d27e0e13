"""Two to four causes of mixed kinds, each of which shows beside the others.

Kinds are drawn first, then places, then sizes: each cause is to leave a λ of its own, given all others, and its size is
scaled by √(λ wanted/λ given) within what is plausible; what still does not show is drawn anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.errors import NoVerdictError
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.validation.blind.causes import Cause
from enginediag_cli.validation.blind.laws.drawn import Ground, NothingShownError, Sort, shaped_law
from enginediag_cli.validation.blind.laws.places import joined
from enginediag_cli.validation.blind.laws.truth import LawTruth
from enginediag_cli.validation.blind.visible import drawable, noise_free_fit, true_readings, weights

EFFECT, LAW, FAULT, SENSOR_FAULT = "effect", "law", "fault", "sensor fault"
SHARES: Mapping[str, float] = {EFFECT: 0.45, LAW: 0.2, FAULT: 0.2, SENSOR_FAULT: 0.15}
"""Kinds of causes. Of all but effects there is one at most, and never one kind alone."""
SHOWS = 40.0
"""λ of each cause, given the others, from which a trial is judged."""
LAMBDA = (60.0, 2000.0)
"""λ wanted of each cause, given the others, from and to, evenly in the logarithm."""
SIZE = (0.15, 2.0)
"""Of a typical size, the smallest and the largest."""
STEP: Mapping[str, float] = {FAULT: 0.01, SENSOR_FAULT: 0.005}
"""Typical steps of a health parameter and of a sensor's scale, relative."""
TRIES, SCALINGS = 400, 2
"""Sets of causes that are drawn, and times that the sizes of one are scaled, at most."""


@dataclass(frozen=True)
class Part:
    """One cause with its size over the typical one; of an effect also `effect` with the values of that size, of a law
    `law`, of a step how much changes at size 1."""

    kind: str
    cause: Cause
    size: float
    effect: Effect | None = None
    law: LawTruth | None = None
    change: float = 0.0

    @property
    def carried(self) -> Effect | None:
        """The effect or law with its values at this size."""
        if self.law is not None:
            values = {n: v * self.size for n, v in self.law.effect.values.items()}
            return replace(self.law.effect, values=values)
        if self.effect is None:
            return None
        known = {c.name: c for c in self.effect.term.amplitudes()}
        values = {n: known[n].absent + self.size * (v - known[n].absent) for n, v in self.effect.values.items()}
        return replace(self.effect, values=values)

    @property
    def is_plausible(self) -> bool:
        """Every coefficient of an effect within its bounds: who explains refuses one that ends at a bound."""
        effect = self.carried if self.law is None else None
        if effect is None:
            return True
        return all(p.lower < p.nominal < p.upper for p in effect.parameters() if p.name in effect.amplitudes)

    def hypothesis(self, engine: Engine, records: int) -> Hypothesis:
        """The cause as something to fit, begun at its size."""
        if self.carried is not None:
            return Hypothesis((self.carried,))
        name = f"since record {self.cause.first}"
        step = (np.arange(records) >= self.cause.first).astype(float)
        sought = Discrepancy(self.cause.name, name, engine.parameters[self.cause.name].prior_sigma)
        return Hypothesis((), (sought,), {name: step})

    def scaled(self, factor: float) -> Part:
        """Within what is plausible; a law is, as it was drawn, up to twice its size."""
        return replace(self, size=float(np.clip(self.size * factor, *SIZE)))


@dataclass(frozen=True)
class Several:
    """The causes of a trial, as `Sealed` has them."""

    causes: tuple[Cause, ...]
    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    changes: Mapping[str, float]
    law: LawTruth | None
    kinds: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(parts: Sequence[Part]) -> Several:
        carried = {p.cause.name: p.carried for p in parts}
        effects = tuple(e for e in carried.values() if e is not None)
        law = next((replace(p.law, effect=e) for p in parts if p.law is not None for e in [p.carried] if e), None)
        return Several(
            tuple(p.cause for p in parts),
            effects,
            {e.parameter_name(c): v for e in effects for c, v in e.values.items()},
            {p.cause.name: p.change * p.size for p in parts if p.cause.is_step},
            law,
            {p.cause.name: p.kind for p in parts},
        )


def draw_several(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    count: int,
    rng: np.random.Generator,
) -> Several:
    """So many causes that these flights, those that are searched, show. Raises NothingShownError where none are
    found."""
    ground = Ground.of(engine, flights, model_error)
    for _ in range(TRIES):
        parts = _parts(ground, count, rng)
        wanted = np.exp(rng.uniform(np.log(LAMBDA[0]), np.log(LAMBDA[1]), count))
        for _ in range(SCALINGS):
            given = _given(ground, flights, model_error, parts) if parts else None
            if given is None:
                break
            parts = [p.scaled(float(np.sqrt(w / max(g, 1e-3)))) for p, w, g in zip(parts, wanted, given, strict=True)]
        last = _given(ground, flights, model_error, parts) if parts else None
        if last is not None and min(last) >= SHOWS:
            return Several.of(parts)
    raise NothingShownError(f"{engine.name}: no {count} causes were found that these flights show beside each other")


def _parts(ground: Ground, count: int, rng: np.random.Generator) -> list[Part]:
    """So many causes, of two kinds at least; none where one cannot be drawn."""
    n = ground.found.evidence.records
    kinds: list[str] = []
    while len(kinds) < count:
        kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
        if kind == EFFECT or kind not in kinds:
            kinds.append(kind)
        if len(kinds) == count and len(set(kinds)) == 1:
            kinds = []
    found: list[Part] = []
    for kind in kinds:
        part = {EFFECT: _effect, LAW: _law}.get(kind, _step)(ground, kind, n, rng)
        if part is None or part.cause.name in {p.cause.name for p in found}:
            return []
        found.append(part)
    return found


def _effect(ground: Ground, kind: str, n: int, rng: np.random.Generator) -> Part:
    library = drawable(ground.engine)
    share = np.array([weights(ground.engine.path, SIZE[1])[e.label] for e in library])
    effect = library[int(rng.choice(len(library), p=share / share.sum()))]
    values = {c.name: c.absent + rng.uniform(0.5, 1.0) * (c.typical - c.absent) for c in effect.term.amplitudes()}
    return Part(kind, Cause(effect.label), 1.0, replace(effect, values=values))


def _law(ground: Ground, kind: str, n: int, rng: np.random.Generator) -> Part | None:
    law = shaped_law(ground, Sort.drawn(rng), rng)
    return None if law is None else Part(kind, Cause(law.effect.label), 1.0, law=law)


def _step(ground: Ground, kind: str, n: int, rng: np.random.Generator) -> Part:
    """A health parameter, or a sensor's scale, that changes at some record of the middle half and stays."""
    engine = ground.engine
    first, sign = int(rng.integers(n // 4, 3 * n // 4)), float(rng.choice((-1.0, 1.0)))
    if kind == SENSOR_FAULT:
        name = str(rng.choice([f"sensor.{s.quantity}.scale" for s in engine.sensors.values()]))
    else:
        name = str(rng.choice(list(engine.monitored)))
        if engine.parameters[name].wear < 0:
            sign = -1.0  # no fault makes a part better
    change = sign * STEP[kind] * (abs(engine.parameters[name].nominal) or 1.0)
    return Part(kind, Cause(name, first), 1.0, change=change)


def _given(
    ground: Ground, flights: Sequence[Mapping[str, np.ndarray]], model_error: float, parts: Sequence[Part]
) -> list[float] | None:
    """λ of each cause given the others, on these flights without noise; None where one is not plausible, a fit does not
    converge, or begins where the engine cannot run."""
    if not all(p.is_plausible for p in parts):
        return None
    engine, n = ground.engine, ground.found.evidence.records
    several = Several.of(parts)
    truth = engine.with_effects((*engine.effects, *several.effects))
    theta: dict[str, float | np.ndarray] = dict(several.values)
    for cause in several.causes:
        if cause.is_step:
            theta[cause.name] = engine.parameters[cause.name].nominal + several.changes[cause.name] * (
                np.arange(n) >= cause.first
            )
    base = noise_free_fit(engine, flights, model_error, true_readings(truth, flights, theta))
    if not base.converged:
        return None
    found = []
    for k in range(len(parts)):
        others = joined(*(p.hypothesis(engine, n) for j, p in enumerate(parts) if j != k))
        try:
            fit = identify_with(base.evidence, others, nuisance(base.evidence), base)
        except NoVerdictError:
            return None
        if not fit.converged:
            return None
        found.append(Projection(fit).objective)
    return found
