"""Where cells are done: processes of this machine (joblib), or a cluster (Ray), behind one interface.

A process that dies, killed for its memory or by hand, takes only its own job with it: every place has a pool of one
process, so that it is known whose job is lost, and no other one suffers.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from vic_toolbox.errors import InputError, VicError, integer, require

J = TypeVar("J")

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "NUMBA_NUM_THREADS",
    ),
    "1",
)
"""Environment of a worker: processes fill the cores, and threads inside each of them would only get in the way."""

_LAST_PORT = 65535
_KNOCK = 5.0  # seconds for the head of a cluster to answer
_GRACE = 15.0  # seconds that workers have to save their work once they are asked to stop
_WATCH = 0.5  # seconds between two looks at whether the runner is still there


@dataclass(frozen=True)
class Lost:
    """The answer to a job whose worker died."""

    reason: str


class Engine(Protocol):
    """Does jobs side by side."""

    slots: int
    """How many at once."""
    label: str
    """What it is, in words."""

    def map(
        self, function: Callable[[J], Any], jobs: Iterator[J | None], *, stopped: Callable[[], bool]
    ) -> Generator[tuple[J, Any]]:
        """Call `function` on each job in some worker; yields (job, answer or :class:`Lost`) as they end.

        Parameters
        ----------
        function : callable
            Of an importable module; its argument and its answer travel between processes.
        jobs : iterator
            Asked for the next job whenever a place is free. None says that there is none until one of those under
            way has ended.
        stopped : callable
            Asked twice a second whether to stop.

        Raises
        ------
        KeyboardInterrupt
            It was stopped; jobs under way had a while to save what they can.
        """
        ...


class JoblibEngine:
    """Processes of this machine, one thread each, by joblib's loky.

    Parameters
    ----------
    slots : int
        Processes, 0 for as many as the machine has processors.
    """

    def __init__(self, slots: int = 0) -> None:
        require("learn", "joblib")
        self.slots = integer("jobs", slots, low=0) or _processors()
        self.label = f"{self.slots} process{'es' * (self.slots > 1)}"

    def map(
        self, function: Callable[[J], Any], jobs: Iterator[J | None], *, stopped: Callable[[], bool]
    ) -> Generator[tuple[J, Any]]:
        """See :class:`Engine`."""
        from joblib.externals.loky import FIRST_COMPLETED, wait
        from joblib.externals.loky.process_executor import BrokenProcessPool

        free = [_Place() for _ in range(self.slots)]
        everywhere = list(free)
        under_way: dict[Future[Any], tuple[_Place, J]] = {}
        try:
            while True:
                while free and (job := next(jobs, None)) is not None:
                    place = free.pop()
                    under_way[place.submit(function, job)] = place, job
                if not under_way:
                    return
                for future in wait(under_way, timeout=_WATCH, return_when=FIRST_COMPLETED).done:
                    place, job = under_way.pop(future)
                    try:
                        answer = future.result()
                    except BrokenProcessPool as error:
                        place.abandon()
                        answer = Lost(
                            f"its process was killed, by hand or for its memory ({_exit_code(error)})"
                        )
                    free.append(place)
                    yield job, answer
                if stopped():
                    for place in everywhere:
                        place.ask_to_stop()
                    wait(under_way, timeout=_GRACE)
                    raise KeyboardInterrupt
        finally:
            for place in everywhere:
                place.abandon()


class _Place:
    """Where one job at a time is done: a pool of one process, made when it is first needed."""

    def __init__(self) -> None:
        self._pool: Any = None
        self._stop: Any = None

    def submit(self, function: Callable[[J], Any], job: J) -> Future[Any]:
        if self._pool is None:
            from joblib.externals.loky import ProcessPoolExecutor
            from joblib.externals.loky.backend import get_context

            context = get_context("loky")
            self._stop = context.Event()
            self._pool = ProcessPoolExecutor(
                max_workers=1,
                context=context,
                initializer=_begin_worker,
                initargs=(os.getpid(), self._stop),
                env=ONE_THREAD,
            )
        return self._pool.submit(function, job)

    def ask_to_stop(self) -> None:
        if self._stop is not None:
            self._stop.set()

    def abandon(self) -> None:
        """End the process, if there is one, without waiting for its job."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, kill_workers=True)
            self._pool = self._stop = None


def _begin_worker(runner: int, stop: Any) -> None:
    """Prepare a worker: Ctrl-C is the runner's business, and a worker whose runner is gone ends too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        asked = False
        while os.getppid() == runner:
            if not asked and stop.wait(_WATCH):
                asked = True
                os.kill(os.getpid(), signal.SIGTERM)  # a learner saves its state, anything else just ends
            elif asked:
                time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class RayEngine:
    """Workers of a Ray cluster, one processor each.

    Parameters
    ----------
    address : str
        "auto" for the cluster of this machine (``ray start --head``), or ``HOST:PORT`` of its head.
    slots : int
        Jobs at once, 0 for as many as the cluster has processors.

    Raises
    ------
    DependencyError
        Ray is not installed.
    InputError
        No cluster there.
    """

    def __init__(self, address: str = "auto", slots: int = 0) -> None:
        require("cluster", "ray")
        import ray

        self._ray: Any = ray
        if address != "auto":
            _reach(address)
        if not ray.is_initialized():
            try:
                ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise _no_cluster(address, error) from error
        processors = int(ray.cluster_resources().get("CPU", 0))
        self.slots = integer("jobs", slots, low=0) or processors
        if processors < 1:
            raise InputError(f"the Ray cluster at {address!r} has no processors; start it with --num-cpus N.")
        self.label = f"{self.slots} workers of a Ray cluster"

    def map(
        self, function: Callable[[J], Any], jobs: Iterator[J | None], *, stopped: Callable[[], bool]
    ) -> Generator[tuple[J, Any]]:
        """See :class:`Engine`."""
        ray = self._ray
        remote = ray.remote(num_cpus=1, max_retries=0)(
            function
        )  # with one processor Ray sets OMP_NUM_THREADS=1
        under_way: dict[Any, J] = {}
        try:
            while True:
                while len(under_way) < self.slots and (job := next(jobs, None)) is not None:
                    under_way[remote.remote(job)] = job
                if not under_way:
                    return
                ended, _ = ray.wait(list(under_way), num_returns=1, timeout=_WATCH)
                for reference in ended:
                    yield under_way.pop(reference), self._answer(reference)
                if stopped():
                    raise KeyboardInterrupt
        finally:
            for reference in under_way:
                with contextlib.suppress(Exception):  # the cluster itself may be gone
                    ray.cancel(reference, force=True)

    def _answer(self, reference: Any) -> Any:
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference)
        except errors.RayTaskError as error:
            raise VicError(
                f"a worker of the cluster cannot do its job ({_first_line(error.cause)}); install vic-toolbox[learn] "
                "of this version on every machine of the cluster."
            ) from error
        except errors.RayError as error:
            return Lost(f"the worker that did it is gone ({type(error).__name__}: {_first_line(error)})")


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _exit_code(error: BaseException) -> str:
    """What loky says about the end of a worker, e.g. "SIGKILL(-9)"."""
    found = re.search(r"\{(.*?)\}", str(error))
    return found[1] if found else type(error).__name__


def _reach(address: str) -> None:
    """Knock at HOST:PORT: Ray itself would wait for minutes at an address where nothing listens."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > _LAST_PORT:
        raise InputError(f"the cluster is {address!r}; pass auto, or HOST:PORT of its head.")
    try:
        socket.create_connection((host, int(port)), timeout=_KNOCK).close()
    except OSError as error:
        raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> InputError:
    return InputError(
        f"no Ray cluster at {address!r} ({_first_line(error)}); start one with: ray start --head, and pass --cluster "
        "auto on that machine or --cluster HOST:PORT. (One that asks for a token needs RAY_AUTH_MODE=token, and its "
        "~/.ray/auth_token on this machine.)"
    )


def _first_line(error: object) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(". ") if lines else type(error).__name__
