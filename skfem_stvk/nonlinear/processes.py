"""Work in several processes: each that crashes takes nothing else with it, and all end with the one that started them."""

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

from ..arguments import THREAD_LIMITS
from .outcome import ask_to_finish, finishing_steps, stop_if_asked

Task = TypeVar("Task")
Result = TypeVar("Result")

#: What is asked of the processes.
GO_ON, FINISH, END = 0, 1, 2
#: Seconds between looks at what happened.
PAUSE = 0.1
#: What a process does with its tasks.
_work: Callable[[Any], Any] | None = None


class Crashed:
    """The result of a task whose process ended at once: memory ran out, it was killed, or a library crashed."""


def in_processes(
    work: Callable[[Task], Result], waiting: deque[Task], jobs: int, each: int
) -> Iterator[tuple[Task, Result | Crashed]]:
    """Tasks as they are done, with their results, in so many processes on so many threads each.

    The caller may append tasks to `waiting` between two results. `work` goes to each process once, and must be one that `pickle`
    takes; what it raises is raised here. After Ctrl-C no task is begun, those that run end after the step that they are in, and
    KeyboardInterrupt is raised when all of them have been handed back; at once after a second one.
    """
    context = multiprocessing.get_context("spawn")
    asked = context.Value("i", GO_ON, lock=False)
    interrupted = False
    idle: list[ProcessPoolExecutor] = [_process(context, asked, work) for _ in range(jobs)]
    running: dict[Future[Result], tuple[ProcessPoolExecutor, Task]] = {}
    with finishing_steps():
        try:
            while running or (waiting and not interrupted):
                while waiting and idle and not interrupted:
                    process, task = idle.pop(), waiting.popleft()
                    with _starting(each):
                        running[process.submit(_do, task)] = process, task
                for future in wait(running, PAUSE, FIRST_COMPLETED).done:
                    process, task = running.pop(future)
                    result: Result | Crashed
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        process.shutdown()
                        process, result = _process(context, asked, work), Crashed()
                    idle.append(process)
                    yield task, result
                try:
                    stop_if_asked()
                except KeyboardInterrupt:
                    interrupted, asked.value = True, FINISH
            if interrupted:
                raise KeyboardInterrupt
        except BaseException:
            asked.value = END
            raise
        finally:
            for process in [*idle, *(process for process, _ in running.values())]:
                process.shutdown()


def is_started_for_work() -> bool:
    """Whether this process was started by another one, which imports the program anew: it is not to start processes itself."""
    return multiprocessing.parent_process() is not None


def _process(context: Any, asked: Any, work: Callable[[Any], Any]) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, context, initializer=_begin, initargs=(asked, work))


@contextmanager
def _starting(each: int) -> Iterator[None]:
    """Processes that start within have so many threads, and leave Ctrl-C to this one."""
    before = {name: os.environ.get(name) for name in THREAD_LIMITS}
    masks = hasattr(signal, "pthread_sigmask")  # not on Windows
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]) if masks else set()
    try:
        os.environ.update(dict.fromkeys(THREAD_LIMITS, str(each)))
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin(asked: Any, work: Callable[[Any], Any]) -> None:
    """Prepare a process: it knows its work, and ends with the one that started it."""
    global _work
    _work = work
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()


def _do(task: Any) -> Any:
    assert _work is not None
    return _work(task)


def _listen(asked: Any) -> None:
    """Do what is asked, until the process that asks is gone: a run that nobody waits for would be in the way of the next one."""
    parent = multiprocessing.parent_process()
    while parent is not None and parent.is_alive() and asked.value != END:
        if asked.value == FINISH:
            ask_to_finish()
        parent.join(PAUSE)
    os._exit(1)
