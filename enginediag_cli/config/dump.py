"""Writes values as YAML that this program and readers of YAML 1.1 understand alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from enginediag_cli.config.yaml12 import Loader


class Dumper(yaml.SafeDumper):
    """Quotes every text that YAML 1.1 or 1.2 would read as something else: `no`, `1e5`, `0o14`."""


for _resolvers in Loader.yaml_implicit_resolvers.values():
    for _tag, _pattern in _resolvers:
        Dumper.add_implicit_resolver(_tag, _pattern, None)


def dump(values: Mapping[str, Any], width: int = 110) -> str:
    """YAML text of plain values, keys in their order, lists of scalars on one line.

    Floats have the shortest digits that give the same float back. The text is loaded by `load_document`.
    """
    return str(
        yaml.dump(
            dict(values), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=width, default_flow_style=None
        )
    )
