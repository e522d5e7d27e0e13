"""What is wrong in a trial, or is said to be: effects, and steps in time of a health parameter or of a sensor.

The same words for the sealed truth and for an explainer's answer, so that the scorer compares like with like.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import Option
from enginediag_cli.physics.registry import each, effect


@dataclass(frozen=True)
class Cause:
    """An effect, `name` = `term@site`, or a step, `name` = the parameter that steps at record `first` of all
    records in order (−1: an effect)."""

    name: str
    first: int = -1

    @property
    def is_step(self) -> bool:
        return self.first >= 0

    def as_json(self) -> dict[str, Any]:
        return {"name": self.name, "first": self.first}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Cause:
        return cls(str(values["name"]), int(values["first"]))


Begun = tuple[Sequence[Cause], Mapping[str, float]]
"""Causes, and coefficients at which effects that are tried at some size are begun."""
Key = frozenset[str]
"""A set of causes by name: when a step began is no part of its identity."""


def key(causes: Sequence[Cause]) -> Key:
    return frozenset(c.name for c in causes)


def causes_of(options: Sequence[Option]) -> tuple[Cause, ...]:
    """The causes that an explanation's options stand for."""
    found = [Cause(own.label) for o in options for e in o.hypothesis.effects for own in each(e)]
    for o in options:
        for d in o.hypothesis.discrepancies:
            found.append(Cause(d.target, int(np.argmax(o.hypothesis.curves[d.curve] > 0))))
    return tuple(found)


def effect_of(engine: Engine, cause: Cause) -> Effect:
    """The effect that a cause names."""
    term, _, site = cause.name.partition("@")
    return effect(engine, term, site)


def hypothesis(
    engine: Engine, causes: Sequence[Cause], records: int, values: Mapping[str, float] | None = None
) -> Hypothesis:
    """The causes as something to fit to evidence of so many records of one engine. `values`: coefficients by parameter
    at which effects begin whose derivative at absence tells nothing."""
    effects = tuple(_begun(effect_of(engine, c), values or {}) for c in causes if not c.is_step)
    steps = [c for c in causes if c.is_step]
    curves = {f"since record {c.first}": (np.arange(records) >= c.first).astype(float) for c in steps}
    found = tuple(Discrepancy(c.name, f"since record {c.first}", engine.parameters[c.name].prior_sigma) for c in steps)
    return Hypothesis(effects, found, curves)


def _begun(effect: Effect, values: Mapping[str, float]) -> Effect:
    if not effect.tried:
        return effect
    known = {c.name: effect.parameter_name(c.name) for c in effect.term.amplitudes()}
    return replace(effect, values={**effect.values, **{c: values[n] for c, n in known.items() if n in values}})


def components(engine: Engine, cause: Cause) -> frozenset[str]:
    """Where an engineer would look: the effect's component, and those whose parameters it acts through (a variation
    of cooling flow is of the turbine and of the cooling bleed)."""
    if cause.is_step:
        return frozenset({engine.parameters[cause.name].component})
    site = effect_of(engine, cause).site
    leaves = {engine.parameters[leaf].component for leaf in site.acts_on if leaf in engine.parameters}
    return frozenset({site.component} | leaves)
