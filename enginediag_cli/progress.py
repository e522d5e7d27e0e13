"""Progress of long work: its stage, how far it is, and the files it reads and writes.

Computations report it, and do not know who listens:

    with stage("re-estimating", total=len(windows)) as step:
        for number, window in enumerate(windows, start=1):
            ...
            step(number)

    for fold in each(folds, "refits", len(folds)):
        ...

    @stage("looking for what switches")
    def find_switch(...): ...

Nobody listens unless the command line installs a `Listener`; without one a call costs an attribute look-up. Stages may
be nested, and a stage of a generator may end after one that started later: each is independent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Stage:
    """A piece of work: what is done, how many steps it has (None: not known), and how many are done."""

    def __init__(self, what: str, total: int | None = None, done: int = 0):
        self.what, self.total, self.done = what, total, done


class Listener(Protocol):
    """Who shows progress."""

    def on_start(self, stage: Stage) -> None: ...

    def on_step(self, stage: Stage) -> None: ...

    def on_end(self, stage: Stage) -> None: ...

    def on_file(self, action: str, path: str) -> None: ...

    def wipe(self) -> None: ...


class _CurrentListener:
    """The one listener of this process."""

    listener: Listener | None = None


@contextmanager
def stage(what: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """A stage of work; what it gives is called with the number of steps done so far."""
    listener = _CurrentListener.listener
    if listener is None:
        yield _nothing
        return
    this = Stage(what, total)

    def step(done: int) -> None:
        this.done = done
        listener.on_step(this)

    listener.on_start(this)
    try:
        yield step
    finally:
        listener.on_end(this)


def each(
    items: Iterable[Item], what: str, total: int | None = None, size: Callable[[Item], int] | None = None
) -> Iterator[Item]:
    """Pass `items` through as a stage whose steps are the items that the caller has finished, or what `size` counts in
    each of them."""
    done = 0
    with stage(what, total) as step:
        for item in items:
            yield item
            done += 1 if size is None else size(item)
            step(done)


def touched(action: str, path: object) -> None:
    """Say that a file is "read" or "written"."""
    if _CurrentListener.listener is not None:
        _CurrentListener.listener.on_file(action, str(path))


def wipe() -> None:
    """Clear what is shown on the terminal, because something else is about to be written to it."""
    if _CurrentListener.listener is not None:
        _CurrentListener.listener.wipe()


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Report all stages inside to `listener`, if there is one."""
    before, _CurrentListener.listener = _CurrentListener.listener, listener
    try:
        yield
    finally:
        _CurrentListener.listener = before


def _nothing(done: int) -> None:
    """Nobody listens."""
