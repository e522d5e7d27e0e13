"""Fleets: recordings of many engines, reduced to statistics, judged engine by engine and ranked.

It reads a fleet file (YAML) with the recordings that it names, keeps the statistics of each recording in a store, and
gives a `FleetFinding`: the engines by severity, those that are flagged at a false discovery rate, and what engines have
in common.

Open first: `fleet_file` (what the user states), `run` (from the file to the findings), `engine_judgement` (one engine),
`findings` (the results). `store` keeps statistics of recordings; `models` the nominal engine of each build; `margin`,
`maintenance` and `work_scope` say what deterioration costs and what maintenance restores.
"""
