"""Independent pieces of work side by side, in several processes of this machine where the command line asks for them.

Mathematics says what is independent and does not know how many work:

    for story in side_by_side(lambda k: judge(series[k]), len(series)):
        ...

Each process begins as a copy of this one, knows all that it knows, and hands back what its pieces came to; nothing else
that it does is seen. Results are those of one process, to the last digit, so whatever is random or is learnt from one
piece for the next has no place in a piece. Pieces of pieces are done where the piece is. What cannot be handed back as
it is, or is here already, `Handing` tells how to hand back.
"""

from __future__ import annotations

import gc
import io
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO, NoReturn, TypeVar

from enginediag_cli.errors import WorkerDiedError
from enginediag_cli.progress import listening

Result = TypeVar("Result")

CAN_COPY = sys.platform.startswith("linux")
"""Whether a process can begin as a copy: elsewhere system libraries do not survive it, or there is no such thing."""


AT_ONCE = 4
"""Pieces of each process that are waited for: with more of them one long piece keeps fewer processes waiting."""


def _itself(result: Any) -> Any:
    return result


@dataclass(frozen=True)
class Handing:
    """How a result comes from a copy: `pack` gives what is handed back, which `unpack` makes the result of here;
    `shared`: what both have, which comes back as the very object that it is here."""

    pack: Callable[[Any], Any] = _itself
    unpack: Callable[[Any], Any] = _itself
    shared: Sequence[object] = ()

    def told(self, found: dict[int, Any]) -> bytes:
        """Results on their way; raises what pickling raises."""
        text = io.BytesIO()
        _Pickler(text, self.shared).dump({k: r if isinstance(r, _Raised) else self.pack(r) for k, r in found.items()})
        return text.getvalue()

    def heard(self, text: bytes) -> dict[int, Any]:
        """What was told, here."""
        found = _Unpickler(text, self.shared).load()
        return {k: r if isinstance(r, _Raised) else self.unpack(r) for k, r in found.items()}


class _Pickler(pickle.Pickler):
    """Tells what is shared by its number."""

    def __init__(self, text: io.BytesIO, shared: Sequence[object]):
        super().__init__(text, protocol=pickle.HIGHEST_PROTOCOL)
        self._number = {id(o): k for k, o in enumerate(shared)}

    def persistent_id(self, o: object) -> int | None:
        return self._number.get(id(o))


class _Unpickler(pickle.Unpickler):
    def __init__(self, text: bytes, shared: Sequence[object]):
        super().__init__(io.BytesIO(text))
        self._shared = shared

    def persistent_load(self, number: int) -> object:
        return self._shared[number]


AS_IT_IS = Handing()


class _Current:
    """How many processes work, this one counted."""

    jobs: int = 1


@contextmanager
def working(jobs: int) -> Iterator[None]:
    """So many processes share the pieces of all work inside."""
    before, _Current.jobs = _Current.jobs, jobs if CAN_COPY else 1
    try:
        yield
    finally:
        _Current.jobs = before


def jobs() -> int:
    """How many processes work."""
    return _Current.jobs


def processes(pieces: int) -> int:
    """How many processes would work at so many pieces."""
    return max(1, min(_Current.jobs, pieces))


def resident_MB() -> float:
    """Memory that this process holds, all of which a copy of it has tables for; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", "rb") as told:
            return int(told.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError, ValueError):
        return 0.0


def side_by_side(work: Callable[[int], Result], pieces: int, handing: Handing = AS_IT_IS) -> list[Result]:
    """work(0) … work(pieces − 1), in order. What is handed back has to be picklable. Raises WorkerDiedError, and what
    the first piece raises that raises anything."""
    n = processes(pieces)
    if n == 1:
        return [work(k) for k in range(pieces)]
    copies: dict[int, BinaryIO] = {}  # process → where its results can be read
    found: list[Any] = [None] * pieces
    try:
        for first in range(1, n):
            process, results = _begin(work, range(first, pieces, n), handing)
            copies[process] = results
        with working(1):
            _done(work, range(0, pieces, n), found)
        for process, results in list(copies.items()):
            told = results.read()
            _, status = os.waitpid(process, 0)
            del copies[process]
            results.close()
            if status or not told:
                raise WorkerDiedError(
                    "a process that worked beside this one was ended from outside, perhaps because memory ran out; use "
                    "fewer --jobs"
                )
            for k, result in handing.heard(told).items():
                found[k] = result
    finally:
        _end(copies)
    for result in found:
        if isinstance(result, _Raised):
            raise result.error
    return found


def at_once() -> int:
    """Pieces that are waited for together: one where one process works."""
    return 1 if _Current.jobs == 1 else AT_ONCE * _Current.jobs


def in_turn(work: Callable[[int], Result], pieces: int) -> Iterator[Result]:
    """The same as soon as some of them are there."""
    for first in range(0, pieces, at_once()):
        yield from side_by_side(partial(_from, work, first), min(at_once(), pieces - first))


def _from(work: Callable[[int], Result], first: int, k: int) -> Result:
    return work(first + k)


class _Raised:
    """What a piece raised."""

    def __init__(self, error: Exception):
        self.error = error


def _done(work: Callable[[int], Result], mine: range, found: list[Any]) -> None:
    for k in mine:
        try:
            found[k] = work(k)
        except Exception as error:  # told in the order of the pieces, whoever did them
            found[k] = _Raised(error)
            return


def _begin(work: Callable[[int], Any], mine: range, handing: Handing) -> tuple[int, BinaryIO]:
    """A copy of this process that does these pieces; and where its results can be read."""
    results, theirs = os.pipe()
    with warnings.catch_warnings():
        # of threads that the copy does not have: it asks nothing of them
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process == 0:
        os.close(results)
        _as_copy(work, mine, theirs, handing)
    os.close(theirs)
    return process, os.fdopen(results, "rb")


def _as_copy(work: Callable[[int], Any], mine: range, theirs: int, handing: Handing) -> NoReturn:
    """The life of a copy: it shows nothing, tidies up nothing, and is gone when it has told its results."""
    code = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        gc.disable()  # what it shares with the first process would be copied for the sake of a little memory
        found: list[Any] = [None] * (mine.stop if mine else 0)
        with working(1), listening(None):
            _done(work, mine, found)
            text = _told({k: found[k] for k in mine}, handing)
        with os.fdopen(theirs, "wb") as pipe:
            pipe.write(text)
        code = 0
    finally:
        os._exit(code)


def _told(found: dict[int, Any], handing: Handing) -> bytes:
    """Results on their way; or that one of them cannot be handed back, which is a fault of whoever made the pieces."""
    try:
        return handing.told(found)
    except Exception as error:
        return pickle.dumps({min(found): _Raised(TypeError(f"a result cannot be handed back: {error}"))})


def _end(copies: dict[int, BinaryIO]) -> None:
    """Those whose results nobody wants any more."""
    for process, results in copies.items():
        results.close()
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
