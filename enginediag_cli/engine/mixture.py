"""Composition of a working gas, and what follows from it, computed once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.engine.dual import Dual, Value, value

if TYPE_CHECKING:
    from enginediag_cli.engine.gas import Gas


class Mixture:
    """Composition of a working gas; None is exactly zero and costs nothing. What follows from it is computed once."""

    __slots__ = ("_constant", "_dry", "_floats", "_plain", "duals", "far", "kind", "war")

    def __init__(self, far: Value | None = None, war: Value | None = None):
        self.far, self.war = far, war
        self.kind = 3 if war is not None else 2 if far is not None else 1
        """How many pseudo-species it needs: 1 dry air, 2 with fuel, 3 with water."""
        self.duals = tuple((row, x) for row, x in ((1, far), (2, war)) if isinstance(x, Dual))
        """Row of the pseudo-species, and its amount, of those that carry derivatives."""
        self._dry: Value | None = None
        self._plain: tuple[Any, Any, Any] | None = None
        self._floats: tuple[float, float, float] | None = None
        self._constant: tuple[Gas, Value] | None = None

    @property
    def plain(self) -> Mixture:
        """The same without derivatives."""
        return Mixture(*(None if x is None else value(x) for x in (self.far, self.war)))

    def per_dry_air(self) -> Value:
        """kg of gas per kg of dry air, 1 + far + war."""
        if self._dry is None:
            total: Value = 1.0
            for part in (self.far, self.war):
                if part is not None:
                    total = total + part
            self._dry = total
        return self._dry

    def values(self) -> tuple[Any, Any, Any]:
        """Plain fuel and water per dry air, 0 where there is none, and dry air per gas."""
        if self._plain is None:
            far, war = (0.0 if x is None else value(x) for x in (self.far, self.war))
            self._plain = far, war, 1.0 / value(self.per_dry_air())
        return self._plain

    def floats(self) -> tuple[float, float, float]:
        """The same of one point."""
        if self._floats is None:
            far, war, inverse = (np.asarray(x).item() for x in self.values())
            self._floats = far, war, inverse
        return self._floats

    def constant(self, gas: Gas) -> Value:
        """Gas constant R [J/(kg K)] with the pseudo-species of `gas`."""
        if self._constant is None or self._constant[0] is not gas:
            Ra, Rf, Rw = gas.R_species
            R: Value = Ra
            if self.far is not None:
                R = R + self.far * Rf
            if self.war is not None:
                R = R + self.war * Rw
            self._constant = gas, R if self.kind == 1 else R / self.per_dry_air()
        return self._constant[1]
