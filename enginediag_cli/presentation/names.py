"""Names of parameters in words: `hpc.efficiency` is the "HPC isentropic efficiency"."""

from __future__ import annotations

ABBREVIATIONS = frozenset(
    {"lpc", "ipc", "hpc", "lpt", "ipt", "hpt", "lp", "ip", "hp", "itt", "egt", "n1", "n2", "igv", "vsv"}
)
"""Component and shaft names that people write in capitals."""

PROPERTIES = {
    "efficiency": "isentropic efficiency",
    "flow_capacity": "flow capacity",
    "mechanical_efficiency": "mechanical efficiency",
    "combustion_efficiency": "combustion efficiency",
    "pressure_ratio": "pressure ratio",
    "pressure_loss": "pressure loss",
    "pressure_recovery": "pressure recovery",
    "discharge_coefficient": "discharge coefficient",
    "fuel_heating_value": "fuel heating value",
}
"""Last parts of a name that need other words than their own."""

EFFICIENCIES = {"burner": "combustion", "combustor": "combustion", "shaft": "mechanical"}
"""Components whose efficiency is not an isentropic one, by a word in their name."""

SENSOR_ERRORS = {"bias": "sensor bias", "scale": "sensor scale factor", "drift": "sensor drift"}


def in_words(name: str) -> str:
    """A parameter's dotted name as an engineer says it, without article.

    A part that is not known is spelt with spaces for underscores, so a new parameter needs no entry here.
    """
    parts = name.split(".")
    if parts[0] == "sensor" and len(parts) == 3:
        return f"{parts[1]} {SENSOR_ERRORS.get(parts[2], _spaced(parts[2]))}"
    if len(parts) == 1:
        return _spaced(name)
    last = PROPERTIES.get(parts[-1], _spaced(parts[-1]))
    if parts[-1] == "efficiency":
        kinds = [EFFICIENCIES[word] for word in parts[0].split("_") if word in EFFICIENCIES]
        last = f"{kinds[0]} efficiency" if kinds else last
    return " ".join([*(_spaced(part) for part in parts[:-1]), last])


def listed(items: list[str] | tuple[str, ...], last: str = "and") -> str:
    """ "a", "a and b", "a, b and c"."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"


def _spaced(part: str) -> str:
    return " ".join(word.upper() if word in ABBREVIATIONS else word for word in part.split("_"))
