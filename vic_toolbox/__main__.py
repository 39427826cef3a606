"""``python -m vic_toolbox`` is the ``vic`` command."""

from __future__ import annotations

import sys

from vic_toolbox.cli import main

sys.exit(main())
