"""Where an iteration's time goes: seconds inside chosen functions, measured without editing them.

Every reading is a pair: processor time of the process (user and system, all threads) and wall time. On a
quiet machine they are the same for one thread; on a busy one only the first is free of waiting for others.
"""

from __future__ import annotations

import functools
import time
from collections import defaultdict
from types import TracebackType
from typing import Any

import numpy as np


def now() -> np.ndarray:
    """Processor and wall clock [s], as (2,)."""
    return np.array([time.process_time(), time.perf_counter()])


class Stopwatch:
    """Adds up the time of watched callables, by part; a context manager that restores them at its end.

    A watched function inside another watched function is counted in both: parts nest, they are not exclusive.
    """

    def __init__(self) -> None:
        self._seconds: defaultdict[str, np.ndarray] = defaultdict(lambda: np.zeros(2))
        self._watched: list[tuple[Any, str, Any]] = []

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Replace `owner.name` by the same callable, timed under `part`."""
        function = getattr(owner, name)

        @functools.wraps(function)
        def timed(*arguments: Any, **keywords: Any) -> Any:
            start = now()
            try:
                return function(*arguments, **keywords)
            finally:
                self._seconds[part] += now() - start

        self._watched.append((owner, name, function))
        setattr(owner, name, timed)

    def add(self, part: str, seconds: np.ndarray) -> None:
        """Count seconds measured elsewhere."""
        self._seconds[part] += seconds

    def take(self) -> dict[str, np.ndarray]:
        """Processor and wall seconds (2,) by part since the last call."""
        taken = dict(self._seconds)
        self._seconds.clear()
        return taken

    def __enter__(self) -> Stopwatch:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for owner, name, function in reversed(self._watched):
            setattr(owner, name, function)
        self._watched.clear()
