"""The blocks of an engine file that later stages read: `identification:` and `mismatch:`.

The `identification:` block of an engine file: what is estimated, how loosely, and with which noise.

The `mismatch:` block of an engine file: what `locate`, `explain` and `refine` reckon with.
"""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

LOSSES = ("soft_l1", "huber", "none")
"""Robust losses of a normalised residual; `identification.loss` has their formulas."""
NOISE_CHOICES = ("estimate", "specified")
MONITORING_CHOICES = ("fit", "cross_validation")

IDENTIFICATION = Section(
    "identification",
    "What `identify` estimates from healthy recordings, and how far from nominal it may plausibly lie.",
    (
        Field(
            "parameters",
            "texts",
            "names or patterns (`hpc.*`) of what is estimated; all when empty",
            default=(),
        ),
        Field("fixed", "texts", "names or patterns that keep their nominal value", default=()),
        Field(
            "prior_mean",
            "number_map",
            "parameter: where its prior is centred, if not at nominal",
            default={},
            unit="the parameter's",
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior",
            default={},
            unit="the parameter's",
        ),
        Field("sensors", "texts", "columns that are fitted; every recorded sensor when empty", default=()),
        Field(
            "noise_sigma",
            "number_map",
            "column: standard deviation of one reading, if not the sensor's own",
            default={},
            unit="the column's",
        ),
        Field(
            "noise",
            "choice",
            "`estimate`: noise is what the fit leaves; `specified`: as the sensors state",
            default="estimate",
            choices=NOISE_CHOICES,
        ),
        Field(
            "monitoring_noise",
            "choice",
            "noise that later stages reckon with: `fit`: that of the fit; `cross_validation`: what the model "
            "leaves on records that the fit has not seen, its own error included",
            default="fit",
            choices=MONITORING_CHOICES,
        ),
        Field(
            "recording_bias_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its offset from one recording to the next "
            "(nuisance)",
            default={},
            unit="the column's",
        ),
        Field(
            "recording_scale_sigma",
            "number_map",
            "column of a sensor or an input: standard deviation of its scale error from one recording to the next "
            "(nuisance)",
            default={},
            unit="fraction",
        ),
        Field("loss", "choice", "robust loss of a normalised residual", default="soft_l1", choices=LOSSES),
        Field(
            "loss_scale",
            "number",
            "residual, in standard deviations, beyond which a reading counts less",
            default=2.5,
            minimum=0.5,
            maximum=100.0,
        ),
        Field(
            "cross_validation_block",
            "integer",
            "records in one contiguous left-out block; 0 for an eighth of all",
            default=0,
            minimum=0,
            unit="records",
        ),
        Field(
            "max_iterations",
            "integer",
            "Gauss–Newton steps of all passes and attempts before giving up; flights of real engines take about 20",
            default=75,
            minimum=1,
        ),
    ),
)


SEARCH_NOISE_CHOICES = ("specified", "estimate")

MISMATCH = Section(
    "mismatch",
    "how `locate`, `explain` and `refine` reckon with this engine",
    (
        Field(
            "nuisance",
            "texts",
            "names or patterns of what is identified along with an effect; default: what "
            "`identification:` estimates, else the monitored parameters and the sensors' scale errors; "
            "besides, the scale of each sensor of which no error is identified and no offsets of recordings are stated",
            (),
        ),
        Field(
            "prior_sigma",
            "number_map",
            "parameter: standard deviation of its prior, if not its own",
            {},
            unit="the parameter's",
        ),
        Field(
            "limits",
            "number_map",
            "coefficient of an effect: largest value that the installation can have, where "
            "that is less than the effect's own bound",
            {},
            unit="the coefficient's",
        ),
        Field(
            "map_accuracy",
            "number",
            "relative accuracy of the component maps: the model-error floor",
            0.003,
            minimum=0.0,
            maximum=0.1,
        ),
        Field("input_noise", "number_map", "input column: standard deviation of one reading", {}, unit="the column's"),
        Field(
            "input_noise_share", "number_map", "input column: standard deviation of one reading, as a share of it", {}
        ),
        Field(
            "noise",
            "choice",
            "specified: noise as the sensors, `identification:` or a nominal file state it; "
            "estimate: what nothing that is looked for explains",
            "specified",
            choices=SEARCH_NOISE_CHOICES,
        ),
    ),
)
