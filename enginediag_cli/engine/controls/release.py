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

    A combined machine's load control opens the vanes as soon as the firing temperature is at its limit, whatever the
    exhaust temperature is: no surplus of the held quantity says so.
    """

    column: str
    side: str
    value: float
    rest: float

    def released(self, e: Evaluation, network: Network) -> Array:
        """Records (N,) in which the control does not act."""
        # of an input what is recorded, whatever effects make of it: that is what the control itself goes by
        x = e.leaves[network.leaf_of(self.column)] if network.has_input(self.column) else network.read(e, self.column)
        plain = np.broadcast_to(np.asarray(value(x)), (e.size,))
        return plain > self.value if self.side == "at_most" else plain < self.value

    def of(self, surplus: Value, e: Evaluation, network: Network) -> Value:
        """The surplus that drives the actuator (N,): to its rest where the control is released."""
        return select(self.released(e, network), np.full(e.size, self.rest), surplus)
