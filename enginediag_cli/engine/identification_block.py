"""The `identification:` block of an engine file: what is estimated, how loosely, and with which noise."""

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
