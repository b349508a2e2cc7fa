"""Work for several processes of this machine, which are ended in order whatever happens.

A study and ``encircle reproduce`` both run many hunts this way. The workers are shielded from
Ctrl-C, which a terminal sends to them as well: what ends them is their parent, or its end.
"""

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from functools import partial
from multiprocessing import active_children, connection, get_context, parent_process
from typing import TypeVar

from encircle.protocol.process.interrupts import (
    check,
    leave_sigint_to_parent,
    sigint_blocked,
    signals_held,
)

TASKS_PER_WORKER = 3
LOOK_PERIOD_S = 0.1
SAFE_PATH = "PYTHONSAFEPATH"

Task = TypeVar("Task")
Done = TypeVar("Done")
Job = TypeVar("Job")


def in_processes(
    work: Callable[[Task], Done], tasks: Iterable[Task], workers: int
) -> Generator[Done]:
    """Do tasks on so many processes; yields what comes of them, in any order.

    ``BrokenProcessPool`` if a process dies. To be used while signals are held, and to be closed;
    what is under way when it is left is lost.
    """
    others = set(active_children())
    # Not forked: a forked copy of a process with threads, as Zenoh's, may hang.
    with _safe_path():
        pool = futures.ProcessPoolExecutor(workers, get_context("spawn"), _prepare)
    try:
        yield from _done(pool, work, tasks, workers)
    except BaseException:
        for worker in set(active_children()) - others:
            worker.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def in_order(
    work: Callable[[Job], Done],
    jobs: Sequence[Job],
    workers: int,
    chunk: int,
    tell: Callable[[int, int], None],
) -> list[Done]:
    """What comes of jobs, so many of them a task, in the order of the jobs.

    ``tell`` gets how many are done, and how many there are. ``Interrupted`` after Ctrl-C.
    """
    indices = range(len(jobs))
    tasks = ([(k, jobs[k]) for k in indices[at : at + chunk]] for at in indices[::chunk])
    results: dict[int, Done] = {}
    tell(0, len(jobs))
    with signals_held(), closing(in_processes(partial(_each, work), tasks, workers)) as finished:
        for done in finished:
            results |= done
            tell(len(results), len(jobs))
    return [results[index] for index in indices]


def _each(work: Callable[[Job], Done], jobs: Sequence[tuple[int, Job]]) -> dict[int, Done]:
    return {index: work(job) for index, job in jobs}


def _done(
    pool: futures.Executor, work: Callable[[Task], Done], tasks: Iterable[Task], workers: int
) -> Iterator[Done]:
    waiting: set[futures.Future[Done]] = set()
    for task in tasks:
        try:
            with sigint_blocked(), _safe_path():
                waiting.add(pool.submit(work, task))
        except OSError as error:
            # Python raises this for a process that is gone before it has begun.
            raise BrokenProcessPool(f"no process can be started: {error}") from error
        while len(waiting) >= TASKS_PER_WORKER * workers:
            done, waiting = _some(waiting)
            yield from (future.result() for future in done)
    while waiting:
        done, waiting = _some(waiting)
        yield from (future.result() for future in done)


@contextmanager
def _safe_path() -> Iterator[None]:
    """Interpreters that are started meanwhile find no modules in the working directory.

    A worker begins with Python's own modules, and a person's ``random.py`` is none of those.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


def _some(
    waiting: "set[futures.Future[Done]]",
) -> "tuple[set[futures.Future[Done]], set[futures.Future[Done]]]":
    check()
    done, rest = futures.wait(waiting, LOOK_PERIOD_S, futures.FIRST_COMPLETED)
    return done, rest


def _prepare() -> None:
    """In a new worker: leave Ctrl-C to the parent, and end when the parent does.

    What the work prints goes to standard error: the parent's output is the parent's.
    """
    sys.stdout = sys.stderr
    leave_sigint_to_parent()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(1)
