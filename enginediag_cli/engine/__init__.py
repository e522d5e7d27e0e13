"""The engine model: y = Φ(u, θ) and its derivatives, for whole batches of operating points.

It reads an engine file (and the map tables beside it) and gives an `Engine`. `Engine.predict` takes inputs u (flight
condition, power setting) and parameters θ (health, sensor errors, effects). It returns outputs y, ∂y/∂θ and the status
of every point. Nothing here knows of statistics. `physics.engine_file.load_engine(path)` loads an engine with the
library of effects.

A newcomer opens `engine.py` first (the public face), then `network.py` (unknowns and balances), `evaluation.py` (one
pass along the gas path) and `components/` (one class per component type). `load.py` and `declaration.py` are the engine
file. `solver.py`, `strategy.py` and `start.py` find solutions. `term.py`, `filters.py` and `recall.py` carry effects
and their memory; `wrapped.py` adds parameters to a model; `transient/` simulates engines that move.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine, Prediction

__all__ = ["Engine", "Prediction"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from enginediag_cli.engine import engine

        return getattr(engine, name)
    raise AttributeError(name)
