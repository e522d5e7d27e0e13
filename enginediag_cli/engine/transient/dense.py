"""States between the ends of steps, from how fast they change at the ends and at nodes within."""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.dual import Array

RADAU = np.array([(4.0 - 6.0**0.5) / 10.0, (4.0 + 6.0**0.5) / 10.0, 1.0])
"""Nodes of Radau's method of fifth order, of a step."""
_CUBIC = np.linalg.inv(np.append(0.0, RADAU)[:, None] ** np.arange(4))
"""Coefficients (degree, node) of the cubic through values at the beginning and at the nodes."""


def cubic(share: Array | float, h: Array, ends: tuple[Array, Array], slopes: tuple[Array, Array]) -> Array:
    """On the cubic through both ends of a step with their slopes, at a share of its length."""
    s = share
    value = ends[0] * ((1.0 + 2.0 * s) * (1.0 - s) ** 2) + ends[1] * (s**2 * (3.0 - 2.0 * s))
    return value + h * (slopes[0] * (s * (1.0 - s) ** 2) - slopes[1] * (s**2 * (1.0 - s)))


def quartic(share: Array, h: Array, begin: Array, slopes: Array) -> Array:
    """From `begin` (ns, n) along slopes (4, ns, n) at the beginning and at the nodes, at a share (n,) of the step. At
    its end that is the end of the method, whose weights integrate the cubic through the slopes exactly."""
    power = np.arange(1, 5)[:, None]
    rates = np.einsum("dj,jkn->dkn", _CUBIC, slopes)
    return np.asarray(begin + h * np.einsum("dkn,dn->kn", rates, share**power / power))


def slope(share: Array, slopes: Array) -> Array:
    """Of the same curve (ns, n)."""
    return np.asarray(np.einsum("dj,jkn,dn->kn", _CUBIC, slopes, share ** np.arange(4)[:, None]))
