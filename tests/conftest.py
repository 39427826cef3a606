"""Settings that every test file shares."""

from __future__ import annotations

import signal

from hypothesis import settings

# No deadline: a busy machine is not a failure. The same examples each time: a red test stays red.
settings.register_profile("vic", deadline=None, derandomize=True)
settings.load_profile("vic")


def pytest_configure() -> None:
    """Take Ctrl-C as a terminal would have it: a job in the background starts with the signal ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
