"""When a control acts, and where its actuator rests else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.engine.dual import Array, Value, select, value
from enginediag_cli.engine.evaluation import Evaluation

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


@dataclass(frozen=True)
class Release:
    """It acts while `column` is `side` of `value`; `rest`: +1 where it rests at the low stop, −1 at the high one.
    Within `margin` of the value nobody can tell. `wander`: an input column, 0 where it is not recorded, with what the
    actuator stands off its rest by while released, in its unit; `rest_sigma`: standard deviation of that.

    A combined machine's load control opens the vanes as soon as the firing temperature is at its limit, whatever the
    exhaust temperature is: no surplus of the held quantity says so.
    """

    column: str
    side: str
    value: float
    rest: float
    margin: float = 0.0
    wander: str = ""
    rest_sigma: float = 0.0

    def released(self, e: Evaluation, network: Network) -> Array:
        """Records (N,) in which the control does not act."""
        # of an input what is recorded, whatever effects make of it: that is what the control itself goes by
        x = e.leaves[self.column] if self.column in e.leaves else network.read(e, self.column)
        return self._beyond(x, e.size)

    def check(self, e: Evaluation, network: Network) -> None:
        """Raises KeyError for a column that the model does not have, ValueError for a wander without an input."""
        if self.column in network.inputs():
            return
        network.read(e, self.column)
        if self.wander:
            raise ValueError(
                f"rest_sigma needs an input in acts_while, one of {', '.join(network.inputs())}: when the actuator "
                f"wanders must be recorded, and {self.column} is what the model finds"
            )

    def _beyond(self, x: Value, size: int) -> Array:
        plain = np.broadcast_to(np.asarray(value(x)), (size,))
        return plain > self.value if self.side == "at_most" else plain < self.value

    def undecided(self, x: Array) -> Array:
        """Values of the column (N,) that do not tell whether it acts."""
        return np.asarray(np.abs(x - self.value) < self.margin)

    def off_rest(self, e: Evaluation) -> Value:
        """What the actuator stands off its rest by (N,): nothing where it acts."""
        return e[self.wander] * np.where(self._beyond(e.leaves[self.column], e.size), 1.0, 0.0)

    def of(self, surplus: Value, e: Evaluation, network: Network) -> Value:
        """The surplus that drives the actuator (N,): to its rest where the control is released."""
        return select(self.released(e, network), np.full(e.size, self.rest), surplus)
