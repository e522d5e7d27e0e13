"""Work over processes of this machine: copies of this process, fresh processes, and one that answers questions.

Three ways, each for its own kind of work:

`parallel_map`
    The pieces of one computation. Each process begins as a copy of this one (fork), has all its data, and sends
    back the results of its pieces. Results are those of one process, to the last digit, so nothing random and nothing
    learnt from one piece for the next may be in a piece. Nested calls run where the outer piece runs.
`ProcessPool`, `run_tasks`
    Independent tasks, such as trials and batches. Processes start fresh (spawn) and load what they need themselves.
`QuestionProcess`, `answer_questions`
    A process that knows nothing but its questions, one JSON object a line.

    for result in parallel_map(lambda k: judge(series[k]), len(series)):
        ...

Runs that write the same file take turns by a lock on it. The system releases it when its holder ends, however it ends.
"""

from __future__ import annotations

import gc
import io
import json
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn, TypeVar

from enginediag_cli.errors import DataError, EngineDiagError, ExitCode, WorkerDiedError
from enginediag_cli.progress import listening

if TYPE_CHECKING:
    import subprocess
    from concurrent.futures import Future, ProcessPoolExecutor

    from enginediag_cli.config.files import Reading


Task = TypeVar("Task")
Result = TypeVar("Result")

CAN_FORK = sys.platform.startswith("linux")
"""Whether a process can begin as a copy: elsewhere system libraries do not survive it, or there is no such thing."""

PIECES_PER_PROCESS = 4
"""Pieces that `parallel_imap` waits for together, per process: with more of them one long piece keeps fewer processes
waiting."""

TASKS_PER_WORKER = 4
"""Tasks submitted to a pool at a time, per worker: enough that none waits, few enough that memory does not grow with
the number of tasks."""

MOST_DEATHS = 3
"""Times that a worker may be ended from outside before the run ends: what kills a worker kills the next one, too."""

THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

SET_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of Linux's prctl(2)."""

WATCH_S = 1.0
"""How often a process looks for its parent where the system sends no signal; costs microseconds."""


# Copies of this process


def _identity(result: Any) -> Any:
    return result


@dataclass(frozen=True)
class ProcessCodec:
    """Encoding of results that a copy of this process sends back.

    Parameters
    ----------
    pack, unpack
        `pack` makes of a result what is pickled; `unpack` makes the result of it in this process.
    shared
        Objects that both processes have. They come back as the very objects that they are here.
    """

    pack: Callable[[Any], Any] = _identity
    unpack: Callable[[Any], Any] = _identity
    shared: Sequence[object] = ()

    def dumps(self, results: dict[int, Any]) -> bytes:
        """Encode results by piece; raises what pickling raises."""
        text = io.BytesIO()
        _Pickler(text, self.shared).dump({k: r if isinstance(r, _Raised) else self.pack(r) for k, r in results.items()})
        return text.getvalue()

    def loads(self, text: bytes) -> dict[int, Any]:
        """Decode results by piece."""
        results = _Unpickler(text, self.shared).load()
        return {k: r if isinstance(r, _Raised) else self.unpack(r) for k, r in results.items()}


class _Pickler(pickle.Pickler):
    """Writes shared objects as their number."""

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


class _Raised:
    """The error of a piece."""

    def __init__(self, error: Exception):
        self.error = error


PLAIN_CODEC = ProcessCodec()


class _ProcessCount:
    """How many processes work, this one counted."""

    jobs: int = 1


@contextmanager
def use_processes(jobs: int) -> Iterator[None]:
    """Let this many processes share the pieces of all work inside the block."""
    before, _ProcessCount.jobs = _ProcessCount.jobs, jobs if CAN_FORK else 1
    try:
        yield
    finally:
        _ProcessCount.jobs = before


def process_count(pieces: int | None = None) -> int:
    """Number of processes in use; with `pieces`, how many of them would work on so many pieces."""
    return _ProcessCount.jobs if pieces is None else max(1, min(_ProcessCount.jobs, pieces))


def resident_MB() -> float:
    """Memory of this process, all of which a copy of it has tables for; 0 where the system does not report it."""
    try:
        with open("/proc/self/statm", "rb") as status:
            return int(status.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except (OSError, IndexError, ValueError):
        return 0.0


def parallel_map(work: Callable[[int], Result], pieces: int, codec: ProcessCodec = PLAIN_CODEC) -> list[Result]:
    """Compute the pieces of one computation over the processes in use.

    Parameters
    ----------
    work
        Function of the number of a piece.
    pieces
        Number of pieces.
    codec
        How results cross from process to process; plain pickling by default.

    Returns
    -------
    list
        work(0) … work(pieces − 1), in order.

    Raises
    ------
    WorkerDiedError
        A process was ended from outside.
    Exception
        The error of the first piece that raised one; TypeError for a result that cannot be pickled.
    """
    n = process_count(pieces)
    if n == 1:
        return [work(k) for k in range(pieces)]
    copies: dict[int, BinaryIO] = {}  # process → the pipe of its results
    results: list[Any] = [None] * pieces
    try:
        for first in range(1, n):
            process, pipe = _fork(work, range(first, pieces, n), codec)
            copies[process] = pipe
        with use_processes(1):
            _compute(work, range(0, pieces, n), results)
        for process, pipe in list(copies.items()):
            text = pipe.read()
            _, status = os.waitpid(process, 0)
            del copies[process]
            pipe.close()
            if status or not text:
                raise WorkerDiedError(
                    "a worker process was ended from outside, perhaps because memory ran out; use fewer --jobs"
                )
            for k, result in codec.loads(text).items():
                results[k] = result
    finally:
        _kill(copies)
    for result in results:
        if isinstance(result, _Raised):
            raise result.error
    return results


def parallel_imap(work: Callable[[int], Result], pieces: int) -> Iterator[Result]:
    """The results of `parallel_map` in order, as soon as some of them are there."""
    size = pieces_in_flight()
    for first in range(0, pieces, size):
        yield from parallel_map(partial(_shifted, work, first), min(size, pieces - first))


def pieces_in_flight() -> int:
    """Number of pieces that `parallel_imap` computes together: one where one process works."""
    return 1 if _ProcessCount.jobs == 1 else PIECES_PER_PROCESS * _ProcessCount.jobs


def _shifted(work: Callable[[int], Result], first: int, k: int) -> Result:
    return work(first + k)


def _compute(work: Callable[[int], Result], own: range, results: list[Any]) -> None:
    for k in own:
        try:
            results[k] = work(k)
        except Exception as error:  # raised in the order of the pieces, whichever process computed them
            results[k] = _Raised(error)
            return


def _fork(work: Callable[[int], Any], own: range, codec: ProcessCodec) -> tuple[int, BinaryIO]:
    """Start a copy of this process on its own pieces; its number, and the pipe of its results."""
    read_end, write_end = os.pipe()
    with warnings.catch_warnings():
        # of threads that the copy does not have: it asks nothing of them
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process == 0:
        os.close(read_end)
        _run_copy(work, own, write_end, codec)
    os.close(write_end)
    return process, os.fdopen(read_end, "rb")


def _run_copy(work: Callable[[int], Any], own: range, write_end: int, codec: ProcessCodec) -> NoReturn:
    """What a copy does: it shows nothing, tidies up nothing, and ends when its results are sent."""
    code = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        gc.disable()  # what it shares with the first process would be copied for the sake of a little memory
        results: list[Any] = [None] * (own.stop if own else 0)
        with use_processes(1), listening(None):
            _compute(work, own, results)
            text = _encoded({k: results[k] for k in own}, codec)
        with os.fdopen(write_end, "wb") as pipe:
            pipe.write(text)
        code = 0
    finally:
        os._exit(code)


def _encoded(results: dict[int, Any], codec: ProcessCodec) -> bytes:
    """Encoded results; where one cannot be pickled, the error, which is a fault of whoever made the pieces."""
    try:
        return codec.dumps(results)
    except Exception as error:
        return pickle.dumps({min(results): _Raised(TypeError(f"a result cannot be pickled: {error}"))})


def _kill(copies: dict[int, BinaryIO]) -> None:
    """End copies whose results are no longer needed."""
    for process, pipe in copies.items():
        pipe.close()
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


# Fresh processes


class ProcessPool:
    """Fresh processes that live until `close`. Tasks in work when one of them dies are done again.

    Parameters
    ----------
    workers
        Number of processes; each uses one thread for linear algebra.
    advice
        What to do when workers keep dying, for the message of the error.
    """

    def __init__(self, workers: int, advice: str = "use fewer processes"):
        self.workers, self._advice = workers, advice
        self._pool: ProcessPoolExecutor | None = None
        self._deaths = 0

    def run(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[tuple[int, Result], None, None]:
        """Number, from 0, and result of each task as it is finished, in any order. Tasks are taken as there is room.

        `work`, tasks and results must be picklable. When the caller stops, tasks in work are finished and no other is
        begun. Raises WorkerDiedError, and what `work` raises.
        """
        from concurrent.futures import FIRST_COMPLETED, wait
        from concurrent.futures.process import BrokenProcessPool

        waiting = enumerate(tasks)
        again: list[tuple[int, Task]] = []
        running: dict[Future[Result], tuple[int, Task]] = {}
        try:
            while True:
                try:
                    self._submit(work, waiting, again, running)
                    if not running:
                        return
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                    for future in sorted(done, key=lambda f: running[f][0]):
                        result = future.result()
                        yield running.pop(future)[0], result
                except BrokenProcessPool:
                    again = sorted([*again, *running.values()], key=lambda numbered: numbered[0])
                    running.clear()
                    self._restart()
        finally:
            for future in running:
                future.cancel()

    def _submit(
        self,
        work: Callable[[Task], Result],
        waiting: Iterator[tuple[int, Task]],
        again: list[tuple[int, Task]],
        running: dict[Future[Result], tuple[int, Task]],
    ) -> None:
        while len(running) < TASKS_PER_WORKER * self.workers:
            if not again:
                again.extend(islice(waiting, 1))
            if not again:
                return
            with single_threaded():  # processes start when there is work for them
                future = self._executor().submit(work, again[0][1])  # a broken pool refuses it, and it stays in `again`
            running[future] = again.pop(0)

    def _executor(self) -> ProcessPoolExecutor:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        from enginediag_cli.config.files import READING

        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self.workers, get_context("spawn"), initializer=_start_worker, initargs=(READING,)
            )
        return self._pool

    def _restart(self) -> None:
        self._deaths += 1
        if self._deaths >= MOST_DEATHS:
            raise WorkerDiedError(
                f"a worker process was ended from outside {self._deaths} times, perhaps because memory ran out; "
                f"{self._advice}"
            ) from None
        self.close()

    def close(self) -> None:
        """End the processes when they have finished their tasks."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def run_tasks(
    work: Callable[[Task], Result], tasks: Iterable[Task], processes: int
) -> Generator[tuple[Task, Result], None, None]:
    """Each task with its result as it is finished, over at most so many processes. Raises as `ProcessPool.run`."""
    tasks = tuple(tasks)
    pool = ProcessPool(max(1, min(processes, len(tasks))))
    try:
        for number, result in pool.run(work, tasks):
            yield tasks[number], result
    finally:
        pool.close()


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes started inside use one thread each for linear algebra: more would only hinder each other."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _start_worker(reading: Reading) -> None:
    """First act of a worker: it may read what its parent may read. Ctrl-C reaches every process of a terminal, and only
    the first one acts on it; a killed parent, which can end nobody any more, takes its workers with it."""
    from multiprocessing import parent_process

    from enginediag_cli.config.files import READING

    READING.allow_outside = reading.allow_outside
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None and parent.pid is not None:
        end_with_parent(parent.pid)


# A process that answers questions


class QuestionProcess:
    """A process of its own that runs a module, which calls `answer_questions`. It is started with the first question,
    and again when it has died."""

    def __init__(self, module: str):
        self._module = module
        self._process: subprocess.Popen[str] | None = None

    def ask(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """The answer; `{"error": why}` when there is none."""
        process = self._started()
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(json.dumps(question) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.close()
            return {"error": f"the process of {self._module} ended without an answer"}
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process.wait()
            self._process = None

    def _started(self) -> subprocess.Popen[str]:
        import subprocess

        if self._process is None or self._process.poll() is not None:
            command = [sys.executable, "-m", self._module, str(os.getpid())]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self._process


def answer_questions(answer: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
    """Answer questions on standard input, one JSON object a line, until it ends. The process ends at once with the
    process whose number is the first argument, if there is one. The answer to a question that fails is `error` and why.
    """
    if len(sys.argv) > 1:
        end_with_parent(int(sys.argv[1]))
    for line in sys.stdin:
        try:
            found = answer(json.loads(line))
        except EngineDiagError as error:
            found = {"error": str(error)}
        except Exception as error:  # whoever asks counts it, and goes on
            found = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(json.dumps(found) + "\n")
        sys.stdout.flush()


# Processes that end with the one that started them, even when that is killed and can end nothing any more


def end_with_parent(parent: int) -> None:
    """Have this process killed when its parent, process `parent`, is gone.

    To be called from the process's first thread, by one whose parent's first thread started it: Linux sends the signal
    when that thread ends. Elsewhere a thread looks whether the parent is still there.
    """
    if not _death_signal_set():
        threading.Thread(target=_watch_parent, args=(parent,), name="parent watch", daemon=True).start()
    if _orphaned(parent):  # the parent died before the signal was set
        os._exit(1)


def _death_signal_set() -> bool:
    if not sys.platform.startswith("linux"):
        return False
    import ctypes

    try:
        return ctypes.CDLL(None, use_errno=True).prctl(SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0) == 0
    except (OSError, AttributeError):  # a C library without it
        return False


def _watch_parent(parent: int) -> None:
    while not _orphaned(parent):
        time.sleep(WATCH_S)
    os._exit(1)


def _orphaned(parent: int) -> bool:
    """Whether the parent is gone. A POSIX system hands orphans to another parent; Windows keeps the number."""
    if os.name == "posix":
        return os.getppid() != parent
    from multiprocessing import parent_process

    started_by = parent_process()
    return started_by is not None and not started_by.is_alive()


OPENING = b"process "
"""How a lock file begins once it was used; a file that begins otherwise is something else and is left alone."""

RETRY_S = 0.2
"""Pause between attempts: short beside any run, long beside what an attempt costs."""

SHOWN_BYTES = 300
"""Of a lock file that are read: it holds one short line."""


class LockedError(EngineDiagError):
    """Another run holds the lock; the same command may succeed later (EX_TEMPFAIL of sysexits.h)."""

    exit_code = ExitCode.LOCKED


@contextmanager
def lock_file(path: str, command: str, wait_s: float = 0.0) -> Iterator[None]:
    """Hold the lock of a file inside the block. The file is made where there is none, and stays.

    Parameters
    ----------
    path
        Lock file.
    command
        Name of the command that holds the lock, written into the file for whoever waits.
    wait_s
        How long to wait for another holder [s].

    Raises
    ------
    LockedError
        Another run still holds the lock after `wait_s`.
    DataError
        The file is something else or cannot be opened, or the system has no file locks.
    """
    try:
        import fcntl
    except ImportError:
        raise DataError("--lock: this system has no file locks") from None
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise DataError(f"--lock {path}: cannot be opened: {error.strerror}") from None
    try:
        until = time.monotonic() + wait_s
        text = os.pread(handle, SHOWN_BYTES, 0)
        if text and not text.startswith(OPENING):
            raise DataError(f"--lock {path}: the file exists and is no lock file; name another one")
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if not isinstance(error, BlockingIOError):
                    raise DataError(f"--lock {path}: cannot be locked: {error.strerror}") from None
            if time.monotonic() >= until:
                raise LockedError(f"--lock {path}: {_holder(handle)} holds the lock; nothing was done, try again later")
            time.sleep(min(RETRY_S, max(until - time.monotonic(), 0.0)))
        since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        with suppress(OSError):  # a disk without room can be locked all the same
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"process {os.getpid()}, enginediag {command}, since {since}\n".encode(), 0)
        yield
    finally:
        os.close(handle)


def try_lock(handle: int) -> bool:
    """Lock an open file until it is closed, without waiting; whether it was possible."""
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):  # held by another, or a file system that has no locks
        return False
    return True


def _holder(handle: int) -> str:
    """Description of the run that holds the lock, from the file."""
    return os.pread(handle, SHOWN_BYTES, 0).decode("utf-8", "replace").split("\n")[0] or "another run"
