"""The recordings of a fleet: which files they are, in which order, and whose, where file names say it."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from enginediag_cli.config.patterns import matching, search
from enginediag_cli.config.reading import READING
from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.fleets.fleet import Build, Fleet

DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True)
class Recorded:
    """One recording. path: absolute; name: how it is called, by which recordings are in order; build: whose it is;
    serial: of its engine where its name says it, else ""; trouble: why it is not read, "" where nothing is wrong."""

    path: str
    name: str
    build: str
    serial: str = ""
    trouble: str = ""


def natural(name: str) -> tuple[tuple[str | int, ...], str]:
    """A key by which flight_9 comes before flight_10."""
    parts = DIGITS.split(name)
    return tuple(int(part) if k % 2 else part for k, part in enumerate(parts)), name


def recordings_of(fleet: Fleet, given: Sequence[str] = ()) -> tuple[Recorded, ...]:
    """All recordings of a fleet by name; those `given` in place of its patterns. What a pattern finds and cannot be
    read is among them, with its trouble. Raises DataError for one of two builds; NoVerdictError where there is none."""
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
            serial, trouble = _serial(fleet, path)
            trouble = _irregular(real) or ("" if given else _outside(fleet, real)) or trouble
            found[real] = Recorded(real, "", build.name, serial, trouble)
    if not found:
        patterns = ", ".join(p for build in fleet.builds for p in build.recordings)
        told = f"no file matches {patterns}" if patterns else "the file names no recordings"
        raise NoVerdictError(f"{fleet.path}: {told}; name recordings behind it on the command line")
    names = _names(list(found))
    every = [replace(r, name=names[r.path]) for r in found.values()]
    return tuple(sorted(every, key=lambda r: natural(r.name)))


def _matching(fleet: Fleet, build: Build) -> list[str]:
    folder = fleet.path.parent
    paths: dict[str, None] = {}
    for pattern in build.recordings:
        hits = matching(folder, pattern)
        # folders that * and ** pass through are none of the recordings; one that is called as they are is named
        everything = Path(pattern).name in ("*", "**")
        kept = (p for p in hits if not (everything and os.path.isdir(p)))
        paths.update(dict.fromkeys(sorted(os.path.normpath(p) for p in kept)))
    return list(paths)


def _irregular(path: str) -> str:
    """Why what lies there is no recording, without looking into it: a pipe would never end."""
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        dangling = os.path.islink(path)
        return (
            "a link to what is not there" if dangling else f"cannot be read: {(error.strerror or str(error)).lower()}"
        )
    if stat.S_ISREG(mode):
        return ""
    kind = "a folder" if stat.S_ISDIR(mode) else "a pipe" if stat.S_ISFIFO(mode) else "a device or a socket"
    return f"{kind}, not a file"


def _outside(fleet: Fleet, path: str) -> str:
    folder = fleet.path.parent.resolve()
    if READING.allow_outside or Path(path).resolve().is_relative_to(folder):
        return ""
    return "lies outside the folder of the fleet file: put it below, or allow it with --allow-outside"


def _names(paths: Sequence[str]) -> dict[str, str]:
    """Path → its part below the folder that all have in common, so that nothing depends on where that lies."""
    common = os.path.commonpath([os.path.dirname(p) for p in paths])
    return {p: Path(os.path.relpath(p, common)).as_posix() for p in paths}


def _serial(fleet: Fleet, path: str) -> tuple[str, str]:
    """Serial number by the name of a file, and what is wrong with the name."""
    if fleet.pattern is None:
        return "", ""
    found = search(fleet.pattern, Path(path).as_posix(), str(fleet.path))
    if found is None or not found[1]:
        return "", f"its name has no serial number by the pattern {fleet.pattern.pattern!r}"
    return found[1], ""
