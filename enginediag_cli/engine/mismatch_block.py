"""The `mismatch:` block of an engine file: what `locate`, `explain` and `refine` reckon with."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

NOISE_CHOICES = ("specified", "estimate")

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
            choices=NOISE_CHOICES,
        ),
    ),
)
