"""How far an interval reaches, written once."""

from __future__ import annotations

NORMAL_95 = 1.959964
"""Standard errors on either side of the mean that hold 95 % of a normal law: the quantile of 0.975, Φ⁻¹(0.975) =
1.959963984…, to seven digits. 95 % because that is what engineers quote."""
