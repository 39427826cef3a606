"""Settings that every test file shares."""

from __future__ import annotations

from hypothesis import settings

# No deadline: a busy machine is not a failure. The same examples each time: a red test stays red.
settings.register_profile("vic", deadline=None, derandomize=True)
settings.load_profile("vic")
