"""What an effect remembers of the past of a record, and where it enters the network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.moving.filters.base import Filter


@dataclass(frozen=True)
class Memory:
    """A filter of one signal. What it makes is the leaf `name`: 0 in equilibrium, so that a steady record, or an
    effect that is absent, changes no digit.

    `coefficients`: parameters that the filter takes, in its order; `absent`: the parameters that are sought, with the
    values at which nothing is remembered. `column`: input column whose value it changes before the network is told,
    which then is its signal; else the signal is what an evaluation leaves in `Evaluation.signals`. `recorded`: column
    from which `measured` makes the signal where the recording has it. `sensor`: column of the reading that shows the
    signal, if it is one. `shown_by`: column of the
    recordings that shows what the filter makes, if there is one: it tells where it begins. `tried`: names of
    directions along which the effect is tried at one size each, with the values of `coefficients`. `turns`: the shaft
    of which the first coefficient is the inertia, where the effect is that; simulations have its speed as a state.
    `multiplied`: the size of the effect is none of the coefficients but multiplies what is remembered, which is there
    before the effect is.
    """

    name: str
    filter: Filter
    coefficients: tuple[str, ...]
    absent: Mapping[str, float]
    column: str = ""
    recorded: str = ""
    sensor: str = ""
    shown_by: str = ""
    measured: Callable[[Array], Array] = np.asarray
    tried: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    turns: str = ""
    multiplied: bool = False
