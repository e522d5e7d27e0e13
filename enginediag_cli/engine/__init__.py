"""Φ: the engine model. `physics.engine_file.load_engine(path)` gives an `Engine`; nothing here knows of statistics."""

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
