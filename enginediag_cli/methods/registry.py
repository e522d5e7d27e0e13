"""All kinds of method by the name under which a study file asks for them; a new one is one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from enginediag_cli.config.fields import Section
from enginediag_cli.methods import estimation, family, incremental, minmax, posterior, sensitivity
from enginediag_cli.methods.answers import Answers
from enginediag_cli.methods.evidence import Evidence

_MODULES = {
    "posterior": posterior,
    "incremental": incremental,
    "sensitivity": sensitivity,
    "minmax": minmax,
    "estimation": estimation,
    "family": family,
}

SECTIONS: dict[str, Section] = {name: module.SECTION for name, module in _MODULES.items()}
METHODS: dict[str, Callable[[Evidence, Mapping[str, Any]], Answers]] = {
    name: module.answer for name, module in _MODULES.items()
}
