"""Numbers as people write them: as many digits as the uncertainty supports, with the unit behind."""

from __future__ import annotations

import math


def rounded(value: float, uncertainty: float | None = None, digits: int = 3) -> str:
    """`value` to the decimals at which `uncertainty` has its leading digits (one, or two for 10–19 of them).

    Without an uncertainty, to `digits` significant digits. No exponent between 1e-4 and 1e6.
    """
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("infinite" if value > 0 else "-infinite")
    if uncertainty is None or not math.isfinite(uncertainty) or uncertainty <= 0:
        return _without_exponent(f"{value:.{digits}g}")
    decimals = _decimals(uncertainty)
    # adding 0 turns "-0.0" into "0.0"
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"


def _decimals(uncertainty: float) -> int:
    """Decimals that show one leading digit of `uncertainty`, or two where the first is a 1."""
    magnitude = math.floor(math.log10(uncertainty))
    leading = round(uncertainty / 10.0**magnitude, 1)
    return -magnitude + (1 if leading < 2 else 0)


def _without_exponent(text: str) -> str:
    value = float(text)
    if "e" in text and (value == 0 or 1e-4 <= abs(value) < 1e6):
        return f"{value:.0f}" if abs(value) >= 1 else f"{value:f}".rstrip("0")
    return text


def with_unit(value: float, unit: str = "", uncertainty: float | None = None, digits: int = 3) -> str:
    """For instance "4.1 K ± 0.8 K", "2.0 % ± 0.3 %" or, without an uncertainty, "4.1 K"."""
    behind = f" {unit}" if unit else ""
    text = rounded(value, uncertainty, digits) + behind
    if uncertainty is None or not math.isfinite(uncertainty) or uncertainty <= 0:
        return text
    return f"{text} ± {rounded(uncertainty, uncertainty)}{behind}"


def interval(low: float, high: float, unit: str = "") -> str:
    """For instance "1.7 to 2.3 %"; a bound that is not known is said to be so."""
    behind = f" {unit}" if unit else ""
    if math.isfinite(low) and math.isfinite(high):
        half_width = (high - low) / 2
        return f"{rounded(low, half_width / 2)} to {rounded(high, half_width / 2)}{behind}"
    if math.isfinite(high):
        return f"at most {rounded(high)}{behind}"
    if math.isfinite(low):
        return f"at least {rounded(low)}{behind}"
    return "of unknown size"


def probability(value: float) -> str:
    """A probability to two decimals, without ever claiming 0 or 1."""
    if math.isnan(value):
        return "unknown"
    if value > 0.995:
        return "> 0.99"
    return "< 0.01" if value < 0.005 else f"{value:.2f}"


def p_value(value: float) -> str:
    """A p-value as people quote it: "0.03", "2e-05", and "< 1e-12" where the digits mean nothing."""
    if math.isnan(value):
        return "unknown"
    if value < 1e-12:
        return "< 1e-12"
    return f"{value:.1g}" if value < 0.1 else f"{value:.2f}"
