"""The `physics:` block of an engine file: the effects that its model carries."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section

EFFECT = Section(
    "effect",
    "a physical effect that the model carries; `enginediag physics` lists them",
    (
        Field("term", "text", "name of the effect"),
        Field("at", "text", "where it acts: a component, a shaft or a sensor"),
        Field(
            "coefficients", "number_map", "its coefficients; those left out are absent", {}, unit="the coefficient's"
        ),
        Field(
            "standard_errors", "number_map", "of the coefficients, when they were fitted", {}, unit="the coefficient's"
        ),
        Field(
            "switch",
            "text",
            "column of the recordings that is 1 where the effect is on and 0 where it is off or "
            "not recorded; without it the effect is always on",
            "",
        ),
        Field("source", "text", "where the coefficients come from: data and command", ""),
    ),
)
