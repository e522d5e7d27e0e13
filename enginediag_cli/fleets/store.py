"""The store: a folder of condensed recordings, each under the key of its content and making.

A file appears under its name when it is whole, or not at all, and is never changed: runs that are killed lose what they
had in work, and runs at the same time write the same bytes under the same name. Nothing else has to be kept: which
recordings are known is told by the names of the files.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.condensed_file import Condensed, CondensedReader, CondensedWriter
from enginediag_cli.recordings.write import binary_output

RECORDINGS, NOMINALS = "recordings", "nominals"


class Store:
    """The store in `folder`, which is made when something is written."""

    def __init__(self, folder: str | Path):
        self.folder = Path(folder)

    def path(self, key: str) -> Path:
        """Where the recording of this key is, or would be."""
        return self.folder / RECORDINGS / key[:2] / f"{key}.npz"

    def find(self, key: str) -> Condensed | None:
        """What is known of a recording; None where it is not, or not whole."""
        path = self.path(key)
        if not path.exists():
            return None
        try:
            with CondensedReader(str(path)) as reader:
                return reader.condensed
        except DataError:
            return None

    @contextmanager
    def writing(self, key: str) -> Iterator[CondensedWriter]:
        """A writer of this key's file, which is there once the block has ended well. Raises OSError."""
        path = self.path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        with binary_output(path) as stream:
            writer = CondensedWriter(stream)
            try:
                yield writer
            finally:
                writer.leave()

    def keys(self) -> Iterator[str]:
        """Of all recordings that are there, in order."""
        yield from (path.stem for path in sorted((self.folder / RECORDINGS).glob("*/*.npz")))

    def partial(self) -> Iterator[Path]:
        """Files that a run is writing, or was when it was killed."""
        yield from sorted(self.folder.glob(f"{RECORDINGS}/*/.*.part"))
        yield from sorted(self.folder.glob(f"{NOMINALS}/.*"))

    def nominal(self, key: str) -> Path:
        """Where the common model of this key is, or would be."""
        return self.folder / NOMINALS / f"{key}.yaml"


@contextmanager
def opened_store(folder: str | Path | None) -> Iterator[Store]:
    """The store in a folder; with None one that is removed in the end."""
    if folder is not None:
        yield Store(os.path.abspath(folder))
        return
    with TemporaryDirectory(prefix="enginediag-fleet-") as temporary:
        yield Store(temporary)
