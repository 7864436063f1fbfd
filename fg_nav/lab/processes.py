"""Tasks on processes of this machine, that end with whoever asked for them.

Workers are spawned, not forked: this process has threads (a progress bar), which do not survive a copy of it.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

T = TypeVar("T")


def run_tasks(tasks: Sequence[Callable[[], T]], workers: int) -> Iterator[tuple[int, T]]:
    """Run tasks and yield the number and the result of each when it is done; in this process if one worker is enough.

    At the first error, on Ctrl-C, and when the caller stops iterating, waiting tasks are dropped and the workers ended.
    """
    if workers == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            yield number, task()
        return
    with ProcessPoolExecutor(min(workers, len(tasks)), get_context("spawn"), _ignore_interrupt) as pool:
        try:
            numbers = {pool.submit(task): number for number, task in enumerate(tasks)}
            for done in as_completed(numbers):
                yield numbers[done], done.result()
        except BaseException:
            # end the running tasks and drop the others: the pool itself would wait for them
            at_work = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for process in at_work:
                process.terminate()
            raise


def _ignore_interrupt() -> None:
    """Ctrl-C goes to all processes of a terminal, and each worker would print a traceback: the parent ends them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
