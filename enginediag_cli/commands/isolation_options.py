"""What `isolate` can be asked beyond the set of changes: sensors, signs, names, large faults, advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from enginediag_cli.commands.options import FiniteRange
from enginediag_cli.presentation.messages import Messages

if TYPE_CHECKING:
    from enginediag_cli.isolation.diagnosis import DiagnosisOptions
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.parameters import Parameter


@dataclass(frozen=True)
class Further:
    """Choices of `further_options`; sensors: None where nothing was said; extra: model column → noise of a further
    sensor, in the column's unit."""

    sensors: bool | None = None
    one_sided: bool = False
    catalogue: tuple[str, ...] = ()
    nonlinear: str = "auto"
    advise: bool = False
    extra: dict[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> dict[str, str]:
        """Choices that the result depends on, for the provenance header."""
        told = {"one_sided": self.one_sided, "nonlinear": self.nonlinear != "auto"}
        shown = {name: "yes" for name, chosen in told.items() if chosen}
        if self.sensors is not None:
            shown["sensors"] = "yes" if self.sensors else "no"
        return {**shown, **({"nonlinear": self.nonlinear} if "nonlinear" in shown else {})}

    def files(self) -> list[str]:
        """Files of the catalogue; of a folder, its YAML files."""
        from pathlib import Path

        found: list[str] = []
        for name in self.catalogue:
            path = Path(name)
            here = sorted(map(str, path.glob("*.yaml"))) if path.is_dir() else [name]
            if not here:
                raise click.UsageError(f"--catalogue: no YAML file in {name}")
            found += here
        return found

    def keeps(self, method: str, linearise: str) -> bool:
        """Whether the records may be needed: not for the full model where the linear statistic at nominal is
        asked for."""
        return self.advise or self._full_model(method, linearise)

    def _full_model(self, method: str, linearise: str) -> bool:
        wanted = self.nonlinear == "always" or (self.nonlinear == "auto" and linearise == "estimate")
        return method == "posterior" and wanted

    def diagnosis_options(self, method: str, linearise: str, isolation: IsolationOptions) -> DiagnosisOptions:
        """Everything that the diagnosis of a window needs; reads the catalogue."""
        from enginediag_cli.faults.component_faults import FaultSet
        from enginediag_cli.faults.fault_file import load_faults
        from enginediag_cli.isolation.diagnosis import DiagnosisOptions

        # a fault that several files hold is described best by the one that holds the fewest others
        parts = sorted((load_faults(file) for file in self.files()), key=lambda part: len(part.names))
        components = tuple(fault for part in parts for fault in part.components)
        catalogue = FaultSet(components, tuple(fault for part in parts for fault in part.sensors))
        nonlinear = self.nonlinear if self._full_model(method, linearise) else "never"
        return DiagnosisOptions(method, isolation, self.one_sided, nonlinear, catalogue if parts else None)

    def check(self, method: str, by: str, nominal: str | None, reference: bool) -> None:
        """Raises click.UsageError for choices that do not go together."""
        if by == "component" and (self.one_sided or self.catalogue or self.advise or self.nonlinear == "always"):
            raise click.UsageError("--one-sided, --catalogue, --nonlinear and --advise go with --by parameter")
        if method != "posterior" and (self.one_sided or self.nonlinear == "always"):
            raise click.UsageError("--one-sided and --nonlinear always go with --method posterior")
        if nominal is None and self.sensors:
            raise click.UsageError("--sensors needs --nominal; to statistics they come by residual --sensors")
        if nominal is None and (self.advise or self.nonlinear == "always"):
            raise click.UsageError("--advise and --nonlinear always need --nominal")
        if reference and self.nonlinear == "always":
            raise click.UsageError("--nonlinear always does not go with --reference")
        if self.extra and not self.advise:
            raise click.UsageError("--extra-sensor goes with --advise")

    def sensors_watched(self, method: str, patterns: tuple[str, ...]) -> bool:
        """Whether every sensor in use, of an output or an input, may be wrong, too: unless --monitor says what may, or
        the method is one of the tests of the local approach, or --no-sensors was given."""
        return (method == "posterior" and not patterns) if self.sensors is None else self.sensors

    def warn_of_sensors(self, messages: Messages, parameters: Iterable[Parameter]) -> None:
        """Statistics that hold no error of a sensor put a wrong sensor down to the engine."""
        if self.sensors is None and not any(p.of_sensor for p in parameters):
            messages.warning(
                "these statistics hold no errors of sensors: a wrong sensor would be taken for a change of the engine; "
                "`residual --sensors` writes statistics that hold them"
            )


def further_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options of `Further`, as one argument `further`."""

    @wraps(function)
    def with_further(
        *args: Any,
        sensors: bool | None,
        one_sided: bool,
        catalogue: tuple[str, ...],
        nonlinear: str,
        advise: bool,
        extra_sensors: tuple[tuple[str, float], ...],
        **others: Any,
    ) -> Any:
        further = Further(sensors, one_sided, catalogue, nonlinear, advise, dict(extra_sensors))
        return function(*args, further=further, **others)

    options = [
        click.option(
            "--sensors/--no-sensors",
            default=None,
            help="Whether every sensor may be wrong, too, those that give the model its inputs included. They may when "
            "neither is given, with the posterior and without --monitor: a wrong sensor would else be taken for a "
            "change of the engine.",
        ),
        click.option(
            "--catalogue",
            metavar="FILE",
            type=click.Path(exists=True, readable=True),
            multiple=True,
            help="Faults to be named: a fault file, or a folder of them. May be given several times.",
        ),
        click.option(
            "--one-sided",
            is_flag=True,
            help="Changes have known signs: efficiencies fall, and other parameters go the way on which "
            "the catalogue agrees.",
        ),
        click.option(
            "--nonlinear",
            type=click.Choice(["auto", "always", "never"]),
            default="auto",
            show_default=True,
            help="Fit leading sets with the full model: when changes are too large for the quadratic "
            "likelihood, always, or never.",
        ),
        click.option(
            "--advise",
            is_flag=True,
            help="Say what to record next to tell the answer from its leading rival.",
        ),
        click.option(
            "--extra-sensor",
            "extra_sensors",
            metavar="COLUMN SIGMA",
            type=(str, FiniteRange(min=0, min_open=True)),
            multiple=True,
            help="A sensor to consider with --advise: any column of the model, and its noise.",
        ),
    ]
    for option in reversed(options):
        with_further = option(with_further)
    return with_further
