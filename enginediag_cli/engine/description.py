"""An engine's description as text: the engine file and the map tables that it reads, so that an engine can travel
inside another file and be built where its own file is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from enginediag_cli.config.reading import MOST_TABLE_BYTES, file_inside, read_regular
from enginediag_cli.errors import ConfigError, Mark, Problem


@dataclass(frozen=True)
class EngineDescription:
    """`text` of the engine file `file`; `tables`: file of a map, as the engine file names it → its text."""

    file: str
    text: str
    tables: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(path: str | Path, declared: Mapping[str, Any]) -> EngineDescription:
        """The files of an engine that was built from `path` and declares `declared`. Raises ConfigError."""
        names = [c["table"]["file"] for c in declared.get("components", ()) if c.get("table")]
        tables = {name: _text(file_inside(path, name), MOST_TABLE_BYTES) for name in dict.fromkeys(names)}
        return EngineDescription(str(path), _text(path), tables)

    @property
    def sha256(self) -> str:
        """Of the engine file's bytes."""
        import hashlib

        return hashlib.sha256(self.text.encode()).hexdigest()

    def table(self, name: str, mark: Mark) -> str:
        """The text of a map table. Raises ConfigError at `mark` for one that does not travel along."""
        if name not in self.tables:
            raise ConfigError([Problem(mark, f"the map table {name} does not travel with this engine")])
        return self.tables[name]

    def differs_from(self, path: str | Path) -> bool:
        """Whether the engine file, or a table that it reads, says something else than this. Raises ConfigError for an
        engine file that cannot be read; a table that is not there says nothing."""
        if _text(path) != self.text:
            return True
        for name, text in self.tables.items():
            try:
                other = _text(file_inside(path, name), MOST_TABLE_BYTES)
            except ConfigError:
                continue
            if other != text:
                return True
        return False


def _text(path: str | Path, *most: int) -> str:
    """The text of a file, byte for byte, a byte order mark included. Raises ConfigError."""
    try:
        return read_regular(path, *most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError([Problem(Mark(str(path)), "the file is not UTF-8 text", "save it as UTF-8")]) from error
