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
    """An engine with the power setting of its nominal state. `instance`: the engine of the recordings that the nominal
    state was identified on, "" where they name none or all were used."""

    engine: Engine
    nominal: Nominal
    path: str

    @property
    def instance(self) -> str:
        return self.nominal.provenance.get("engine instance", "")


def open_baseline(nominal_path: str | Path, *, accept_changed_engine: bool = False) -> Baseline:
    """A nominal file and the engine file that it names. Raises ConfigError, and DataError when the engine file is not
    the one that was identified, unless that is accepted."""
    from enginediag_cli.identification.nominal_file import engine_file, read_nominal

    nominal = read_nominal(nominal_path)
    path = engine_file(nominal, nominal_path)
    return Baseline(open_engine(path, nominal, accept_changed_engine=accept_changed_engine), nominal, str(nominal_path))


def open_engine(path: str | Path, nominal: Nominal | None = None, *, accept_changed_engine: bool = False) -> Engine:
    """The engine of a file, with the power setting that the nominal state, if any, was identified with.

    Raises ConfigError, and DataError as `open_baseline` does.
    """
    from enginediag_cli.identification.nominal_file import refuse_changed_engine
    from enginediag_cli.physics.engine_file import load_engine

    if nominal is None:
        return load_engine(path)
    refuse_changed_engine(nominal, path, accept=accept_changed_engine)
    engine = load_engine(path)
    other = [c for c in nominal.inputs if c not in engine.inputs]
    return load_engine(path, power_setting=other[0]) if len(other) == 1 else engine
