"""All families by the name under which a study asks for them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from enginediag_cli.methods.families.base import ResidualFamily
from enginediag_cli.methods.families.estimation import ParameterEstimation
from enginediag_cli.methods.families.extended_kalman import ExtendedKalman
from enginediag_cli.methods.families.local import LocalApproach
from enginediag_cli.methods.families.parity import PredictionError
from enginediag_cli.methods.families.pca import PrincipalComponents
from enginediag_cli.methods.families.structured import StructuredParity
from enginediag_cli.methods.families.unscented_kalman import UnscentedKalman

FAMILIES: dict[str, Callable[[], ResidualFamily]] = {
    "parity": PredictionError,
    "parity_records": partial(PredictionError, reduction="records"),
    "parity_filtered": StructuredParity,
    "extended_kalman": ExtendedKalman,
    "unscented_kalman": UnscentedKalman,
    "pca_raw": partial(PrincipalComponents, data="raw"),
    "pca_corrected": partial(PrincipalComponents, data="corrected"),
    "estimation": ParameterEstimation,
    "local": LocalApproach,
}
