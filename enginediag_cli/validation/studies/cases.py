"""Fault cases: changes of parameters that are given, or drawn anew for every diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.config.hints import near
from enginediag_cli.errors import DataError
from enginediag_cli.isolation.prior import Instruments, SetPrior
from enginediag_cli.parameters import meanings
from enginediag_cli.residuals.monitor import Monitor

SIGNS = {"both": (-1.0, 1.0), "fall": (-1.0,), "rise": (1.0,)}
"""Directions to draw from."""

DRAW = Section(
    "draw",
    "faults at random",
    (
        Field(
            "faults",
            "range",
            "least and largest number of changed parameters; from the prior of the posterior method where absent",
            None,
            minimum=0,
        ),
        Field(
            "size",
            "range",
            "least and largest change: relative where nominal is not 0, else in the parameter's unit; "
            "from the prior of the posterior method where absent",
            None,
            minimum=0.0,
        ),
        Field(
            "sigmas",
            "range",
            "least and largest change in the parameter's prior standard deviations, instead of size",
            None,
            minimum=0.0,
        ),
        Field("sign", "choice", "direction of changes whose size is given", "both", choices=tuple(SIGNS)),
        Field(
            "among", "texts", "parameters that may change, names or patterns; all that are monitored where absent", ()
        ),
    ),
)

CASE = Section(
    "case",
    "what is wrong with the engine; nothing where neither changes nor draw are given",
    (
        Field("description", "text", "in words", ""),
        Field("repetitions", "integer", "diagnoses of this case", minimum=1),
        Field(
            "changes",
            "number_map",
            "change of each parameter, relative where nominal is not 0, else in the parameter's unit",
            {},
        ),
        Field("draw", "section", "faults drawn anew for every diagnosis, instead of changes", None, section=DRAW),
    ),
)


@dataclass(frozen=True)
class FaultCase:
    """A case over p monitored parameters: `changes` (p,) in their units, or `draw` among the candidates (p,) bool."""

    name: str
    repetitions: int
    changes: np.ndarray
    draw: Mapping[str, Any] | None
    candidates: np.ndarray

    def changes_of(self, monitor: Monitor, count: int, rng: np.random.Generator) -> np.ndarray:
        """Changes (count, p), in parameter units, zero where a parameter has not changed."""
        if self.draw is None:
            return np.tile(self.changes, (count, 1))
        among = np.flatnonzero(self.candidates)
        prior, sigma = SetPrior(), monitor.prior_sigma[among]
        monitored = list(meanings(monitor.meaning, [monitor.names[i] for i in among]).values())
        wear = np.array([p.wear for p in monitored])
        changed, size = prior.draw(rng, count, len(among), Instruments.from_parameters(monitored), wear)
        if self.draw["faults"] is not None:
            low, high = self.draw["faults"]
            number = rng.integers(int(low), int(high) + 1, size=count)
            rank = np.argsort(np.argsort(rng.random(changed.shape), axis=1), axis=1)
            changed = rank < number[:, None]
            size = rng.choice(np.asarray(prior.slabs), size=(count, 1)) * rng.standard_normal(changed.shape)
            size *= prior.widths(monitored)
        unit = sigma
        if self.draw["size"] is not None or self.draw["sigmas"] is not None:
            given = "size" if self.draw["size"] is not None else "sigmas"
            if given == "size":
                nominal = np.abs(monitor.theta0[among])
                unit = np.where(nominal > 0, nominal, 1.0)
            low, high = self.draw[given]
            sign = rng.choice(SIGNS[self.draw["sign"]], size=changed.shape)
            size = sign * rng.uniform(low, high, size=changed.shape)
        changes = np.zeros((count, len(monitor.names)))
        changes[:, among] = np.where(changed, size * unit, 0.0)
        return changes


def build_case(values: Mapping[str, Any], monitor: Monitor) -> FaultCase:
    """Case from the values of its section. DataError for parameters that the study does not monitor."""
    unknown = [name for name in values["changes"] if name not in monitor.names]
    if unknown:
        raise DataError(f"the study does not monitor {unknown[0]!r} ({near(unknown[0], monitor.names)})")
    draw = values["draw"]
    if draw is not None and values["changes"]:
        raise DataError("a case has changes or draws them, not both")
    candidates = np.ones(len(monitor.names), bool)
    if draw is not None:
        if draw["size"] is not None and draw["sigmas"] is not None:
            raise DataError("sizes are given by size or by sigmas, not both")
        patterns = draw["among"] or ["*"]
        idle = [q for q in patterns if not any(fnmatchcase(name, q) for name in monitor.names)]
        if idle:
            raise DataError(f"the study monitors nothing that matches {idle[0]!r} ({near(idle[0], monitor.names)})")
        candidates = np.array([any(fnmatchcase(name, q) for q in patterns) for name in monitor.names])
        if draw["faults"] is not None and draw["faults"][1] > candidates.sum():
            raise DataError(f"more faults than the {candidates.sum()} parameters that may change")
    scale = np.where(monitor.theta0 != 0, monitor.theta0, 1.0)
    relative = np.array([values["changes"].get(name, 0.0) for name in monitor.names])
    changed = monitor.theta0 + relative * scale
    beyond = [
        n
        for n, x, low, high in zip(monitor.names, changed, monitor.lower, monitor.upper, strict=True)
        if not low <= x <= high
    ]
    if beyond:
        raise DataError(f"the change of {beyond[0]} leaves its bounds")
    return FaultCase(values["name"], values["repetitions"], relative * scale, draw, candidates)


def healthy_case(monitor: Monitor, repetitions: int) -> FaultCase:
    """Nothing is wrong."""
    p = len(monitor.names)
    return FaultCase("healthy", repetitions, np.zeros(p), None, np.ones(p, bool))
