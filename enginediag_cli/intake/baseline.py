"""The engine and the nominal state that recordings are held against, out of their files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.identification.nominal import Nominal


@dataclass(frozen=True)
class Baseline:
    """An engine with the power setting of its nominal state. `path`: the nominal file; `changed_engine`: SHA-256 of an
    engine file that is not the one identified, where that was accepted, else ""."""

    engine: Engine
    nominal: Nominal
    path: str
    changed_engine: str = ""

    def other_instance(self, wanted: str) -> tuple[str, str] | None:
        """(engine identified, engine of the recordings) where both are named and differ."""
        from enginediag_cli.identification.nominal_checks import other_instance

        return other_instance(self.nominal, wanted)


def open_baseline(
    nominal_path: str | Path, engine_path: str | Path | None = None, *, accept_changed_engine: bool = False
) -> Baseline:
    """A nominal file, and the engine file that it names unless another is given. Raises ConfigError for files that do
    not fit each other, among them an engine file that is not the one identified, unless that is accepted."""
    from enginediag_cli.identification.nominal_checks import check_nominal_fits
    from enginediag_cli.identification.nominal_file import engine_file, read_nominal, refuse_changed_engine
    from enginediag_cli.physics.engine_file import load_engine

    nominal = read_nominal(nominal_path)
    path = engine_path or engine_file(nominal, nominal_path)
    changed = refuse_changed_engine(nominal, path, accept=accept_changed_engine, nominal_path=nominal_path)
    engine = load_engine(path)
    other = [c for c in nominal.inputs if c not in engine.inputs]
    if len(other) == 1:
        engine = load_engine(path, power_setting=other[0])
    check_nominal_fits(nominal, engine, nominal_path)
    return Baseline(engine, nominal, str(nominal_path), changed)
