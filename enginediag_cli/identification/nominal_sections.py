"""The keys of nominal.yaml, from which it is validated, documented and written."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.identification.noise import SIGMA_FROM
from enginediag_cli.identification.nominal import STATUSES

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
        Field(
            "from_data",
            "number",
            "share of the prior variance that the data removed",
            minimum=0.0,
            maximum=1.0,
        ),
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
    (
        Field("label", "text", "recording"),
        Field("values", "number_map", "'column bias' or 'column scale': value"),
    ),
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
        Field(
            "from_data",
            "number",
            "share of the prior variance that the data removed",
            minimum=0.0,
            maximum=1.0,
        ),
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
    (
        Field("low", "numbers", "least value at each point"),
        Field("high", "numbers", "largest value at each point"),
    ),
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
            "covariance_packed",
            "text",
            "the same of many estimates: base64 of little-endian 64-bit floats",
            default="",
        ),
        Field("noise", "section_map", "column: its noise", section=NOISE),
        Field("noise_correlation", "numbers", "lower triangle of the correlation between sensors, row by row"),
        Field(
            "offsets",
            "sections",
            "sensor offsets that differ between recordings",
            default=(),
            section=OFFSET,
        ),
        Field(
            "recording_offsets",
            "sections",
            "what they were in these recordings",
            default=(),
            section=OFFSETS_FOUND,
        ),
        Field("lagging", "sections", "readings that lag where the engine moves", default=(), section=LAGGING),
        Field("in_sample", "sections", "fit on the records used", default=(), section=QUALITY),
        Field("cross_validated", "sections", "fit on left-out blocks of them", default=(), section=QUALITY),
        Field("held_out", "sections", "fit on records that were not used", default=(), section=QUALITY),
        Field("unidentified", "sections", "what the recordings leave open", default=(), section=COMBINATION),
        Field("error_model", "section", "by how much the maps may be wrong", None, section=ERROR_MODEL),
        Field("envelope", "section", "operating points seen", section=ENVELOPE),
        Field("records", "any_map", "records used, and left out by reason", default={}),
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
