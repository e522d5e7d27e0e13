"""The recordings of a fleet: which files they are, in which order, and whose, where file names say it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from enginediag_cli.config.patterns import matching, search
from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.fleet.fleet import Build, Fleet

DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True)
class Recorded:
    """One recording. path: absolute; name: how it is called, by which recordings are in order; build: whose it is;
    serial: of its engine where its name says it, else ""."""

    path: str
    name: str
    build: str
    serial: str = ""


def natural(name: str) -> tuple[tuple[str | int, ...], str]:
    """A key by which flight_9 comes before flight_10."""
    parts = DIGITS.split(name)
    return tuple(int(part) if k % 2 else part for k, part in enumerate(parts)), name


def recordings_of(fleet: Fleet, given: Sequence[str] = ()) -> tuple[Recorded, ...]:
    """All recordings of a fleet by name; those `given` in place of its patterns. Raises DataError for one of two
    builds, or without a serial number; NoVerdictError where there is none."""
    if given and len(fleet.builds) > 1:
        raise DataError("the fleet has several builds, so its file has to say which recordings are whose")
    found: dict[str, Recorded] = {}
    for build in fleet.builds:
        for path in given or _matching(fleet, build):
            real = os.path.abspath(path)
            if real in found:
                both = f"of build {found[real].build!r} and of {build.name!r}"
                raise DataError(
                    f"{path}: matches patterns {both}" if found[real].build != build.name else f"{path}: given twice"
                )
            found[real] = Recorded(real, "", build.name, _serial(fleet, path))
    if not found:
        patterns = ", ".join(p for build in fleet.builds for p in build.recordings)
        told = f"no file matches {patterns}" if patterns else "the file names no recordings"
        raise NoVerdictError(f"{fleet.path}: {told}; name recordings behind it on the command line")
    names = _names(list(found))
    every = [Recorded(r.path, names[r.path], r.build, r.serial) for r in found.values()]
    return tuple(sorted(every, key=lambda r: natural(r.name)))


def _matching(fleet: Fleet, build: Build) -> list[str]:
    folder = fleet.path.parent
    paths: dict[str, None] = {}
    for pattern in build.recordings:
        hits = matching(folder, pattern)
        paths.update(dict.fromkeys(sorted(os.path.normpath(p) for p in hits if os.path.isfile(p))))
    return list(paths)


def _names(paths: Sequence[str]) -> dict[str, str]:
    """Path → its part below the folder that all have in common, so that nothing depends on where that lies."""
    common = os.path.commonpath([os.path.dirname(p) for p in paths])
    return {p: Path(os.path.relpath(p, common)).as_posix() for p in paths}


def _serial(fleet: Fleet, path: str) -> str:
    if fleet.pattern is None:
        return ""
    found = search(fleet.pattern, Path(path).as_posix(), str(fleet.path))
    if found is None or not found[1]:
        raise DataError(
            f"{path}: its name has no serial number by the pattern {fleet.pattern.pattern!r} of {fleet.path}"
        )
    return found[1]
