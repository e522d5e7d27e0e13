"""What a nominal file must hold beyond the kinds of its keys: noise, covariance and envelope that can be, an engine
that has what it names, and numbers that nobody changed since `identify` wrote them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.checked import Checked
from enginediag_cli.config.hints import near
from enginediag_cli.engine.model import MonitoredModel
from enginediag_cli.errors import ConfigError, Problem
from enginediag_cli.identification.nominal import Nominal

CHECKSUM = "checksum"
"""Key of the line that holds the checksum of all other lines."""
SMALLEST, LARGEST = 1e-12, 1e12
"""No sensor in any unit has noise, and no input a spread, beyond these; their squares stay far from overflow."""
ROUNDING = 1e-6
"""Relative error that rounding may leave in a covariance: eigenvalues and diagonals are off by no more."""


def checksum_of(text: str) -> str:
    """Checksum of a nominal file: of its lines but comments, empty ones and the one that holds the checksum."""
    digest = hashlib.sha256()
    for line in text.splitlines():
        bare = line.rstrip()
        if bare and not bare.lstrip().startswith("#") and not bare.startswith(f"{CHECKSUM}:"):
            digest.update(bare.encode() + b"\n")
    return f"sha256:{digest.hexdigest()}"


def checksum_problems(checked: Checked, text: str) -> Iterator[Problem]:
    """Whether the file is as `identify` wrote it; a file without a checksum is (its reader is to say so)."""
    stated = checked.values[CHECKSUM]
    if stated and stated != checksum_of(text):
        yield checked.problem(
            (CHECKSUM,),
            "the checksum does not fit: the file was edited after identify wrote it",
            "run identify again, or remove the checksum line to take responsibility for the edit",
        )


def value_problems(checked: Checked) -> Iterator[Problem]:
    """Values that no identification can have found."""
    v = checked.values
    if not v["noise"]:
        yield Problem(checked.mark(("noise",)), "noise names no sensor, and nothing can be judged without one")
    for column, noise in v["noise"].items():
        if not SMALLEST <= noise["sigma"] <= LARGEST:
            yield checked.problem(
                ("noise", column, "sigma"), f"sigma of {column} must lie between {SMALLEST:g} and {LARGEST:g}"
            )
        if abs(noise["rho1"]) >= 1:
            yield checked.problem(
                ("noise", column, "rho1"), f"rho1 of {column} must lie between -1 and 1, and not be either"
            )
    for name, estimate in v["estimates"].items():
        for key in ("value", "standard_error", "prior_mean", "prior_sigma"):
            if abs(estimate[key]) > LARGEST:
                yield checked.problem(("estimates", name, key), f"{key} of {name} is beyond {LARGEST:g}")
    for k, offset in enumerate(v["offsets"]):
        if offset["sensor"] not in (*v["noise"], *v["inputs"]):
            yield checked.problem(
                ("offsets", k, "sensor"),
                f"the offset is of {offset['sensor']!r}, which has no noise here and is no input",
                near(offset["sensor"], (*v["noise"], *v["inputs"])),
            )
        if not SMALLEST <= offset["prior_sigma"] <= LARGEST:
            yield checked.problem(("offsets", k, "prior_sigma"), f"prior_sigma must be {SMALLEST:g} to {LARGEST:g}")
    for reason, number in v["records"].items():
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            yield checked.problem(("records", reason), f"records.{reason} must be a number of records")
    yield from _envelope_problems(checked, v["envelope"])
    yield from _matrix_problems(checked, v)


def _envelope_problems(checked: Checked, envelope: Mapping[str, Any]) -> Iterator[Problem]:
    axes = envelope["inputs"]
    if not axes or len({len(a["points"]) for a in axes.values()}) != 1 or not next(iter(axes.values()))["points"]:
        message = "the inputs of the envelope differ in number of points" if axes else "the envelope names no input"
        yield checked.problem(("envelope",), message)
    if not 0 < envelope["threshold"] <= LARGEST:
        yield checked.problem(("envelope", "threshold"), "threshold must be positive")
    for column, axis in axes.items():
        where = ("envelope", "inputs", column)
        if not SMALLEST <= axis["scale"] <= LARGEST:
            yield checked.problem((*where, "scale"), f"scale must lie between {SMALLEST:g} and {LARGEST:g}")
        if axis["low"] > axis["high"]:
            yield checked.problem((*where, "low"), f"low is above high, {axis['high']:g}")
        if any(abs(x) > LARGEST for x in axis["points"]):
            yield checked.problem((*where, "points"), f"a point is beyond {LARGEST:g}")


def _matrix_problems(checked: Checked, v: Mapping[str, Any]) -> Iterator[Problem]:
    """Size, diagonal and definiteness of both triangles."""
    errors = [e["standard_error"] for e in v["estimates"].values()]
    for key, diagonal, of in (
        ("covariance", errors, "estimates"),
        ("noise_correlation", [1.0] * len(v["noise"]), "sensors"),
    ):
        n, given = len(diagonal), v[key]
        if len(given) != n * (n + 1) // 2:
            text = f"{key} has {len(given)} numbers, and {n * (n + 1) // 2} are needed for {n} {of}"
            yield checked.problem((key,), text)
            continue
        if not n or any(abs(x) > LARGEST**2 for x in given):
            if n:
                yield checked.problem((key,), f"{key} has a number beyond {LARGEST**2:g}")
            continue
        matrix, scale = symmetric(given, n), np.asarray(diagonal)
        wrong = np.flatnonzero(~np.isclose(np.diag(matrix), scale**2, rtol=ROUNDING, atol=0.0))
        if wrong.size:
            i = int(wrong[0])
            name = list(v["estimates" if key == "covariance" else "noise"])[i]
            yield checked.problem(
                (key, i * (i + 3) // 2),
                f"{key} of {name} with itself is {matrix[i, i]:g}, and must be {scale[i] ** 2:g}",
                "the square of its standard_error" if key == "covariance" else "a correlation",
            )
            continue
        safe = np.where(scale > 0, scale, 1.0)
        if float(np.linalg.eigvalsh(matrix / safe / safe[:, None])[0]) < -ROUNDING * n:
            yield checked.problem(
                (key,), f"{key} is not that of any numbers: it is not positive semi-definite", "run identify again"
            )


def symmetric(triangle: Iterable[float], n: int) -> np.ndarray:
    """The matrix (n, n) of a lower triangle, row by row."""
    matrix = np.zeros((n, n))
    matrix[np.tril_indices(n)] = np.asarray(list(triangle), float)
    return np.asarray(matrix + np.tril(matrix, -1).T)


def check_nominal_fits(nominal: Nominal, engine: MonitoredModel, path: str | Path) -> None:
    """ConfigError, with every place in the nominal file, unless the engine has what the nominal names: its
    parameters, and their values within the engine's bounds, its sensors and its inputs."""
    wrong: list[tuple[tuple[str | int, ...], str, str]] = []
    model = nominal.error_model.of(engine) if nominal.error_model else None
    parameters = (model or engine).parameters
    lacking = set(model.amounts if model else ()) - {e.name for e in nominal.estimates}
    if lacking:
        what = f"{len(lacking)} errors of maps were not identified, {min(lacking)!r} the first: there were fewer then"
        wrong.append((("estimates",), what, "run identify again"))
    for e in nominal.estimates:
        known = parameters.get(e.name)
        if known is None:
            wrong.append((("estimates", e.name), _absent(engine, "parameter", e.name), near(e.name, parameters)))
        elif not known.lower <= e.value <= known.upper:
            bounds = f"{known.lower:g} to {known.upper:g}"
            wrong.append((("estimates", e.name, "value"), f"{e.name} cannot be {e.value:g}", f"it lies in {bounds}"))
    for column in nominal.sensors:
        if column not in engine.sensors:
            wrong.append((("noise", column), _absent(engine, "sensor", column), near(column, engine.sensors)))
    inputs = (*engine.inputs, *engine.optional_inputs)
    for k, column in enumerate(nominal.inputs):
        if column not in inputs:
            wrong.append((("inputs", k), _absent(engine, "input", column), near(column, inputs)))
    for column in nominal.envelope.inputs:
        if column not in inputs and column not in nominal.inputs:
            place = ("envelope", "inputs", column)
            wrong.append((place, _absent(engine, "input", column), near(column, inputs)))
    if not wrong:
        return
    from enginediag_cli.config.document import load_document

    places = Checked({}, load_document(path))
    raise ConfigError([Problem(places.key_mark(where), what, hint) for where, what, hint in wrong])


def _absent(engine: MonitoredModel, what: str, name: str) -> str:
    return f"the engine {engine.name} has no {what} {name!r}: this nominal is of another engine, or of this one before"


def other_instance(nominal: Nominal, instance: str) -> tuple[str, str] | None:
    """(instance identified, instance of the recordings) when both are named and differ: engines of one type differ
    before anything goes wrong, so what is then found may be the difference between them. None otherwise."""
    identified = nominal.engine_instance
    return (identified, instance) if identified and instance and identified != instance else None
