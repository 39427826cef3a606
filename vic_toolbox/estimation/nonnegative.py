"""Strictly convex quadratic programs with x ≥ 0 on some unknowns: projected Newton.

    minimise ½ xᵀ H x − bᵀ x   such that   x_i ≥ 0 for i in `bounded`

Unknowns at zero that the gradient holds there stay; Newton's step of the others is cut off at zero, and halved until
the objective falls (Bertsekas 1982). Once the right ones are held the step is exact; it takes five to fifty
sparse factorisations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from vic_toolbox.errors import Array
from vic_toolbox.estimation.cones import FitError

ITERATIONS = 500
ROUNDING = 1e-11
"""Gradient, relative to the largest entry of b, that has no sign."""
STAGNANT = 1e-14
"""Decrease of the objective, relative to it, that counts as none."""
SOLVED = 1e-5
"""How far a point that CasADi calls solved may be off, relative to its size and that of the gradient at zero."""
PATIENCE = 20
"""Steps in a row without a decrease after which rounding forbids a better point."""
ROUNDING = 1e-9
"""Of the solution and of the multipliers, relative to the largest of them."""


def nonnegative(h: sparse.csc_matrix, b: Array, bounded: NDArray[np.bool_]) -> Array:
    """Solve the program by projected Newton steps.

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

    def projected(point: Array) -> Array:
        return np.where(bounded, np.maximum(point, 0.0), point)

    def value(point: Array, slope: Array) -> float:
        return 0.5 * float(point @ (slope - right))

    x, gradient, idle = np.zeros(len(b)), -right, 0
    rounding = ROUNDING * float(np.abs(right).max(initial=0.0))
    for _ in range(ITERATIONS):
        free = np.flatnonzero(~(bounded & (x <= 0) & (gradient >= 0)))
        newton = np.zeros(len(b))
        if len(free):
            newton[free] = -splu(scaled[free][:, free].tocsc()).solve(gradient[free])
        before, step = value(x, gradient), 1.0
        while True:
            trial = projected(x + step * newton)
            slope = scaled @ trial - right
            if value(trial, slope) <= before + 1e-4 * float(gradient @ (trial - x)) or step < 1e-12:
                break
            step /= 2
        exact = step == 1 and not (bounded & (x + newton < 0)).any()
        x, gradient, after = trial, slope, value(trial, slope)
        idle = idle + 1 if before - after <= STAGNANT * abs(after) else 0
        if idle > PATIENCE or (exact and not (bounded & (x <= 0) & (gradient < -rounding)).any()):
            return x / size
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
    x = np.asarray(result["x"])[:, 0] * largest
    # it has been seen to call a point solved that is none
    gradient = scaled @ x - b / size
    wrong = np.where(bounded & (x <= SOLVED * np.abs(x).max()), np.minimum(gradient, 0.0), gradient)
    negative = np.where(bounded, np.minimum(x, 0.0), 0.0)
    off = max(
        float(np.abs(wrong).max()) / largest, float(np.abs(negative).max() / max(np.abs(x).max(), 1e-300))
    )
    if not solver.stats()["success"] or off > SOLVED:
        raise FitError("CasADi's qrqp stopped; choose solver='closed_form' or a coarser resolution.")
    return x / size
