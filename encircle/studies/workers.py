"""Where the runs of a study are executed: processes of this machine, or workers of a dask cluster.

Both functions take tasks and yield rows in the order in which they are finished, with a bounded
number of tasks at a time. The rows do not depend on who computed them, apart from the duration.
"""

import time
from collections.abc import Generator, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from typing import Any

from encircle.protocol.process.interrupts import check
from encircle.runner import process_pool as pool
from encircle.studies.tasks import Row, Task

TASKS_PER_WORKER = 3
CONNECT_S_MAX = 10.0
WORKERLESS_S_MAX = 60.0
POLL_S = 0.2
RETRIES = 3


class StudyFailed(Exception):
    """A study stopped before its end; finished runs are in its table."""


def run_task(task: Task) -> tuple[str, list[Row]]:
    """``running.run_task``, in a worker."""
    # Imported late: whoever hands tasks out needs none of the hunt.
    from encircle.studies import running

    return running.run_task(task)


def in_processes(tasks: Iterator[Task], code: str, workers: int) -> Generator[list[Row]]:
    """Run tasks on processes of this machine; yields the rows of each finished task.

    ``code``: digest of the sources that the processes must run. Raises ``StudyFailed`` if one
    runs others, because a source was changed in the meantime, or if one of them dies.
    """
    with closing(pool.in_processes(run_task, tasks, workers)) as done:
        try:
            for answer in done:
                yield _checked_rows(answer, code)
        except BrokenProcessPool:
            raise StudyFailed(
                "a worker process died; the same command goes on from here"
                ' (a script has to call it under `if __name__ == "__main__":`)'
            ) from None


def on_cluster(tasks: Iterator[Task], code: str, address: str) -> Generator[list[Row]]:
    """Run tasks on the workers of the dask scheduler at an address; yields rows as they finish.

    Tasks of a worker that dies are run by another. Raises ``StudyFailed`` if there is no
    scheduler, if there is no worker for ``WORKERLESS_S_MAX``, or if a worker runs sources other
    than those with the digest ``code``, this program's or a plug-in's.
    """
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_S_MAX, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyFailed(f"no dask scheduler at {address}: {error}") from None
    try:
        yield from _from_cluster(client, tasks, code)
    finally:
        client.close()


def _from_cluster(client: Any, tasks: Iterator[Task], code: str) -> Iterator[list[Row]]:
    waiting: set[Any] = set()
    for task in tasks:
        waiting.add(client.submit(run_task, task, pure=False, retries=RETRIES))
        threads = sum(client.nthreads().values())
        while len(waiting) >= TASKS_PER_WORKER * max(1, threads):
            done, waiting = _wait_for_some(client, waiting)
            yield from (_result(future, code) for future in done)
    while waiting:
        done, waiting = _wait_for_some(client, waiting)
        yield from (_result(future, code) for future in done)


def _wait_for_some(client: Any, waiting: set[Any]) -> tuple[set[Any], set[Any]]:
    """The finished tasks and the others, as soon as one task is finished."""
    from distributed import wait

    seen_s = time.monotonic()
    while True:
        check()
        if client.nthreads():
            seen_s = time.monotonic()
        elif time.monotonic() - seen_s > WORKERLESS_S_MAX:
            raise StudyFailed(f"the cluster has had no worker for {WORKERLESS_S_MAX:g} s")
        try:
            with client.as_current():
                done, rest = wait(waiting, timeout=POLL_S, return_when="FIRST_COMPLETED")
        except TimeoutError:
            continue
        return set(done), set(rest)


def _result(future: Any, code: str) -> list[Row]:
    try:
        answer = future.result()
    except Exception as error:
        raise StudyFailed(f"a worker of the cluster failed: {error}") from error
    return _checked_rows(answer, code)


def _checked_rows(answer: tuple[str, list[Row]], code: str) -> list[Row]:
    """A task's rows; raises ``StudyFailed`` if the worker runs other code than this process."""
    theirs, rows = answer
    if theirs != code:
        raise StudyFailed(
            f"a worker runs code {theirs}, this is {code}: have the same sources and versions of"
            " this program, of its plug-ins, numpy and scipy everywhere, and change none while a"
            " study runs; a cluster's workers must be started again after a change"
        )
    return list(rows)
