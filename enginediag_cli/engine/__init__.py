"""Φ: the engine model. `load_engine(path)` gives an `Engine`; nothing here knows of statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine, Prediction
    from enginediag_cli.engine.load import load_engine

__all__ = ["Engine", "Prediction", "load_engine"]


def __getattr__(name: str) -> Any:
    if name == "load_engine":
        from enginediag_cli.engine.load import load_engine

        return load_engine
    if name in ("Engine", "Prediction"):
        from enginediag_cli.engine import engine

        return getattr(engine, name)
    raise AttributeError(name)
