"""Processes: other interpreters for this package, signals, locks between processes, a folder for scratch.

Signals that end a long job are an event that its loop checks: Python runs a handler between two lines of whatever the
main thread does, and an exception that rises in a weak reference's callback or in `__del__` is printed and forgotten.
Locks on files and folders end with the process that holds them, however that ends. A disk without locks keeps nobody
out.
The folder for scratch keeps what is made once and read again where neither installation nor home can be written. It is
read back as code (numba) or trusted (fonts): one that is somebody else's, a link, or that others may write is not used.
"""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.process import BaseProcess
from pathlib import Path
from subprocess import PIPE
from types import FrameType, ModuleType
from typing import Any, TypeVar

OBJECTS_BETWEEN_COLLECTIONS = 50_000  # What is loaded stays: looking through it again and again takes a tenth of a run.
OWNER_ONLY, OTHERS = 0o700, 0o077  # Modes of a folder.
OF_TERMINAL = {signal.SIGINT, signal.SIGHUP}  # To all processes of one.

T = TypeVar("T")


def collect_seldom() -> None:
    """Have the garbage collector of this process look for cycles less often."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)


def start_module(name: str, *arguments: str, pass_fds: Iterable[int] = ()) -> subprocess.Popen[bytes]:
    """Run a module in a process with pipes for its input and output; Ctrl-C of a terminal does not reach it.

    It imports from where this process does, not from the folder that the user is in; `pass_fds` stay open in it.
    """
    places = os.pathsep.join(place or os.getcwd() for place in sys.path)
    command, env = [sys.executable, "-P", "-m", name, *arguments], {**os.environ, "PYTHONPATH": places}
    return subprocess.Popen(command, stdin=PIPE, stdout=PIPE, pass_fds=tuple(pass_fds), start_new_session=True, env=env)


class Worker:
    """Another process, for one function call after another; it starts with the first, by `set_up(*arguments)`.

    Neither Ctrl-C nor the end of a terminal reaches it, it imports from where this process does, what it prints is an
    error output, and it ends with this process, however that ends. The main script is not imported in it.
    """

    def __init__(self, set_up: Callable[..., None], *arguments: object) -> None:
        self._set_up = partial(_begin_worker, set_up, *arguments)
        self._pool: ProcessPoolExecutor | None = None
        self._processes: dict[int, BaseProcess] = {}

    @property
    def pid(self) -> int | None:
        """Process id; None before it starts."""
        return next(iter(self._processes), None)

    def submit(self, function: Callable[..., T], *arguments: object) -> Future[T]:
        """Call a function behind those before; the future, or this, raises `BrokenProcessPool` once it has died."""
        if self._pool is not None:
            return self._pool.submit(function, *arguments)
        with _shield_children():
            self._pool = ProcessPoolExecutor(1, get_context("spawn"), self._set_up)
            future = self._pool.submit(function, *arguments)
        # The process alone reads the pipe of its calls: once it has died, a thread that writes one fails, and is not
        # stuck. Closed later, in two threads at once, the descriptor might be that of another file already.
        vars(self._pool)["_call_queue"]._reader.close()
        # An interpreter that ends waits for its pools, before `atexit`, and they for a process that may be stuck.
        self._processes = dict(self._pool._processes)
        vars(threading)["_register_atexit"](weakref.finalize(self, _kill, self._processes))
        return future

    def kill(self) -> None:
        """Kill the process, if there is one."""
        _kill(self._processes)


def _kill(processes: Mapping[int, BaseProcess]) -> None:
    for process in processes.values():
        process.kill()


@contextmanager
def _shield_children() -> Iterator[None]:
    """Start processes that signals of a terminal do not reach, and modules in the user's folder neither.

    Nor does what tracks resources of pools print that those of a process that was killed are freed.
    """
    wanted = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": "ignore:resource_tracker"}
    known = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    resource_tracker.ensure_running()  # it unblocks signals, so it starts before they are blocked
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, OF_TERMINAL)
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")  # a user's would run again
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        for name, value in known.items():
            del os.environ[name]
            os.environ.update({} if value is None else {name: value})
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin_worker(set_up: Callable[..., None], *arguments: object) -> None:
    for number in OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    os.dup2(2, 1)  # What it prints must not be among the lines that this program prints.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    collect_seldom()
    set_up(*arguments)


def _end_with_parent() -> None:
    """End this process once that which started it has ended: a pool's own waits for calls for ever."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextmanager
def catch_signals(*numbers: signal.Signals) -> Iterator[threading.Event]:
    """Yield an event that the first of these signals sets; a second one interrupts as usual.

    Outside the main thread no signal is caught, and the event is never set.
    """
    stop = threading.Event()
    before: dict[int, Any] = {}

    def set_stop(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, set_stop) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed; return False if its disk has no locks.

    Raises `BlockingIOError` where another has it.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def lock_folder(folder: Path) -> tuple[int, bool]:
    """Make a folder if missing and lock it; return its descriptor, to be closed, and False if there are no locks.

    Raises `BlockingIOError` where another has it, and `OSError` where there can be no such folder.
    """
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            locks = lock(descriptor)
            if os.path.samestat(os.fstat(descriptor), os.stat(folder)):
                return descriptor, locks
        except FileNotFoundError:  # removed by who had the lock
            pass
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


@cache
def find_scratch() -> Path | None:
    """Return the scratch folder `fg-nav-UID`, temporary and owned by the user; None if there is none that is safe."""
    try:
        folder = Path(tempfile.gettempdir()) / f"fg-nav-{os.geteuid()}"
        folder.mkdir(OWNER_ONLY, exist_ok=True)
        found = folder.lstat()  # of a link itself
    except OSError:  # nothing can be written at all
        return None
    ours = found.st_uid == os.geteuid() and not found.st_mode & OTHERS
    return folder if stat.S_ISDIR(found.st_mode) and ours else None
