"""A study: many runs from one file, done by many processes, put together in tables.

::

    FILE.toml ─▶ definition ─▶ plan: cells and table entries ─▶ execution on an engine ─▶ folder ─▶ tables, report

A *cell* is data: a kind, settings, and the cells it needs. What it results in depends on nothing else, so that a cell
is done once, anywhere, and never again. A new kind is a module and a line in :data:`~.kinds.KINDS`.
"""
