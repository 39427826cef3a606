"""Impedance stability: a verdict, a margin and a witness."""

from __future__ import annotations

from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

__all__ = ["Certificate", "CounterExample", "Verdict"]
