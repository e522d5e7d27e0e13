"""The `physics:` block of an engine file: the effects that its model carries."""

from __future__ import annotations

from enginediag_cli.config.fields import Either, Field, Section

SWITCH = Field(
    "switch",
    "text",
    "column of the recordings that is 1 where the effect is on and 0 where it is off or "
    "not recorded; without it the effect is always on",
    "",
)
TERM = Section(
    "term",
    "a physical effect of the library; `enginediag physics` lists them",
    (
        Field("term", "text", "name of the effect"),
        Field("at", "text", "where it acts: a component, a shaft or a sensor"),
        Field(
            "coefficients", "number_map", "its coefficients; those left out are absent", {}, unit="the coefficient's"
        ),
        Field(
            "standard_errors", "number_map", "of the coefficients, when they were fitted", {}, unit="the coefficient's"
        ),
        SWITCH,
        Field("source", "text", "where the coefficients come from: data and command", ""),
    ),
)
COEFFICIENT = Section(
    "coefficient",
    "a number of a law",
    (
        Field("value", "number", "its value", unit="`unit`"),
        Field("unit", "text", "its unit, 1 for a number", "1"),
        Field("lower", "number", "least that physics allows; default none", None, unit="`unit`"),
        Field("upper", "number", "most that physics allows; default none", None, unit="`unit`"),
        Field(
            "absent",
            "number",
            "value at which the law is not there; at least one coefficient has one",
            None,
            unit="`unit`",
        ),
        Field(
            "prior_sigma",
            "number",
            "how far it plausibly lies from that, or from its value; default: it is not sought",
            None,
            unit="`unit`",
            minimum=0.0,
        ),
        Field("standard_error", "number", "when it was fitted", None, unit="`unit`", minimum=0.0),
        Field("description", "text", "what it is", ""),
    ),
)
LAW = Section(
    "law",
    "an effect that the library does not hold, by a formula; `enginediag physics --engine` shows what it may vary with",
    (
        Field("law", "text", "a name of your own"),
        Field("at", "text", "where it acts: a parameter of the engine (hpc.efficiency) or a recorded reading (T45_K)"),
        Field(
            "expression",
            "text",
            "f: of a factor (nominal 1) the share that is added, else what is added in the parameter's or reading's "
            "unit; 0 at the design point; numbers, variables, coefficients, + - * / **, exp, ln, sqrt, tanh, min, max",
        ),
        Field("coefficients", "section_map", "its coefficients by name", section=COEFFICIENT),
        Field("statement", "text", "what it says in plain words", ""),
        SWITCH,
        Field("source", "text", "where it comes from: data and command", ""),
    ),
)
EFFECT = Either("effect", "a physical effect that the model carries: a `term` or a `law`", {"term": TERM, "law": LAW})
