"""Gains from recorded motion and wrench: stiffness and damping over time, and how sure they are.

:func:`fit_windows` is the sliding window of the paper with its constrained forms, :func:`fit_smooth` fits splines
to everything that was recorded. Both return a :class:`GainEstimate`; what the data do not determine is NaN in it,
by the rules of :mod:`vic_toolbox.estimation.observability`.
"""

from __future__ import annotations

from vic_toolbox.estimation.cones import FitError
from vic_toolbox.estimation.estimate import GainEstimate
from vic_toolbox.estimation.regressor import ImpedanceRegressor
from vic_toolbox.estimation.smooth import fit_smooth
from vic_toolbox.estimation.windows import fit_windows

__all__ = ["FitError", "GainEstimate", "ImpedanceRegressor", "fit_smooth", "fit_windows"]
