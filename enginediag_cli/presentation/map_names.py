"""Places and drivers of the map in a few words: `reynolds_index` is the "inlet Reynolds index".

What drivers are in full is told in `physics.drivers`.
"""

from __future__ import annotations

from enginediag_cli.presentation.names import in_words

SHORT = {
    "constant": "no driver (constant)",
    "mach": "Mach number",
    "power": "power T4/T2",
    "reynolds_index": "inlet Reynolds index",
    "turbine_reynolds_index": "turbine Reynolds index",
    "compressor_pressure": "compressor exit pressure",
}
"""Where the name with spaces for underscores would not do."""

LOGARITHMS = {"ln RNI": "1 in standard air at sea level", "ln(p0/p_ISA)": "1 at sea level"}
"""Units of drivers that are logarithms, and what the quantity itself is counted in."""


def driver_in_words(name: str) -> str:
    """A driver's name as an engineer says it; a recorded column, which has its unit in its name, stays as it is."""
    if name in SHORT:
        return SHORT[name]
    if name.endswith("nozzle"):
        return f"{in_words(name)} pressure ratio"
    known = ("ambient_pressure", "inlet_temperature", "bypass_ratio", "humidity")
    return name.replace("_", " ") if name in known or name.startswith("corrected_") else name


def group_in_words(group: str) -> list[str]:
    """The members of a group of drivers, "a = b" by name."""
    return [driver_in_words(name) for name in group.split(" = ")]


def location_words(name: str) -> str:
    """A name of the map without article: "T3 sensor", "HPC isentropic efficiency", "customer bleed at booster"."""
    if name.startswith("sensor."):
        return f"{name.split('.')[1]} sensor"
    if "@" in name:
        from enginediag_cli.physics.registry import term

        lever, _, site = name.partition("@")
        title = term(lever).TITLE
        return title[0].lower() + title[1:] + ("" if site == "ambient" else f" at {in_words(site)}")
    return in_words(name)
