"""Missions: what the generated flights look like. One kind of mission per file.

Each module has `SECTION` (its YAML keys) and `generate(settings, count, engine, rng) -> dict of columns`
with `flight`, `time_s`, `phase`, `altitude_m`, `mach`, `dT_isa_K` and `power_fraction`. `SERIES`: whether records
follow each other in time; then there may be a column UNRECORDED, 1 at points that bend the course but are not recorded.
"""

UNRECORDED = "unrecorded"
