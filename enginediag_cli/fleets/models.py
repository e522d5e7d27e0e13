"""What each build of a fleet is held against: its own nominal file, that of the store, or one identified now."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from enginediag_cli.fleets.common_model import CommonModel, identify_common, model_key
from enginediag_cli.fleets.fleet import Build, Fleet
from enginediag_cli.fleets.making import Making
from enginediag_cli.fleets.recordings import Recorded
from enginediag_cli.fleets.store import Store
from enginediag_cli.recordings.provenance import sha256_of


@dataclass(frozen=True)
class Model:
    """What the recordings of a build are held against. identified: None where the nominal file was given, or found in
    the store."""

    build: Build
    making: Making
    generic: bool
    identified: CommonModel | None = None


def nominal_path(fleet: Fleet, build: Build, store: Store) -> Path:
    """The nominal file of a build: its own, or where the store has it once it is identified."""
    return build.nominal or store.nominal(model_key(fleet, build))


def model_of(fleet: Fleet, build: Build, recordings: Sequence[Recorded], store: Store) -> Model:
    """The nominal state that a build is held against: its own, that of the store, or one identified now. Raises
    ConfigError, DataError, NoVerdictError."""
    from enginediag_cli.intake.baseline import open_baseline

    path, identified = nominal_path(fleet, build, store), None
    if not path.exists():
        mine = [r for r in recordings if r.build == build.name and not r.trouble]
        identified = identify_common(fleet, build, mine, path)
    generic = open_baseline(path).nominal.error_model is not None
    return Model(build, making_of(fleet, build, path), generic, identified)


def making_of(fleet: Fleet, build: Build, nominal: Path) -> Making:
    """How recordings of a build are condensed."""
    fingerprint = sha256_of(nominal)
    recorder = os.path.abspath(build.recorder) if build.recorder else ""
    digest = sha256_of(recorder) if recorder else ""
    linearise = str(fleet.judge["linearise"])
    accepted = fleet.accept_mismatch
    return Making(os.path.abspath(nominal), fingerprint, recorder, digest, fleet.plan, linearise, accepted)
