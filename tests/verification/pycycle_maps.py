"""Exports the component maps that come with pyCycle, for the comparison with its example engines.

    python tests/verification/pycycle_maps.py ../shared/data/pycycle_examples/maps.json

Run by a Python that has pyCycle (om-pycycle 4.4.0 with openmdao 3.41 and numpy < 2); the file stays out of the project.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any

COMPRESSORS = ("AXI5", "LPCMap", "HPCMap")
TURBINES = ("LPT2269", "HPTMap", "LPTMap")


def exported() -> dict[str, Any]:
    """First sheet of each stacked map, with its design point. Raises ImportError without pyCycle."""
    library = importlib.import_module("pycycle.api")
    found: dict[str, Any] = {}
    for name in COMPRESSORS:
        m = getattr(library, name)
        tables = {"WcMap_lbms": m.WcMap, "PRmap": m.PRmap, "effMap": m.effMap}
        found[name] = _plain(m.defaults, {"NcMap": m.NcMap, "Rline": m.RlineMap}, tables)
    for name in TURBINES:
        m = getattr(library, name)
        found[name] = _plain(m.defaults, {"NpMap": m.NpMap, "PRmap": m.PRmap}, {"WpMap": m.WpMap, "effMap": m.effMap})
    return found


def _plain(defaults: dict[str, float], axes: dict[str, Any], tables: dict[str, Any]) -> dict[str, Any]:
    lists = {k: [v[0].tolist()] for k, v in tables.items()} | {k: v.tolist() for k, v in axes.items()}
    return {"defaults": {k: float(v) for k, v in defaults.items()}, **lists}


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(exported()))
