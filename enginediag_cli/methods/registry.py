"""Every method by its name, with its choices as they are when nobody makes others; a new one is one line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.methods.base import Method
from enginediag_cli.methods.families.filters import ExtendedKalman, UnscentedKalman
from enginediag_cli.methods.families.local import LocalApproach, ParameterEstimation
from enginediag_cli.methods.families.parity import PredictionError, StructuredParity
from enginediag_cli.methods.families.pca import PrincipalComponents
from enginediag_cli.methods.isolating import Estimation, Incremental, MinMax, Posterior, Sensitivity

METHODS: dict[str, Method] = {
    "posterior": Posterior(),
    "incremental": Incremental(),
    "sensitivity": Sensitivity(),
    "minmax": MinMax(),
    "estimation": Estimation(),
    "parity": PredictionError(),
    "parity_records": PredictionError(reduction="records"),
    "parity_filtered": StructuredParity(),
    "extended_kalman": ExtendedKalman(),
    "unscented_kalman": UnscentedKalman(),
    "pca_raw": PrincipalComponents(data="raw"),
    "pca_corrected": PrincipalComponents(data="corrected"),
    "reestimation": ParameterEstimation(),
    "local": LocalApproach(),
}

FAMILIES = {
    name: name
    for name in (
        "parity",
        "parity_records",
        "parity_filtered",
        "extended_kalman",
        "unscented_kalman",
        "pca_raw",
        "pca_corrected",
    )
} | {"estimation": "reestimation", "local": "local"}
"""Under which name `type: family` of a study file asks for each: families had names of their own when they were
another kind of method, and study files keep their meaning."""

SECTIONS: dict[str, Section] = {name: method.section() for name, method in METHODS.items()} | {
    "family": Section(
        "family",
        "a family of residuals, with its own detection and isolation",
        (Field("family", "choice", "which", choices=tuple(FAMILIES)),),
    )
}
"""What a study file may ask for, by its `type`."""


def chosen_method(values: Mapping[str, Any]) -> Method:
    """The method that the values of one of SECTIONS ask for."""
    if values["type"] == "family":
        return METHODS[FAMILIES[values["family"]]]
    return METHODS[values["type"]].with_options(values)
