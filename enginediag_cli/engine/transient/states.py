"""Which states an engine file gives: rotors, actuators that need time, and what terms with memory remember."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.engine.controls.control import Pace
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.moving.memory import Memory
from enginediag_cli.engine.transient.actuator import Actuator
from enginediag_cli.engine.transient.remembered import Remembered
from enginediag_cli.engine.transient.rotor import Rotor
from enginediag_cli.engine.transient.state import State


def remembered(engine: Engine, varied: Sequence[str] = ()) -> tuple[Memory, ...]:
    """Memories of the terms that an engine carries; `varied`: parameters that will not be at their nominal values."""
    nominal = engine.nominal
    return tuple(
        m for m in engine.network.memories if any(n in varied or nominal[n] != absent for n, absent in m.absent.items())
    )


def states_of(engine: Engine, varied: Sequence[str] = ()) -> tuple[State, ...]:
    """Rotors whose speed follows from a balance of power, actuators that do not follow at once, and filters of terms.
    What the reading of one sensor remembers is no state: it is filtered along the run. Raises ValueError for an inertia
    that is given twice, and for a term that needs a state and has none."""
    network, found = engine.network, list[State]()
    memories = remembered(engine, varied)
    inertias = {n: s["inertia_kg_m2"] for n, s in network.shafts.items() if s["inertia_kg_m2"] > 0.0}
    for m in memories:
        if m.turns in inertias:
            raise ValueError(
                f"{engine.name}: the inertia of shaft {m.turns} is given twice, as inertia_kg_m2 of the shaft and as "
                f"{m.coefficients[0]} of its physics; leave one of them out"
            )
        if m.turns and set(m.coefficients) & set(varied):
            raise ValueError(f"{engine.name}: {m.coefficients[0]} cannot change while the engine is flown along time")
    inertias |= {m.turns: engine.nominal[m.coefficients[0]] for m in memories if m.turns}
    for name, shaft in network.shafts.items():
        if name in inertias and shaft["speed"] == "balance":
            found.append(Rotor(name, inertias[name]))
    found += [Actuator(c, network) for c in network.controls if c.pace != Pace()]
    for m in memories:
        if m.sensor or any(s.stands_for(m) for s in found):
            continue
        if not m.filter.STATES and not m.column and not m.recorded:
            raise ValueError(
                f"{engine.name}: what {m.name} remembers acts back on the engine, and its filter has no states to be "
                "integrated; take every record as steady with --steady, or leave the term out"
            )
        found += [Remembered(m, k, network) for k in range(m.filter.STATES)]
    return tuple(found)
