"""Checks of a nominal file beyond the kinds of its keys, its engine, and its state under another map accuracy.

Noise, covariance and envelope must be possible, the engine must have what the file names, and the checksum must fit.
The engine that the file contains is built here; its problems are reported at their lines of the nominal file.

**Map accuracy.** `set_map_accuracy` gives the nominal state as it would be if the maps were as accurate as stated.
Parameters and amounts of map error were found together, x ~ N(μ, C) under priors of variance P (all in prior standard
deviations, where P = 1). The records alone contribute C⁻¹ − 1 and C⁻¹ μ; with other variances P' of the amounts,

    C' = (C⁻¹ − 1 + P'⁻¹)⁻¹,     μ' = C' C⁻¹ μ.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.config.fields import near
from enginediag_cli.config.files import refuse_other_kind
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.engine.wrapped import MonitoredModel
from enginediag_cli.error_model.maps import FAMILY
from enginediag_cli.errors import ConfigError, Mark, Problem
from enginediag_cli.identification.nominal import Nominal, estimate_status

if TYPE_CHECKING:
    from enginediag_cli.engine.engine import Engine


CHECKSUM = "checksum"
"""Key of the line that holds the checksum of all other lines."""
SMALLEST, LARGEST = 1e-12, 1e12
"""No sensor in any unit has noise, and no input a spread, beyond these; their squares stay far from overflow."""
ROUNDING = 1e-6
"""Relative error that rounding may leave in a covariance: eigenvalues and diagonals are off by no more."""


def compute_checksum(text: str) -> str:
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
    if stated and stated != compute_checksum(text):
        yield checked.problem(
            (CHECKSUM,),
            "the checksum does not fit: the file was edited after identify wrote it",
            "run identify again, or remove the checksum line to take responsibility for the edit",
        )


def value_problems(checked: Checked) -> Iterator[Problem]:
    """Values that no identification can have found."""
    v = checked.values
    yield from _noise_problems(checked, v["noise"])
    for name, estimate in v["estimates"].items():
        for key in ("value", "standard_error", "prior_mean", "prior_sigma"):
            if abs(estimate[key]) > LARGEST:
                yield checked.problem(("estimates", name, key), f"{key} of {name} is beyond {LARGEST:g}")
    yield from _offset_problems(checked, v["offsets"], (*v["noise"], *v["inputs"]))
    for reason, number in v["records"].items():
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            yield checked.problem(("records", reason), f"records.{reason} must be a number of records")
    yield from _envelope_problems(checked, v["envelope"])
    yield from _matrix_problems(checked, v)


def _noise_problems(checked: Checked, noise_of_sensors: Mapping[str, Any]) -> Iterator[Problem]:
    if not noise_of_sensors:
        yield Problem(checked.mark(("noise",)), "noise names no sensor, and nothing can be judged without one")
    for column, noise in noise_of_sensors.items():
        if not SMALLEST <= noise["sigma"] <= LARGEST:
            yield checked.problem(
                ("noise", column, "sigma"), f"sigma of {column} must lie between {SMALLEST:g} and {LARGEST:g}"
            )
        if abs(noise["rho1"]) >= 1:
            yield checked.problem(
                ("noise", column, "rho1"), f"rho1 of {column} must lie between -1 and 1, and not be either"
            )


def _offset_problems(checked: Checked, offsets: Sequence[Any], columns: Sequence[str]) -> Iterator[Problem]:
    """columns: those that may have an offset, sensors with noise and inputs."""
    for k, offset in enumerate(offsets):
        if offset["sensor"] not in columns:
            yield checked.problem(
                ("offsets", k, "sensor"),
                f"the offset is of {offset['sensor']!r}, which has no noise here and is no input",
                near(offset["sensor"], columns),
            )
        if not SMALLEST <= offset["prior_sigma"] <= LARGEST:
            yield checked.problem(("offsets", k, "prior_sigma"), f"prior_sigma must be {SMALLEST:g} to {LARGEST:g}")


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
    model = nominal.error_model.wrap(engine) if nominal.error_model else None
    parameters = (model or engine).parameters
    lacking = set(model.amounts if model else ()) - {e.name for e in nominal.estimates}
    if lacking:
        what = f"{len(lacking)} errors of maps were not identified, {min(lacking)!r} the first: there were fewer then"
        wrong.append((("estimates",), what, "run identify again"))
    for e in nominal.estimates:
        known = parameters.get(e.name)
        if known is None:
            wrong.append((("estimates", e.name), _missing_name(engine, "parameter", e.name), near(e.name, parameters)))
        elif not known.lower <= e.value <= known.upper:
            bounds = f"{known.lower:g} to {known.upper:g}"
            wrong.append((("estimates", e.name, "value"), f"{e.name} cannot be {e.value:g}", f"it lies in {bounds}"))
    for column in nominal.sensors:
        if column not in engine.sensors:
            wrong.append((("noise", column), _missing_name(engine, "sensor", column), near(column, engine.sensors)))
    inputs = (*engine.inputs, *engine.optional_inputs)
    for k, column in enumerate(nominal.inputs):
        if column not in inputs:
            wrong.append((("inputs", k), _missing_name(engine, "input", column), near(column, inputs)))
    for column in nominal.envelope.inputs:
        if column not in inputs and column not in nominal.inputs:
            place = ("envelope", "inputs", column)
            wrong.append((place, _missing_name(engine, "input", column), near(column, inputs)))
    if not wrong:
        return
    from enginediag_cli.config.document import load_document

    places = Checked({}, load_document(path))
    raise ConfigError([Problem(places.key_mark(where), what, hint) for where, what, hint in wrong])


def _missing_name(engine: MonitoredModel, what: str, name: str) -> str:
    return f"the engine {engine.name} has no {what} {name!r}: this nominal is of another engine, or of this one before"


def instance_conflict(nominal: Nominal, instance: str) -> tuple[str, str] | None:
    """(instance identified, instance of the recordings) when both are named and differ: engines of one type differ
    before anything goes wrong, so what is then found may be the difference between them. None otherwise."""
    identified = nominal.engine_instance
    return (identified, instance) if identified and instance and identified != instance else None


SECTION = "engine_description"
"""Key of the nominal file."""


def build_described_engine(
    described: EngineDescription, nominal_path: str | Path, power_setting: str | None = None
) -> Engine:
    """The engine of a description; `power_setting` replaces its own. Raises ConfigError at places in the nominal
    file."""
    from enginediag_cli.physics.engine_file import load_engine

    try:
        return load_engine(described, power_setting)
    except ConfigError as error:
        raise ConfigError([_relocate(p, described, nominal_path) for p in error.problems]) from error


def changed_engine_file(described: EngineDescription, nominal_path: str | Path) -> str:
    """The engine file that was identified where it is there and says something else now, or its maps do; else ''. A
    file that is gone, cannot be read or is none of an engine is nobody's concern: it is not needed."""
    try:
        refuse_other_kind(described.file, "engine", Mark(str(nominal_path)))
        return described.file if described.differs(described.file) else ""
    except ConfigError:
        return ""


def _relocate(problem: Problem, described: EngineDescription, nominal_path: str | Path) -> Problem:
    """The problem at its line of the nominal file, in which every line of a text is a line."""
    from enginediag_cli.config.document import load_document
    from enginediag_cli.config.validate import Checked

    mark = problem.mark
    folder = Path(described.file).parent
    places: dict[str, tuple[tuple[str, ...], str]] = {described.file: ((SECTION, "text"), described.text)}
    places.update({str(folder / name): ((SECTION, "tables", name), text) for name, text in described.tables.items()})
    if mark.file not in places:
        return problem
    place, text = places[mark.file]
    start = Checked({}, load_document(nominal_path)).mark(place)
    lines, own = Path(nominal_path).read_text(encoding="utf-8-sig").split("\n"), text.split("\n")
    at = start.line + max(mark.line, 1)
    if not mark.line or at > len(lines) or mark.line > len(own) or not lines[at - 1].endswith(own[mark.line - 1]):
        # written by hand in another style: the place of the text, and the line within it
        within = f" in line {mark.line} of {mark.file} as it travels here" if mark.line else ""
        return problem._replace(mark=start, message=problem.message + within)
    indent = len(lines[at - 1]) - len(own[mark.line - 1])
    return problem._replace(mark=Mark(str(nominal_path), at, mark.column + indent if mark.column else 0))


NONE = 1e-4
"""Share of its size to which an amount is held where the maps are said to be right: it vanishes, and C' stays
regular."""


def set_map_accuracy(nominal: Nominal, accuracy: float) -> Nominal:
    """The nominal state with maps of this relative accuracy; as it is where it knows of no map error."""
    found = nominal.error_model
    if found is None:
        return nominal
    estimates = nominal.estimates
    scale = np.array([e.prior_sigma for e in estimates])
    mean = np.array([e.value - e.prior_mean for e in estimates]) / scale
    own = np.array([e.family == FAMILY for e in estimates])
    factor = np.where(own, np.maximum(accuracy / scale, NONE), 1.0)
    information = np.linalg.inv(nominal.covariance / scale / scale[:, None])
    information = (information + information.T) / 2
    covariance = np.linalg.inv(information - np.eye(len(scale)) + np.diag(factor**-2))
    moved = covariance @ (information @ mean)
    scaled = covariance * scale * scale[:, None]
    errors = np.sqrt(np.diag(scaled))
    values = np.array([e.prior_mean for e in estimates]) + scale * moved
    changed = tuple(
        replace(
            e,
            value=float(v),
            standard_error=float(s),
            prior_sigma=float(e.prior_sigma * f),
            from_data=float(np.clip(1 - (s / (e.prior_sigma * f)) ** 2, 0.0, 1.0)),
        )
        for e, v, s, f in zip(estimates, values, errors, factor, strict=True)
    )
    changed = tuple(replace(e, status=estimate_status(e.from_data, e.status == "at bound")) for e in changed)
    sizes = dict.fromkeys(found.sizes, accuracy)
    return replace(
        nominal,
        estimates=changed,
        covariance=(scaled + scaled.T) / 2,
        error_model=replace(found, stated=accuracy, sizes=sizes),
        smooth=None if nominal.smooth else nominal.smooth,
    )
