"""Work in several processes. A crash of one process does not affect the others, and all end with their parent process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from ...arguments import THREAD_LIMITS
from .outcome import finishing_steps, request_finish, stop_if_requested

Task = TypeVar("Task")
Result = TypeVar("Result")

#: Requests to the processes.
CONTINUE, FINISH, END = 0, 1, 2
#: Polling interval [s].
PAUSE = 0.1
#: Function that a process applies to its tasks.
_work: Callable[[Any], Any] | None = None


class Crashed:
    """Result of a task whose process ended abnormally: memory ran out, the process was killed, or a library crashed."""


def in_processes(
    work: Callable[[Task], Result], waiting: deque[Task], jobs: int, threads: int
) -> Iterator[tuple[Task, Result | Crashed]]:
    """Yield tasks with their results as they finish, in `jobs` processes with `threads` threads each.

    The caller may append tasks to `waiting` between two results. `work` is sent to each process once, so `pickle` must accept it.
    An exception of `work` is raised again here.

    After Ctrl-C no new task begins, and running tasks end after their current step. KeyboardInterrupt is raised when all running
    tasks have been yielded. A second Ctrl-C raises it at once.
    """
    context = multiprocessing.get_context("spawn")
    request = context.Value("i", CONTINUE, lock=False)
    interrupted = False
    idle: list[ProcessPoolExecutor] = [_process(context, request, work) for _ in range(jobs)]
    running: dict[Future[Result], tuple[ProcessPoolExecutor, Task]] = {}
    with finishing_steps():
        try:
            while running or (waiting and not interrupted):
                while waiting and idle and not interrupted:
                    process, task = idle.pop(), waiting.popleft()
                    with _starting(threads):
                        running[process.submit(_do, task)] = process, task
                for future in wait(running, PAUSE, FIRST_COMPLETED).done:
                    process, task = running.pop(future)
                    result: Result | Crashed
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        process.shutdown()
                        process, result = _process(context, request, work), Crashed()
                    idle.append(process)
                    yield task, result
                try:
                    stop_if_requested()
                except KeyboardInterrupt:
                    interrupted, request.value = True, FINISH
            if interrupted:
                raise KeyboardInterrupt
        except BaseException:
            request.value = END
            raise
        finally:
            for process in [*idle, *(process for process, _ in running.values())]:
                process.shutdown()


def is_worker_process() -> bool:
    """Return whether this process was started by another one to work for it.

    Such a process imports the main program again, so it must not start processes itself.
    """
    return multiprocessing.parent_process() is not None


def _process(context: Any, request: Any, work: Callable[[Any], Any]) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, context, initializer=_begin, initargs=(request, work))


@contextmanager
def _starting(threads: int) -> Iterator[None]:
    """Start processes inside this context with `threads` threads each and with Ctrl-C blocked.

    Only the parent receives Ctrl-C.
    """
    before = {name: os.environ.get(name) for name in THREAD_LIMITS}
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]) if masks else set()
    try:
        os.environ.update(dict.fromkeys(THREAD_LIMITS, str(threads)))
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin(request: Any, work: Callable[[Any], Any]) -> None:
    """Prepare a process: set its work function, and start the thread that ends it together with its parent."""
    global _work
    _work = work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_listen, args=(request,), daemon=True).start()


def _do(task: Any) -> Any:
    assert _work is not None
    return _work(task)


def _listen(request: Any) -> None:
    """Carry out requests, and end this process when its parent has ended.

    A process without a parent would slow down the next run.
    """
    parent = multiprocessing.parent_process()
    while parent is not None and parent.is_alive() and request.value != END:
        if request.value == FINISH:
            request_finish()
        parent.join(PAUSE)
    os._exit(1)
