"""Where windows stand along an axis: at the number of their flight where flights are numbered, else one after the
other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from enginediag_cli.presentation.charts.model import Axis
from enginediag_cli.presentation.charts.rows import Row


@dataclass(frozen=True)
class Order:
    """`x` of each of `names`, which may be flights or windows."""

    names: Sequence[str]
    x: Sequence[float]
    axis: Axis

    def of(self, name: str) -> float | None:
        """Where a flight stands; None where it is not among them."""
        return next((x for known, x in zip(self.names, self.x, strict=True) if known == name), None)

    def at(self, number: float) -> float | None:
        """Where the so manieth stands, counted from 1."""
        k = round(number) - 1 if number == number else -1
        return self.x[k] if 0 <= k < len(self.x) else None


def order_of(rows: Sequence[Row]) -> Order:
    """The order of rows, one for each window."""
    flights = [row.text("flight") for row in rows]
    numbers = [_number(flight) for flight in flights]
    rising = all(b is not None and a is not None and a < b for a, b in pairwise(numbers))
    if numbers and all(n is not None for n in numbers) and rising:
        return Order(flights, [n for n in numbers if n is not None], Axis("flight"))
    named = bool(flights) and all(flights) and len(set(flights)) == len(flights)
    label = "flight, in the order given" if named else "window, in the order given"
    return Order(flights, [float(k) for k in range(1, len(rows) + 1)], Axis(label))


def _number(text: str) -> float | None:
    try:
        return float(int(text))
    except ValueError:
        return None
