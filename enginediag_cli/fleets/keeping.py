"""What a store holds of a fleet, what it holds that nobody asks for any more, and how two stores become one."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.fleet import Fleet
from enginediag_cli.fleets.models import making_of, nominal_path
from enginediag_cli.fleets.recordings import Recorded
from enginediag_cli.fleets.store import NOMINALS, RECORDINGS, Store
from enginediag_cli.recordings.provenance import sha256_of
from enginediag_cli.recordings.write import binary_output

ABANDONED_S = 3600.0
"""Age at which a half-written file is one of a run that was killed: no recording is in work for an hour."""


@dataclass(frozen=True)
class Standing:
    """How far a store holds a fleet. known: of each recording the key under which it is kept, "" where it is not;
    models: of each build whether its model is there; others: keys of recordings that are not this fleet's, or condensed
    otherwise; bytes: of the whole store."""

    known: tuple[tuple[Recorded, str], ...]
    models: dict[str, bool]
    others: tuple[str, ...]
    bytes: int


def standing(fleet: Fleet, recordings: Sequence[Recorded], store: Store) -> Standing:
    """Raises DataError when there is no store."""
    _need(store)
    makings = {}
    for build in fleet.builds:
        path = nominal_path(fleet, build, store)
        makings[build.name] = making_of(fleet, build, path) if path.exists() else None
    there = set(store.keys())
    known = []
    for recorded in recordings:
        making = makings[recorded.build]
        key = making.key(sha256_of(recorded.path)) if making is not None and not recorded.trouble else ""
        known.append((recorded, key if key in there else ""))
    others = sorted(there - {key for _, key in known})
    return Standing(tuple(known), {n: m is not None for n, m in makings.items()}, tuple(others), _size(store.folder))


def prune(fleet: Fleet, recordings: Sequence[Recorded], store: Store, *, only_tell: bool = False) -> list[Path]:
    """Remove what is not this fleet's, and what killed runs have left half-written; the files, removed or, with
    `only_tell`, to be removed. Raises DataError when there is no store, OSError."""
    found = standing(fleet, recordings, store)
    files = [store.path(key) for key in found.others]
    mine = {nominal_path(fleet, build, store) for build in fleet.builds}
    files += [path for path in sorted((store.folder / NOMINALS).glob("*.yaml")) if path not in mine]
    files += [path for path in store.partial() if time.time() - path.stat().st_mtime > ABANDONED_S]
    for path in files if not only_tell else ():
        path.unlink(missing_ok=True)
    return files


@dataclass(frozen=True)
class Merged:
    """copied: recordings that the store did not have; there: that it had; damaged: files left out; models: nominal
    files copied; other_models: keys of models that differ in the two stores."""

    copied: int
    there: int
    damaged: tuple[str, ...]
    models: int
    other_models: tuple[str, ...]


def merge(into: Store, other: Store) -> Merged:
    """Put into a store what another one has and it has not. Raises DataError when there is no other store, OSError."""
    _need(other)
    copied, there, damaged = 0, 0, []
    for key in other.keys():
        if into.path(key).exists():
            there += 1
        elif other.find(key) is None:
            damaged.append(key)
        else:
            _copy(other.path(key), into.path(key))
            copied += 1
    models, differ = 0, []
    for path in sorted((other.folder / NOMINALS).glob("*.yaml")):
        mine = into.nominal(path.stem)
        if not mine.exists():
            _copy(path, mine)
            models += 1
        elif sha256_of(mine) != sha256_of(path):
            differ.append(path.stem)
    return Merged(copied, there, tuple(damaged), models, tuple(differ))


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with open(source, "rb") as given, binary_output(target) as stream:
        shutil.copyfileobj(given, stream)


def _need(store: Store) -> None:
    if not any((store.folder / name).is_dir() for name in (RECORDINGS, NOMINALS)):
        raise DataError(f"{store.folder}: there is no store of a fleet; `enginediag fleet … --store` makes one")


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in _files(folder))


def _files(folder: Path) -> Iterator[Path]:
    for where, _, names in os.walk(folder):
        yield from (Path(where) / name for name in names)
