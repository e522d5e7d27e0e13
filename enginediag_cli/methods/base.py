"""The contract of a method: choices made, trained once on an engine, then judging any number of windows together.

    METHODS["pca_raw"].with_options({"explained": 0.8}).train(monitor, healthy).diagnose(windows, 0.01) -> Verdicts

A method turns windows of records into detection tests and, where it can, names what changed: parameters (scores of the
local approach, structured parity equations, observers, estimation) or only sensors (PCA). A new one is one file with a
class that says

    HELP     what it does, in a few words
    OPTIONS  its choices, as fields of a YAML section; each is a field of the dataclass with the same default
    learns   whether it needs windows believed healthy to train
    name     under which it is asked for
    tests    names of its tests
    train    ties it to an engine; the fitted method's `diagnose` judges windows

one line in `registry.py`, and one row of the contract test. What holds for every method (that test asks it of each):
nothing is isolated where there is no alarm; a window without readings has no verdict; filling a window up with empty
records changes nothing; the verdict on one window does not depend on the others.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, TypeVar

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.methods.verdicts import Verdicts
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor

Chosen = TypeVar("Chosen", bound="Method")


class FittedMethod(ABC):
    """A method that knows its engine and, if it learns, the healthy data."""

    @abstractmethod
    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> Verdicts:
        """Judge all windows at this false-alarm probability per window.

        Windows that are `Evidence` of the same monitor bring their scores with them, which methods share.
        """


class Method(ABC):
    """A method with its choices made: a frozen dataclass whose fields are its choices."""

    HELP: ClassVar[str]
    OPTIONS: ClassVar[tuple[Field, ...]] = ()
    learns: ClassVar[bool] = False

    @property
    @abstractmethod
    def name(self) -> str:
        """Under which it is asked for."""

    @property
    @abstractmethod
    def tests(self) -> tuple[str, ...]:
        """Names of the tests of its verdicts, in their order."""

    @abstractmethod
    def train(self, monitor: Monitor, healthy: Windows | None = None) -> FittedMethod:
        """Tie the method to an engine; `healthy` only matters when the method learns.

        Raises ValueError for choices that cannot be, DataError for healthy windows that are too few.
        """

    def section(self) -> Section:
        """Its choices as a YAML section."""
        return Section(self.name, self.HELP, self.OPTIONS)

    def with_options(self: Chosen, values: Mapping[str, Any]) -> Chosen:
        """The method with those of its choices that `values` holds; other keys are not asked for."""
        chosen = {f.name: values[f.name] for f in self.OPTIONS if f.name in values}
        chosen = {name: tuple(value) if isinstance(value, list) else value for name, value in chosen.items()}
        return replace(self, **chosen)  # type: ignore[type-var]
