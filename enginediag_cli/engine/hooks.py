"""Where an effect takes hold of the network: a leaf, a station or a reading.

Components know nothing of effects. What a component reads (`e["hpc.efficiency"]`) passes through the leaf hooks
of that name, the flow that it delivers through the hooks of its station, and what a sensor reads through those
of its column. A network without effects has no hooks and is untouched to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import ref

from enginediag_cli.engine.dual import Value

if TYPE_CHECKING:
    from enginediag_cli.engine.evaluation import Evaluation
    from enginediag_cli.engine.flow import Flow
    from enginediag_cli.engine.moving.memory import Memory

ValueHook = Callable[["Evaluation", Value], Value]
FlowHook = Callable[["Evaluation", "Flow"], "Flow"]


@dataclass(frozen=True)
class Solved:
    """An unknown `name` that stands for what `read` gives at the end of a pass, above 0: x / read = 1; `start`: of the
    iteration."""

    name: str
    read: Callable[[Evaluation], Value]
    start: float


@dataclass
class Hooks:
    """Functions by the name of the leaf, the station or the sensor column that they change, in order; what is
    remembered and what is solved for."""

    leaves: dict[str, list[ValueHook]] = field(default_factory=dict)
    stations: dict[str, list[FlowHook]] = field(default_factory=dict)
    readings: dict[str, list[ValueHook]] = field(default_factory=dict)
    memories: list[Memory] = field(default_factory=list)
    solved: list[Solved] = field(default_factory=list)

    def leaf(self, e: Evaluation, name: str, x: Value) -> Value:
        for hook in self.leaves.get(name, ()):
            x = hook(e, x)
        return x

    def reading(self, e: Evaluation, column: str, x: Value) -> Value:
        for hook in self.readings.get(column, ()):
            x = hook(e, x)
        return x


class Stations(dict[str, "Flow"]):
    """Flows by station; a flow passes through its station's hooks when it is delivered.

    The evaluation that owns it is held weakly: a ring of the two would keep all derivatives until the collector runs.
    """

    def __init__(self, e: Evaluation, hooks: Hooks):
        super().__init__()
        self._e, self._hooks = ref(e), hooks

    def __setitem__(self, station: str, flow: Flow) -> None:
        for hook in self._hooks.stations.get(station, ()):
            e = self._e()
            assert e is not None  # its owner is delivering the flow
            flow = hook(e, flow)
        super().__setitem__(station, flow)
