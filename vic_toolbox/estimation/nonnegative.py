"""Strictly convex quadratic programs with x ≥ 0 on some unknowns: block principal pivoting.

    minimise ½ xᵀ H x − bᵀ x   such that   x_i ≥ 0 for i in `bounded`

A guess of the active set gives x on the others and multipliers y = H x − b on itself; unknowns of the wrong sign
change sides all at once, or only the last of them while that does not help (Portugal, Júdice and Vicente 1994). It
ends after a finite number of sparse factorisations, usually three or four, at the exact solution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from vic_toolbox.errors import Array
from vic_toolbox.estimation.cones import FitError

PATIENCE = 3
"""Exchanges of everything without progress before only one unknown changes sides."""
ITERATIONS = 500
ROUNDING = 1e-9
"""Of the solution and of the multipliers, relative to the largest of them."""


def nonnegative(h: sparse.csc_matrix, b: Array, bounded: NDArray[np.bool_]) -> Array:
    """Solve the program by pivoting.

    Parameters
    ----------
    h : sparse matrix, shape (n, n)
        Symmetric positive definite.
    b : ndarray, shape (n,)
    bounded : ndarray of bool, shape (n,)
        Which unknowns have to be non-negative.

    Raises
    ------
    FitError
        No end in sight: H is singular.
    """
    size = np.sqrt(np.maximum(h.diagonal(), 1e-300))
    scaled = sparse.csc_matrix(sparse.diags(1 / size) @ h @ sparse.diags(1 / size))
    right = b / size
    free = np.ones(len(b), dtype=bool)
    fewest, patience = len(b) + 1, PATIENCE
    for _ in range(ITERATIONS):
        x = np.zeros(len(b))
        inside = np.flatnonzero(free)
        if len(inside):
            x[inside] = splu(scaled[inside][:, inside].tocsc()).solve(right[inside])
        y = scaled @ x - right
        # what is smaller than the solution's rounding has no sign
        limit = [ROUNDING * max(float(np.abs(z).max(initial=0.0)), 1e-300) for z in (x, right)]
        wrong = bounded & np.where(free, x < -limit[0], y < -limit[1])
        count = int(wrong.sum())
        if count == 0:
            return np.where(bounded, np.maximum(x, 0.0), x) / size
        if count < fewest:
            fewest, patience = count, PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        free ^= wrong
    raise FitError("the non-negative fit found no end; ask for a coarser resolution (larger knots).")


def nonnegative_casadi(h: sparse.csc_matrix, b: Array, bounded: NDArray[np.bool_]) -> Array:
    """Solve the same program with CasADi's `qrqp`.

    Raises
    ------
    FitError
        The solver gave up.
    """
    import casadi

    size = np.sqrt(np.maximum(h.diagonal(), 1e-300))
    scaled = sparse.csc_matrix(sparse.diags(1 / size) @ h @ sparse.diags(1 / size))
    scaled.sort_indices()  # casadi.DM aborts the process on unsorted indices
    matrix = casadi.DM(scaled)
    options = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
    pattern = {"h": matrix.sparsity(), "a": casadi.Sparsity(0, len(b))}
    solver = casadi.conic("coefficients", "qrqp", pattern, options)
    largest = max(float(np.abs(b / size).max()), 1e-300)
    result = solver(h=matrix, g=-b / size / largest, lbx=np.where(bounded, 0.0, -np.inf), ubx=np.inf)
    if not solver.stats()["success"]:
        raise FitError("CasADi's qrqp stopped; choose solver='closed_form' or a coarser resolution.")
    return np.asarray(result["x"])[:, 0] * largest / size
