"""Impedance gains: a stiffness matrix K and a damping matrix B, and every way to write and to design them.

The feedback wrench is ``F_fb = −K e − B ė`` with ``e = [p − p_d ; log(R R_dᵀ)]``. A new parametrisation is a
new module with one subclass of :class:`Parametrisation`, and one line in :data:`PARAMETRISATIONS`.
"""

from __future__ import annotations

from vic_toolbox.gains.cholesky import CholeskyStiffness
from vic_toolbox.gains.damping import double_diagonalisation, factor_damping
from vic_toolbox.gains.diagonal import DampingFactor, Diagonal, DiagonalStiffness
from vic_toolbox.gains.impedance import AXES, ImpedanceGains
from vic_toolbox.gains.parametrisation import Parametrisation
from vic_toolbox.gains.positive_definite import matrix_square_root, spd_matrix

PARAMETRISATIONS: dict[str, type[Parametrisation]] = {
    "diagonal-stiffness": DiagonalStiffness,
    "diagonal": Diagonal,
    "damping-factor": DampingFactor,
    "cholesky-stiffness": CholeskyStiffness,
}
"""Name of every parametrisation, for configuration files and commands."""

__all__ = [
    "AXES",
    "PARAMETRISATIONS",
    "CholeskyStiffness",
    "DampingFactor",
    "Diagonal",
    "DiagonalStiffness",
    "ImpedanceGains",
    "Parametrisation",
    "double_diagonalisation",
    "factor_damping",
    "matrix_square_root",
    "spd_matrix",
]
