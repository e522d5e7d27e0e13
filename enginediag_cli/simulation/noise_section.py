"""Declaration of sensor noise in YAML."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

DISTRIBUTIONS = ("gaussian", "uniform", "none")

_SHAPE = (
    Field(
        "correlation",
        "number",
        "correlation ρ between one record and the next (Gaussian noise only)",
        0.0,
        minimum=0.0,
        maximum=0.999,
    ),
    Field(
        "outlier_probability", "number", "probability that a reading is grossly wrong", 0.0, minimum=0.0, maximum=0.5
    ),
    Field("outlier_sigmas", "number", "size of a gross error in standard deviations of the noise", 20.0, minimum=0.0),
)

COLUMN_NOISE = Section(
    "column noise",
    "noise of one column, in its own unit",
    (
        Field("type", "choice", "distribution", "gaussian", choices=DISTRIBUTIONS),
        Field(
            "sigma",
            "number",
            "standard deviation of Gaussian noise, in the column's unit; the engine file's where absent",
            None,
            minimum=0.0,
        ),
        Field(
            "width",
            "number",
            "range of uniform noise from lowest to highest, in the column's unit; "
            "`range_fraction` of the maximum reading where absent",
            None,
            minimum=0.0,
        ),
        Field(
            "quantum",
            "number",
            "step to which the reading is rounded, in the column's unit; 0 for none",
            0.0,
            minimum=0.0,
        ),
        *_SHAPE,
    ),
)

NOISE = Section(
    "noise",
    "sensor noise",
    (
        Field("type", "choice", "distribution", "gaussian", choices=DISTRIBUTIONS),
        Field("scale", "number", "factor on the standard deviations of the engine file", 1.0, minimum=0.0),
        Field(
            "range_fraction",
            "number",
            "range of uniform noise, fraction of the sensor's maximum reading",
            0.01,
            minimum=0.0,
            maximum=1.0,
        ),
        Field(
            "quantum_sigmas",
            "number",
            "step to which readings are rounded, in standard deviations of the engine file; 0 for none",
            0.0,
            minimum=0.0,
        ),
        *_SHAPE,
        Field(
            "columns",
            "section_map",
            "columns, recorded inputs too, that have noise of their own",
            {},
            section=COLUMN_NOISE,
        ),
    ),
)
