"""A product of columns: torque times speed, or a flow recorded per unit of pressure."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.recordings.derived.rule import Columns, Rule, Settings


def _compute(columns: Columns, settings: Settings) -> np.ndarray:
    value = np.prod([columns[name] for name in settings["of"]], axis=0)
    for name in settings["over"]:
        value = value / columns[name]
    return settings["factor"] * value


PRODUCT = Rule(
    Section(
        "product",
        "factor times the product of some columns over the product of others",
        (
            Field("of", "texts", "columns to multiply"),
            Field("over", "texts", "columns to divide by", ()),
            Field("factor", "number", "constant factor", 1.0),
        ),
    ),
    lambda settings: [*settings["of"], *settings["over"]],
    _compute,
)
