"""NASA nine-coefficient polynomials of the species of air and of lean combustion products.

cp/Ru = a1 T^-2 + a2 T^-1 + a3 + a4 T + a5 T^2 + a6 T^3 + a7 T^4, on 200–1000 K and 1000–6000 K.
Source: B. J. McBride, M. J. Zehe, S. Gordon, "NASA Glenn Coefficients for Calculating Thermodynamic
Properties of Individual Species", NASA/TP-2002-211556 (2002).
"""

from __future__ import annotations

import numpy as np

UNIVERSAL_GAS_CONSTANT = 8.314510  # J/(mol K), the value the coefficients were made with
T_BREAK = 1000.0  # K

MOLAR_MASS = {"N2": 28.0134e-3, "O2": 31.9988e-3, "Ar": 39.948e-3, "CO2": 44.0095e-3, "H2O": 18.01528e-3}  # kg/mol

DRY_AIR_MOLE_FRACTION = {"N2": 0.78084, "O2": 0.209476, "Ar": 0.009365, "CO2": 0.000319}  # same report

LOW = {
    "N2": (
        2.210371497e4,
        -3.818461820e2,
        6.082738360,
        -8.530914410e-3,
        1.384646189e-5,
        -9.625793620e-9,
        2.519705809e-12,
    ),
    "O2": (
        -3.425563420e4,
        4.847000970e2,
        1.119010961,
        4.293889240e-3,
        -6.836300520e-7,
        -2.023372700e-9,
        1.039040018e-12,
    ),
    "Ar": (0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 0.0),
    "CO2": (
        4.943650540e4,
        -6.264116010e2,
        5.301725240,
        2.503813816e-3,
        -2.127308728e-7,
        -7.689988780e-10,
        2.849677801e-13,
    ),
    "H2O": (
        -3.947960830e4,
        5.755731020e2,
        9.317826530e-1,
        7.222712860e-3,
        -7.342557370e-6,
        4.955043490e-9,
        -1.336933246e-12,
    ),
}
"""a1 … a7 on 200–1000 K, from the report above."""
HIGH = {
    "N2": (
        5.877124060e5,
        -2.239249073e3,
        6.066949220,
        -6.139685500e-4,
        1.491806679e-7,
        -1.923105485e-11,
        1.061954386e-15,
    ),
    "O2": (
        -1.037939022e6,
        2.344830282e3,
        1.819732036,
        1.267847582e-3,
        -2.188067988e-7,
        2.053719572e-11,
        -8.193467050e-16,
    ),
    "Ar": (
        2.010538475e1,
        -5.992661070e-2,
        2.500069401,
        -3.992141160e-8,
        1.205272140e-11,
        -1.819015576e-15,
        1.078576636e-19,
    ),
    "CO2": (
        1.176962419e5,
        -1.788791477e3,
        8.291523190,
        -9.223156780e-5,
        4.863676880e-9,
        -1.891053312e-12,
        6.330036590e-16,
    ),
    "H2O": (
        1.034972096e6,
        -2.412698562e3,
        4.646110780,
        2.291998307e-3,
        -6.836830480e-7,
        9.426468930e-11,
        -4.822380530e-15,
    ),
}
"""a1 … a7 on 1000–6000 K, from the report above."""


def molar_heat_capacity(species: str, temperature_K: np.ndarray) -> np.ndarray:
    """cp of one species [J/(mol K)] at temperatures (N,) [K]; below 200 K the lower range is continued."""
    T = np.asarray(temperature_K, dtype=float)
    powers = np.stack([T**k for k in range(-2, 5)])
    low, high = (np.asarray(table[species]) @ powers for table in (LOW, HIGH))
    return UNIVERSAL_GAS_CONSTANT * np.where(T < T_BREAK, low, high)
