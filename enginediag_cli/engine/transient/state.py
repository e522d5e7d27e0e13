"""What a state is to the network: a quantity x with dx/dt = f(x, …) that stands while the rest of the engine is in
balance.

In a *stage* of the integration x is implicit, x = base + step · f: the network finds it, and reads the leaves
`<state>.base` and `step_s`. Where the state is *given* (at the records that are told) the leaf `<state>` holds it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.hooks import Hooks

if TYPE_CHECKING:
    from enginediag_cli.engine.moving.memory import Memory
    from enginediag_cli.engine.network import Network

STEP = "step_s"
"""Leaf with γ h of a stage, s."""
ELAPSED = "elapsed_s"
"""Leaf with the time since the beginning of the step, s."""


class State(ABC):
    """One state, called `name`, in `unit`."""

    name: str
    unit: str
    words: str
    coarser = 1.0
    """Times as far from right as a rotor's speed it may be."""
    follows = False
    """Whether it goes with the rest of the engine at once, as far as it can from where it stood at the beginning of the
    step: that is then its base, and what is given of it."""

    @property
    def base(self) -> str:
        """The leaf from which a stage begins."""
        return f"{self.name}.base"

    @property
    def given(self) -> str:
        """The leaf with what is known of it at a record."""
        return self.base if self.follows else self.name

    @abstractmethod
    def install(self, hooks: Hooks, network: Network) -> None:
        """Where it takes hold of the network, in stages and where it is given."""

    @abstractmethod
    def value(self, e: Evaluation) -> Value:
        """x (N,) at the solution of a stage, or of a steady engine."""

    @property
    def known(self) -> str:
        """Model column, where the state is given, with how fast it changes; of what follows, with what it is."""
        return f"{self.name}.known"

    per_given = 1.0
    """By how much the leaf changes that it sets, where it is given."""

    @abstractmethod
    def slope(self, e: Evaluation) -> Value:
        """dx/dt (N,) at a solution where it is given."""

    def stands_for(self, memory: Memory) -> bool:
        """Whether it is what a term remembers."""
        return False

    def power(self, x: Array, slope: Array) -> Array:
        """Energy (N,) [W] that the state takes up while it changes by `slope` (N,) per second; a signal takes none."""
        return np.zeros_like(x)

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        """By how much x (k, N), at rising `time` (k, N), moved further than it can: the error (N,) of what follows.
        `leaves`: inputs and parameters of the step."""
        return np.zeros(x.shape[1])

    def moved(self, x: Array, names: Sequence[str], before: Array, after: Array) -> Array:
        """x (N,) behind a last small move of the unknowns `names`, from `before` (nx, N) to `after`."""
        return x
