"""The engine and the nominal state that recordings are held against, out of their files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine
    from enginediag_cli.identification.nominal import Nominal


@dataclass(frozen=True)
class Baseline:
    """An engine with the power setting of its nominal state. `path`: the nominal file; `changed_engine`: SHA-256 of an
    engine file that is not the one identified, where that was accepted, else ""; `left_aside`: an engine file that is
    not the one identified and was not used, else ""."""

    engine: Engine
    nominal: Nominal
    path: str
    changed_engine: str = ""
    left_aside: str = ""

    def other_instance(self, wanted: str) -> tuple[str, str] | None:
        """(engine identified, engine of the recordings) where both are named and differ."""
        from enginediag_cli.identification.nominal_checks import other_instance

        return other_instance(self.nominal, wanted)


def open_baseline(
    nominal_path: str | Path, engine_path: str | Path | None = None, *, accept_changed_engine: bool = False
) -> Baseline:
    """A nominal file and its engine: the one that travels in it, whatever has become of the engine file.

    An engine file that is given, and the one that an older nominal file names, is used itself, and must be the one
    identified unless a changed one is accepted; accepted, the file named is used, too. Raises ConfigError for files
    that do not fit each other.
    """
    from enginediag_cli.identification.nominal_checks import changed_beside, check_nominal_fits, described_engine
    from enginediag_cli.identification.nominal_file import engine_file, read_nominal, refuse_changed_engine
    from enginediag_cli.physics.engine_file import load_engine

    nominal = read_nominal(nominal_path)
    described = None if engine_path or accept_changed_engine else nominal.description
    changed = left_aside = ""
    if described is None:
        path = engine_path or engine_file(nominal, nominal_path)
        changed = refuse_changed_engine(nominal, path, accept=accept_changed_engine, nominal_path=nominal_path)
        build = partial(load_engine, path)
    else:
        left_aside = changed_beside(described, nominal_path)
        build = partial(described_engine, described, nominal_path)
    engine = build()
    other = [c for c in nominal.inputs if c not in engine.inputs]
    if len(other) == 1:
        engine = build(power_setting=other[0])
    check_nominal_fits(nominal, engine, nominal_path)
    return Baseline(engine, nominal, str(nominal_path), changed, left_aside)
