"""What may be wrong in a trial: causes, the effects that can be drawn, and how often each is drawn.

The concealed truth and the answer are written in the same terms, so that the scorer compares like with like. An effect
that identification absorbs at any size is drawn seldom: its trial shows little more than one with nothing concealed.

Dynamic effects are rate limits, lags, delays, heat soak and inertia. Their kind is drawn first and their location after
that, since an engine has more probes than fuel controls. Sizes are in seconds that recordings of some minutes at 1 Hz
can show. A rotor's inertia is drawn as the time in which its whole design power would bring it to speed: kilogram
metres squared of a model jet say nothing about a fan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.tape import MOMENT
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.fit.options import Option, effect_option, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects, effect, separate_effects
from enginediag_cli.physics.terms.control import (
    FuelControlLag,
    FuelRateLimit,
    LoadControlDelay,
    LoadControlLag,
    LoadRateLimit,
    LoadSecondOrderLag,
)
from enginediag_cli.physics.terms.probe import ClockShift, ProbeLag
from enginediag_cli.physics.terms.turbomachinery import HeatSoak, RotorInertia
from enginediag_cli.units import RAD_S_PER_RPM
from enginediag_cli.validation.trial_flights import check_flyable as check_flights
from enginediag_cli.validation.trial_flights import draw_flights, hour_columns, stack_flights


@dataclass(frozen=True)
class Cause:
    """An effect, `name` = `term@site`, or a step, `name` = the parameter that steps at record `first` of all
    records in order (−1: an effect)."""

    name: str
    first: int = -1

    @property
    def is_step(self) -> bool:
        return self.first >= 0

    def to_json(self) -> dict[str, Any]:
        return {"name": self.name, "first": self.first}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Cause:
        return cls(str(values["name"]), int(values["first"]))


FittedCauses = tuple[Sequence[Cause], Mapping[str, float]]
"""Causes, and coefficients at which effects that are tried at some size are begun."""
CauseNames = frozenset[str]
"""A set of causes by name: when a step began is no part of its identity."""


def instrument_place(column: str) -> str:
    """The place of an instrument's error, in trials of isolation."""
    return f"reading {column}"


def cause_names(causes: Sequence[Cause]) -> CauseNames:
    return frozenset(c.name for c in causes)


def causes_from_options(options: Sequence[Option]) -> tuple[Cause, ...]:
    """The causes that an explanation's options stand for."""
    found = [Cause(own.label) for o in options for e in o.hypothesis.effects for own in separate_effects(e)]
    for o in options:
        for d in o.hypothesis.discrepancies:
            found.append(Cause(d.target, int(np.argmax(o.hypothesis.curves[d.curve] > 0))))
    return tuple(found)


def effect_from_cause(engine: Engine, cause: Cause) -> Effect:
    """The effect that a cause names."""
    term, _, site = cause.name.partition("@")
    return effect(engine, term, site)


def causes_hypothesis(
    engine: Engine, causes: Sequence[Cause], records: int, values: Mapping[str, float] | None = None
) -> Hypothesis:
    """The causes as something to fit to evidence of so many records of one engine. `values`: coefficients by parameter
    at which effects start whose derivative at absence is uninformative."""
    effects = tuple(_start_at_sizes(effect_from_cause(engine, c), values or {}) for c in causes if not c.is_step)
    steps = [c for c in causes if c.is_step]
    curves = {f"since record {c.first}": (np.arange(records) >= c.first).astype(float) for c in steps}
    found = tuple(Discrepancy(c.name, f"since record {c.first}", engine.parameters[c.name].prior_sigma) for c in steps)
    return Hypothesis(effects, found, curves)


def _start_at_sizes(effect: Effect, values: Mapping[str, float]) -> Effect:
    if not effect.trial_names:
        return effect
    known = {c.name: effect.parameter_name(c.name) for c in effect.term.amplitudes()}
    return replace(effect, values={**effect.values, **{c: values[n] for c, n in known.items() if n in values}})


def cause_components(engine: Engine, cause: Cause) -> frozenset[str]:
    """Where an engineer would look: the effect's component, and those whose parameters it acts through (a variation
    of cooling flow is of the turbine and of the cooling bleed)."""
    if cause.is_step:
        return frozenset({engine.parameters[cause.name].component})
    site = effect_from_cause(engine, cause).site
    leaves = {engine.parameters[leaf].component for leaf in site.targets if leaf in engine.parameters}
    return frozenset({site.component} | leaves)


SIZES: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        FuelRateLimit.NAME: {"rise": (4.0, 20.0), "fall": (4.0, 20.0)},
        FuelControlLag.NAME: {"time_constant": (0.7, 5.0)},
        LoadRateLimit.NAME: {"rise": (15.0, 120.0), "fall": (15.0, 120.0)},
        LoadControlLag.NAME: {"time_constant": (3.0, 30.0)},
        LoadSecondOrderLag.NAME: {"time_constant": (5.0, 30.0), "second_share": (0.25, 0.5)},
        LoadControlDelay.NAME: {"delay": (3.0, 25.0)},
        ProbeLag.NAME: {"time_constant": (1.5, 12.0)},
        ClockShift.NAME: {"delay": (0.7, 8.0)},
        HeatSoak.NAME: {"exchange": (0.015, 0.08), "time_constant": (8.0, 120.0)},
    }
)
"""Coefficients by effect, from and to, evenly in the logarithm. Judgement within the ranges that the effects state."""
ACCELERATION_S = (1.0, 8.0)
"""I ω²/P at the design point of a shaft, from and to: Walsh and Fletcher, Gas Turbine Performance, ch. 8, spools from
idle to rating in some seconds."""
EITHER_SIGN = (ClockShift.NAME,)
"""Effects that are drawn with both signs: a clock may be ahead."""


def drawable_memories(engine: Engine) -> list[Effect]:
    """Every effect with memory that can be concealed here: of inertias only that of the rotor whose speed sets the
    power. Another's speed is held, or follows from its inertia record by record: a simulation in time, not a tape."""
    found = [e for e in candidate_effects(engine) if MOMENT in e.term.INPUTS]
    driven = engine.network.speed_columns.get(engine.power_setting)
    return [e for e in found if not isinstance(e.term, RotorInertia) or e.site.name == driven]


def draw_memories(engine: Engine, count: int, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """So many effects of different kinds, and their coefficients by parameter; nothing is drawn for none."""
    library = drawable_memories(engine)
    kinds = list(dict.fromkeys(e.term.NAME for e in library))
    effects: list[Effect] = []
    values: dict[str, float] = {}
    for k in rng.choice(len(kinds), count, replace=False) if count else ():
        own = [e for e in library if e.term.NAME == kinds[int(k)]]
        effect = own[int(rng.integers(len(own)))]
        effects.append(effect)
        for c in effect.term.amplitudes():
            values[effect.parameter_name(c.name)] = _size(engine, effect, c, rng)
    return tuple(effects), values


def _size(engine: Engine, effect: Effect, c: Coefficient, rng: np.random.Generator) -> float:
    if isinstance(effect.term, RotorInertia):
        assert engine.network.design_point is not None
        shaft = engine.network.design_point.shafts[effect.site.name]
        omega = RAD_S_PER_RPM * scalar(shaft.speed_rpm)
        return _log_uniform(*ACCELERATION_S, rng) * scalar(shaft.supply_W) / omega**2
    # of an effect that this file does not know, the size that it calls typical
    low, high = SIZES.get(effect.term.NAME, {}).get(c.name, (0.5 * c.typical, c.typical))
    sign = rng.choice((-1.0, 1.0)) if effect.term.NAME in EITHER_SIGN else 1.0
    return float(np.clip(sign * _log_uniform(low, high, rng), c.lower, c.upper))


def _log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


SELDOM = 0.1
"""Weight of an effect whose λ, at the largest size that is drawn, is below 25 on a set of flights with exact maps."""

VISIBLE = 25.0
"""λ from which a cause counts as visible: five standard deviations."""


def drawable_effects(engine: Engine) -> list[Effect]:
    """Every term at every site that can act on this engine with what its recordings hold."""
    known = {*engine.inputs, *engine.optional_inputs, *hour_columns()}
    return [e for e in candidate_effects(engine) if set(e.term.INPUTS) <= known]


@lru_cache(maxsize=4)
def draw_weights(path: str, largest: float) -> dict[str, float]:
    """Label of each drawable effect of the engine file → weight; `largest`: largest size drawn, over the typical."""
    engine = load_engine(path)
    library = drawable_effects(engine)
    flights, training = draw_flights(engine, np.random.default_rng(0))
    found = noise_free_fit(engine, flights[:training], 0.0)
    result = {}
    for s in option_scores(found, Projection(found), [effect_option(e) for e in library]):
        first = s.option.hypothesis.effects[0].term.amplitudes()[0]
        size = largest * (first.typical - first.absent)
        result[s.option.label] = 1.0 if (s.score.length * size) ** 2 >= VISIBLE else SELDOM
    return result


def noise_free_fit(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    read: np.ndarray | None = None,
) -> IdentifiedHypothesis:
    """The engine as its file says, flown without noise and fitted. `read` (N, m): what its sensors read instead, over
    all flights, where the truth is another engine."""
    recorded, first = [], 0
    for j, f in enumerate(flights):
        if read is None:
            p = engine.predict({c: f[c] for c in engine.inputs})
            y = np.where(p.ok[:, None], p.y, np.nan)
        else:
            y = read[first : first + len(f["time_s"])]
            first += len(y)
        recorded.append(Flight(f"flight_{j + 1}", "", {**f, **dict(zip(engine.sensors, y.T, strict=True))}))
    evidence = build_dataset(engine, recorded, MismatchQuery(model_error=model_error, drivers=hour_columns()))
    return identify_with(evidence, NULL_HYPOTHESIS, nuisance(evidence))


def true_readings(
    truth: Engine, flights: Sequence[Mapping[str, np.ndarray]], theta: Mapping[str, float | np.ndarray]
) -> np.ndarray:
    """What an engine's sensors read without noise over all flights (N, m), NaN where it has no solution."""
    u = stack_flights(flights)
    p = truth.predict({c: u[c] for c in (*truth.inputs, *truth.optional_inputs) if c in u}, theta)
    return np.where(p.ok[:, None], p.y, np.nan)


def check_engine(path: str) -> None:
    """Raises DataError, or ConfigError of the engine file, for an engine that cannot."""
    engine = load_engine(path)
    check_flights(engine)
    silent = [c for c, s in engine.sensors.items() if not s.noise_sigma > 0]
    if silent:
        raise DataError(
            f"{engine.name}: blind trials need the noise of every sensor; none is stated for {', '.join(silent)}"
        )
    if not engine.monitored or not drawable_effects(engine):
        raise DataError(f"{engine.name}: nothing to conceal: no monitored parameter, or no effect that can act")
