"""Declaration of the YAML file that describes flights to simulate."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section, Variants
from enginediag_cli.simulation.missions import airliner, ground, manoeuvres, snapshots, sweep
from enginediag_cli.simulation.noise_section import NOISE

MISSIONS = {
    "airliner": airliner,
    "snapshots": snapshots,
    "sweep": sweep,
    "ground": ground,
    "manoeuvres": manoeuvres,
}

FLIGHT_FILE = Section(
    "flight",
    "flights to simulate, and how noisily they are recorded",
    (
        Field("kind", "choice", "kind of file", "flight", choices=("flight",)),
        Field("description", "text", "what these flights are", ""),
        Field("source", "text", "where the numbers come from", ""),
        Field(
            "flights",
            "integer",
            "number of flights (of days on the ground) unless the command says otherwise",
            1,
            minimum=1,
        ),
        Field(
            "mission",
            "section",
            "what a flight looks like",
            section=Variants("mission", "kind of mission", {name: m.SECTION for name, m in MISSIONS.items()}),
        ),
        Field("constants", "number_map", "further inputs of the engine, each held at one value", {}),
        Field("noise", "section", "sensor noise unless the command says otherwise", {}, section=NOISE),
    ),
)
