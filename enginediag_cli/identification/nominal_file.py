"""nominal.yaml: the `Nominal` of an engine as a file, read and written without loss.

Numbers are written with the shortest digits that give the same float back, and keys in a fixed order, so that
reading and writing again gives the same bytes.

The declaration of its keys validates, documents and writes it. Many numbers are one text: base64 of little-endian
64-bit floats, in lines. Lossless, and read a hundred times as fast as a list, of which every number is a node with a
place of its own.
"""

from __future__ import annotations

import base64
import binascii
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.config.files import refuse_other_kind
from enginediag_cli.config.validate import Checked
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.error_model.maps import ErrorModel, MapCurves, OperatingPoints
from enginediag_cli.errors import ConfigError, Mark, NoVerdictError, Problem
from enginediag_cli.identification.covariance import Combination
from enginediag_cli.identification.instruments import SensorLag
from enginediag_cli.identification.noise import SIGMA_FROM
from enginediag_cli.identification.nominal import STATUSES, Envelope, Estimate, Nominal, SensorNoise, SensorQuality
from enginediag_cli.identification.nominal_checks import (
    CHECKSUM,
    checksum_problems,
    compute_checksum,
    symmetric,
    value_problems,
)
from enginediag_cli.identification.problem import OffsetPrior

ESTIMATE = Section(
    "estimate",
    "One identified parameter.",
    (
        Field("family", "text", "health, sensor, design or physics"),
        Field("unit", "text", "unit of the values; empty for a factor", default=""),
        Field("value", "number", "nominal value"),
        Field("standard_error", "number", "standard error of the value", minimum=0.0),
        Field("prior_mean", "number", "what was assumed before"),
        Field("prior_sigma", "number", "how firmly it was assumed", minimum=0.0),
        Field("from_data", "number", "share of the prior variance that the data removed", minimum=0.0, maximum=1.0),
        Field("status", "choice", "whether the data say anything about it", choices=STATUSES),
    ),
)
NOISE = Section(
    "noise",
    "Noise of one sensor.",
    (
        Field("sigma", "number", "standard deviation of one reading", unit="the column's", minimum=0.0),
        Field("rho1", "number", "correlation of consecutive records", minimum=-1.0, maximum=1.0),
        Field("n", "integer", "readings", minimum=0),
        Field("n_effective", "number", "independent readings that they are worth", minimum=0.0),
        Field("outliers", "integer", "readings beyond 4 standard deviations", minimum=0),
        Field(
            "sigma_from",
            "choice",
            "what sigma is: the variance that the fit leaves, the sensor's own as stated, or errors of prediction of "
            "left-out blocks, that of the model included; only the first is uncertain by chance",
            default="stated",
            choices=SIGMA_FROM,
        ),
        Field("degrees", "number", "readings less those that the fit used up", default=0.0, minimum=0.0),
        Field("rho1_error", "number", "standard error of rho1, apart from the next", default=0.0, minimum=0.0),
        Field("rho1_common", "number", "standard error of rho1 that all sensors share", default=0.0, minimum=0.0),
        Field("kurtosis", "number", "excess kurtosis; 0 for Gaussian noise, -1.2 for uniform", default=0.0),
    ),
)
OFFSET = Section(
    "offset",
    "An error of a sensor or an input, constant within one recording, that differs between them.",
    (
        Field("sensor", "text", "column of a sensor or an input"),
        Field("kind", "choice", "bias in the column's unit, or scale as a fraction", choices=("bias", "scale")),
        Field("prior_sigma", "number", "standard deviation from recording to recording", minimum=0.0),
        Field("recordings", "integer", "recordings whose scatter says so; 0: it was stated", default=0, minimum=0),
        Field("spread", "number", "standard deviation of ln prior_sigma", default=0.0, minimum=0.0),
    ),
)
LAGGING = Section(
    "lagging reading",
    "A reading that lags behind the model where the engine moves.",
    (
        Field("sensor", "text", "column of a sensor"),
        Field("lags_s", "numbers", "time constants of lags of the power setting"),
        Field("amounts", "numbers", "of each lag less the power setting itself, in the column's unit per unit of it"),
        Field("spread", "numbers", "standard deviation of the amounts from stretch to stretch"),
        Field("moved", "number", "RMS of reading minus model where the engine moves", minimum=0.0),
        Field("left", "number", "the same without what it lags by", minimum=0.0),
    ),
)
OFFSETS_FOUND = Section(
    "offsets of a recording",
    "Offsets found in one recording.",
    (Field("label", "text", "recording"), Field("values", "number_map", "'column bias' or 'column scale': value")),
)
QUALITY = Section(
    "quality",
    "Fit of one sensor in one regime.",
    (
        Field("sensor", "text", "column"),
        Field("regime", "text", "all, ground, climb, cruise, descent or a band of power"),
        Field("n", "integer", "readings", minimum=0),
        Field("rms", "number", "root mean square of reading minus model", minimum=0.0),
        Field("unit", "text", "unit of rms; % is of the predicted value", default=""),
        Field("chi2", "number", "mean square over noise variance", minimum=0.0),
    ),
)
COMBINATION = Section(
    "combination",
    "A combination of parameters that these recordings leave open.",
    (
        Field("parameters", "texts", "names, the leading one first"),
        Field("coefficients", "numbers", "factors, 1 for the leading one"),
        Field("from_data", "number", "share of the prior variance that the data removed", minimum=0.0, maximum=1.0),
    ),
)
MACHINE = Section(
    "machine",
    "Map coordinates of one machine in training: ln corrected speed and ln flow or pressure ratio.",
    (
        Field("centre", "numbers", "middle of the range of both coordinates"),
        Field("reach", "numbers", "half of that range"),
        Field("line", "numbers", "scaled position on powers 0 to 3 of the scaled speed"),
    ),
)
POINTS = Section(
    "input at operating points",
    "Range of one input at each operating point that was flown again and again.",
    (Field("low", "numbers", "least value at each point"), Field("high", "numbers", "largest value at each point")),
)
ERROR_MODEL = Section(
    "error model",
    "By how much the component maps may be wrong; what they are wrong by stands among the estimates.",
    (
        Field("stated", "number", "accuracy of the maps as the engine file has it", minimum=0.0, maximum=0.1),
        Field("sizes", "number_map", "map quantity: standard deviation of each amount"),
        Field("machines", "section_map", "machine: where its map was run", section=MACHINE),
        Field("misses", "number_map", "column: standard deviation of what the model misses at a point", default={}),
        Field("points", "section_map", "input: the range of each operating point", default={}, section=POINTS),
    ),
)
AXIS = Section(
    "envelope input",
    "One input of the envelope and its value in every point of the cover.",
    (
        Field("scale", "number", "distance that counts as 1", minimum=0.0),
        Field("low", "number", "smallest value seen"),
        Field("high", "number", "largest value seen"),
        Field("points", "numbers", "value in each point"),
    ),
)
ENVELOPE = Section(
    "envelope",
    "Operating points seen; what is farther than `threshold` is not judged.",
    (
        Field("threshold", "number", "largest scaled distance to a point", minimum=0.0),
        Field("inputs", "section_map", "column: its scale and its values", section=AXIS),
    ),
)
DESCRIPTION = Section(
    "engine description",
    "The engine that was identified: the text of its file, and of the map tables that it reads.",
    (
        Field("text", "text", "the engine file, as it was"),
        Field("tables", "text_map", "file of a map, as the engine file names it: its text", default={}),
    ),
)

NOMINAL_FILE = Section(
    "nominal",
    "The nominal state of an engine, written by `enginediag identify`.",
    (
        Field("kind", "choice", "what this file is", choices=("nominal",)),
        Field("engine", "text", "engine file, relative to this one"),
        Field("engine_sha256", "text", "SHA-256 of that file when this one was written"),
        Field("engine_description", "section", "that file itself, with its maps", None, section=DESCRIPTION),
        Field("inputs", "texts", "columns that the engine needs"),
        Field("estimates", "section_map", "parameter: its nominal value", section=ESTIMATE),
        Field("covariance", "numbers", "lower triangle of the covariance of the estimates, row by row", ()),
        Field(
            "covariance_packed", "text", "the same of many estimates: base64 of little-endian 64-bit floats", default=""
        ),
        Field("noise", "section_map", "column: its noise", section=NOISE),
        Field("noise_correlation", "numbers", "lower triangle of the correlation between sensors, row by row"),
        Field("offsets", "sections", "sensor offsets that differ between recordings", default=(), section=OFFSET),
        Field("recording_offsets", "sections", "what they were in these recordings", default=(), section=OFFSETS_FOUND),
        Field("lagging", "sections", "readings that lag where the engine moves", default=(), section=LAGGING),
        Field("in_sample", "sections", "fit on the records used", default=(), section=QUALITY),
        Field("cross_validated", "sections", "fit on left-out blocks of them", default=(), section=QUALITY),
        Field("held_out", "sections", "fit on records that were not used", default=(), section=QUALITY),
        Field("unidentified", "sections", "what the recordings leave open", default=(), section=COMBINATION),
        Field("error_model", "section", "by how much the maps may be wrong", None, section=ERROR_MODEL),
        Field("envelope", "section", "operating points seen", section=ENVELOPE),
        Field("records", "any_map", "records used, and excluded ones by reason", default={}),
        Field("provenance", "text_map", "version, command, files", default={}),
        Field(
            "smooth",
            "choice",
            "whether a fit over the operating points stands for what is uncertain, which is faster",
            default="unknown",
            choices=("yes", "no", "unknown"),
        ),
        Field("checksum", "text", "checksum of all other lines but comments, as identify wrote them", default=""),
    ),
)


LINE = 100
"""Characters of a line: no editor folds it."""


def pack_numbers(numbers: np.ndarray) -> str:
    """The text of numbers (n,)."""
    return "\n".join(textwrap.wrap(base64.b64encode(np.asarray(numbers, "<f8").tobytes()).decode(), LINE)) + "\n"


def unpack_numbers(text: str) -> np.ndarray:
    """The numbers (n,) of a text. Raises ValueError for what `packed` did not make, and for what is not finite."""
    try:
        raw = base64.b64decode("".join(text.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError("it is not base64") from error
    if len(raw) % 8:
        raise ValueError(f"it has {len(raw)} bytes, which are no 64-bit numbers")
    numbers = np.frombuffer(raw, "<f8").astype(float)
    if not np.isfinite(numbers).all():
        raise ValueError("it holds a number that is not finite")
    return numbers


LISTED = 30
"""Estimates whose covariance is written as numbers that people can read; nobody reads that of more."""

HEADER = """\
# Nominal engine: parameters, sensor noise and operating envelope identified from healthy recordings.
# Values are in the unit given beside them; sensor values are in the unit of their column's name.
# A parameter with status "at prior" was not found: its value is what was assumed before.
# covariance_packed is the lower triangle of the covariance of the estimates, row by row, as 64-bit floats in base64.
"""


def read_nominal(path: str | Path) -> Nominal:
    """Read a nominal file.

    Parameters
    ----------
    path : path

    Returns
    -------
    Nominal
        Without ``sealed`` if the file has no checksum.

    Raises
    ------
    ConfigError
        With every problem of the file: a wrong key, an impossible value, any edit since ``identify`` wrote it.
    """
    from enginediag_cli.config.validate import load_checked

    checked = load_checked(path, "nominal")
    _refuse_impossible(checked, Path(path).read_text(encoding="utf-8-sig"))
    v = checked.values
    p, m = len(v["estimates"]), len(v["noise"])
    return Nominal(
        engine_path=v["engine"],
        engine_sha256=v["engine_sha256"],
        inputs=tuple(v["inputs"]),
        estimates=tuple(Estimate(name, **e) for name, e in v["estimates"].items()),
        covariance=symmetric(v["covariance"], p),
        noise=tuple(SensorNoise(name, **e) for name, e in v["noise"].items()),
        noise_correlation=symmetric(v["noise_correlation"], m),
        offsets=tuple(OffsetPrior(**o) for o in v["offsets"]),
        recording_offsets={r["label"]: dict(r["values"]) for r in v["recording_offsets"]},
        in_sample=tuple(SensorQuality(**q) for q in v["in_sample"]),
        cross_validated=tuple(SensorQuality(**q) for q in v["cross_validated"]),
        held_out=tuple(SensorQuality(**q) for q in v["held_out"]),
        unidentified=tuple(
            Combination(tuple(c["parameters"]), tuple(c["coefficients"]), c["from_data"]) for c in v["unidentified"]
        ),
        envelope=_envelope(v["envelope"]),
        records={k: int(n) for k, n in v["records"].items()},
        provenance=dict(v["provenance"]),
        sealed=bool(v[CHECKSUM]),
        smooth={"yes": True, "no": False}.get(v["smooth"]),
        error_model=_error_model(v["error_model"]),
        sensor_lags=tuple(_lagging(x) for x in v["lagging"]),
        description=_description(v["engine_description"], Path(path).parent / v["engine"]),
    )


def _refuse_impossible(checked: Checked, text: str) -> None:
    """Raises ConfigError for values that cannot be, and for a text that is not as it was written."""
    if checked.values["covariance_packed"]:
        checked.values["covariance"] = _unpack_covariance(checked)
    problems = [*checksum_problems(checked, text), *value_problems(checked)]
    if problems:
        raise ConfigError(problems)


def _unpack_covariance(checked: Checked) -> list[float]:
    if checked.values["covariance"]:
        raise ConfigError([checked.problem(("covariance",), "covariance is given twice, as numbers and packed")])
    try:
        return [float(x) for x in unpack_numbers(checked.values["covariance_packed"])]
    except ValueError as error:
        message = f"covariance_packed cannot be read: {error}"
        raise ConfigError([checked.problem(("covariance_packed",), message, "run identify again")]) from error


def _description(values: Mapping[str, Any] | None, engine_path: Path) -> EngineDescription | None:
    return None if values is None else EngineDescription(str(engine_path), values["text"], dict(values["tables"]))


def _error_model(values: Mapping[str, Any] | None) -> ErrorModel | None:
    if values is None:
        return None
    curves = tuple(MapCurves.from_mapping(name, c) for name, c in values["machines"].items())
    at = values["points"]
    points = None
    if at:
        low, high = (np.column_stack([axis[key] for axis in at.values()]).astype(float) for key in ("low", "high"))
        points = OperatingPoints(tuple(at), low, high)
    return ErrorModel(values["stated"], curves, dict(values["sizes"]), points, dict(values["misses"]))


def _envelope(values: Mapping[str, Any]) -> Envelope:
    axes = values["inputs"]
    scale, low, high = (np.array([a[key] for a in axes.values()], float) for key in ("scale", "low", "high"))
    points = np.column_stack([a["points"] for a in axes.values()]).astype(float)
    return Envelope(tuple(axes), scale, low, high, points, values["threshold"])


def format_nominal(nominal: Nominal) -> str:
    """The text of the file."""
    import yaml

    class NominalDumper(yaml.SafeDumper):
        """Quotes texts that YAML 1.2 would read as numbers and PyYAML, which follows 1.1, would not."""

    def text(dumper: yaml.SafeDumper, value: str) -> yaml.Node:
        style = "|" if "\n" in value else "'" if value[:1].isdigit() or value[:1] in "+-." else None
        return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)

    NominalDumper.add_representer(str, text)
    body = yaml.dump(
        _to_values(nominal),
        Dumper=NominalDumper,
        sort_keys=False,
        allow_unicode=True,
        width=110,
        default_flow_style=None,
    )
    return f"{HEADER}{body}{CHECKSUM}: {compute_checksum(body)}\n"


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal file completely or not at all.

    Parameters
    ----------
    nominal : Nominal
    path : path

    Raises
    ------
    OSError
        If the file cannot be written.
    NoVerdictError
        For a state that could not be read back.
    """
    from enginediag_cli.config.document import parse_document
    from enginediag_cli.config.validate import check_document
    from enginediag_cli.recordings.write import open_output

    text = format_nominal(nominal)
    try:
        _refuse_impossible(check_document(parse_document(text, str(path)), "nominal"), text)
    except ConfigError as error:
        first = error.problems[0].message
        raise NoVerdictError(f"no nominal state: what was identified cannot be: {first}; nothing is written") from error
    with open_output(path) as stream:
        stream.write(text)


def engine_file(nominal: Nominal, nominal_path: str | Path) -> Path:
    """The engine file that a nominal file means, resolved against the nominal file's folder.

    It may lie anywhere: a user named it to identify. Raises ConfigError when it is no file of kind engine.
    """
    path = Path(nominal_path).parent / nominal.engine_path
    refuse_other_kind(path, "engine", Mark(str(nominal_path)))
    return path


def refuse_changed_engine(
    nominal: Nominal, engine_path: str | Path, *, accept: bool = False, nominal_path: str | Path | None = None
) -> str:
    """SHA-256 of an engine file that is not the one that was identified, when that is accepted; '' when it is the one.

    Raises ConfigError, at its line of the nominal file where that is given, when it is not accepted, and OSError.
    """
    from enginediag_cli.recordings.source import file_sha256

    digest = file_sha256(engine_path)
    if digest == nominal.engine_sha256:
        return ""
    if accept:
        return digest
    mark = Mark(str(engine_path))
    if nominal_path is not None:
        from enginediag_cli.config.document import load_document

        mark = Checked({}, load_document(nominal_path)).mark(("engine_sha256",))
    what = f"{engine_path} has changed since its nominal state was identified"
    raise ConfigError([Problem(mark, what, "run identify again, or go on with --accept-changed-engine")])


def fingerprint(nominal: Nominal) -> str:
    """SHA-256 (16 digits) of everything that the nominal says, to bind to it what is made with it."""
    import hashlib
    import json

    return hashlib.sha256(json.dumps(_to_values(nominal)).encode()).hexdigest()[:16]


def _to_values(n: Nominal) -> dict[str, Any]:
    e = n.envelope
    return {
        "kind": "nominal",
        "engine": n.engine_path,
        "engine_sha256": n.engine_sha256,
        "provenance": dict(n.provenance),
        "smooth": "unknown" if n.smooth is None else "yes" if n.smooth else "no",
        "records": dict(n.records),
        "inputs": list(n.inputs),
        "estimates": {x.name: _fields(x, ESTIMATE) for x in n.estimates},
        "noise": {x.sensor: _fields(x, NOISE) for x in n.noise},
        "in_sample": [_fields(q, QUALITY) for q in n.in_sample],
        "cross_validated": [_fields(q, QUALITY) for q in n.cross_validated],
        "held_out": [_fields(q, QUALITY) for q in n.held_out],
        "unidentified": [_fields(c, COMBINATION) for c in n.unidentified],
        "offsets": [_fields(o, OFFSET) for o in n.offsets],
        "recording_offsets": [{"label": k, "values": dict(v)} for k, v in n.recording_offsets.items()],
        **({"lagging": [_fields(x, LAGGING) for x in n.sensor_lags]} if n.sensor_lags else {}),
        "noise_correlation": _triangle(n.noise_correlation),
        **_covariance_values(n.covariance),
        **({} if n.error_model is None else {"error_model": _error_values(n.error_model)}),
        **({} if n.description is None else {"engine_description": _description_values(n.description)}),
        "envelope": {
            "threshold": float(e.threshold),
            "inputs": {
                c: {
                    "scale": float(e.scale[j]),
                    "low": float(e.low[j]),
                    "high": float(e.high[j]),
                    "points": [float(x) for x in e.points[:, j]],
                }
                for j, c in enumerate(e.inputs)
            },
        },
    }


def _error_values(found: ErrorModel) -> dict[str, Any]:
    return {
        "stated": float(found.stated),
        "sizes": {target: float(size) for target, size in found.sizes.items()},
        "machines": {c.machine: c.to_mapping() for c in found.curves},
        **({} if found.points is None else _point_values(found.points, found.misses)),
    }


def _point_values(points: OperatingPoints, misses: Mapping[str, float]) -> dict[str, Any]:
    limits = {"low": points.low, "high": points.high}
    return {
        "misses": {column: float(size) for column, size in misses.items()},
        "points": {
            c: {key: [float(x) for x in values[:, j]] for key, values in limits.items()}
            for j, c in enumerate(points.inputs)
        },
    }


def _description_values(described: EngineDescription) -> dict[str, Any]:
    return {"text": described.text, "tables": dict(described.tables)}


def _lagging(v: Mapping[str, Any]) -> SensorLag:
    lags, amounts, spread = (tuple(map(float, v[name])) for name in ("lags_s", "amounts", "spread"))
    return SensorLag(v["sensor"], lags, amounts, spread, v["moved"], v["left"])


def _fields(item: Any, section: Section) -> dict[str, Any]:
    return {f.name: _plain(getattr(item, f.name)) for f in section.fields}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(v) for v in value]
    return value


def _covariance_values(matrix: np.ndarray) -> dict[str, Any]:
    if len(matrix) <= LISTED:
        return {"covariance": _triangle(matrix)}
    return {"covariance_packed": pack_numbers(matrix[np.tril_indices(len(matrix))])}


def _triangle(matrix: np.ndarray) -> list[float]:
    return [float(x) for x in matrix[np.tril_indices(len(matrix))]]
