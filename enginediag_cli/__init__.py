"""enginediag: diagnosis of gas turbines from recorded flights with a nonlinear physical model.

The verbs of the command line are functions of this package; each returns a result with ``summary()``, ``to_dict()``,
``to_frame()``, ``plot()`` and ``save()``.

>>> import enginediag_cli
>>> engine = enginediag_cli.load_engine("turbojet.yaml")
>>> engine.inputs
('altitude_m', 'mach', 'dT_isa_K', 'Wf_kg_s')
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.4.0"

if TYPE_CHECKING:
    from enginediag_cli.api import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Load the public functions when the first of them is used: a command starts without them."""
    if name.startswith("_"):
        raise AttributeError(name)
    from importlib import import_module

    api = import_module("enginediag_cli.api")
    if name not in api.__all__:
        raise AttributeError(f"module 'enginediag_cli' has no attribute {name!r}")
    return getattr(api, name)


def __dir__() -> list[str]:
    from importlib import import_module

    return ["__version__", *import_module("enginediag_cli.api").__all__]
