"""All families by the name under which a study asks for them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from .base import ResidualFamily
from .estimation import ParameterEstimation
from .extended_kalman import ExtendedKalman
from .local import LocalApproach
from .parity import PredictionError
from .pca import PrincipalComponents
from .structured import StructuredParity
from .unscented_kalman import UnscentedKalman

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
