"""The library: one function and one result class for each verb of the command line.

`from enginediag_cli import …` gives the names in ``__all__`` of the modules beside this one. The functions take paths,
results of other functions, dicts of arrays or DataFrames; `inputs` reads these. Every result has the methods of
`Result` in `results`: rows, arrays, a summary, a picture, and files. Open these two first; the other modules are one
per verb or two. Public names have numpydoc sections, which ruff checks.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from enginediag_cli.api.detection import *  # noqa: F403
    from enginediag_cli.api.discrepancy import *  # noqa: F403
    from enginediag_cli.api.files import *  # noqa: F403
    from enginediag_cli.api.fleets import *  # noqa: F403
    from enginediag_cli.api.identification import *  # noqa: F403
    from enginediag_cli.api.inputs import *  # noqa: F403
    from enginediag_cli.api.isolation import *  # noqa: F403
    from enginediag_cli.api.refinement import *  # noqa: F403
    from enginediag_cli.api.results import *  # noqa: F403
    from enginediag_cli.api.simulation import *  # noqa: F403
    from enginediag_cli.api.trends import *  # noqa: F403

MODULES = (
    "inputs",
    "results",
    "simulation",
    "identification",
    "detection",
    "isolation",
    "trends",
    "fleets",
    "discrepancy",
    "refinement",
    "files",
)
"""In the order in which a name is looked for; a module is loaded when a name is first sought there."""


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return [public for module in MODULES for public in _load(module).__all__]
    if not name.startswith("_"):
        for module in MODULES:
            if name in (loaded := _load(module)).__all__:
                return getattr(loaded, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _load(module: str) -> Any:
    return import_module(f"{__name__}.{module}")
