"""Least squares over positive semidefinite matrices: Clarabel's cone program, CasADi's Cholesky program.

    minimise  ½ θᵀ P θ − qᵀ θ   such that every block of 21 entries of θ, written as a (6, 6) matrix, is ⪰ floor · I

The problem is convex; a block is the upper triangle of its matrix, column by column. Clarabel takes the cones as they
are. CasADi writes a block as ``L Lᵀ + floor · I``, which is not convex any more but has no other minima that a start
inside would meet, and hands it to IPOPT. Projecting an unconstrained fit onto the cone is no substitute: it ignores
how well each direction is known.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy import sparse

from vic_toolbox.errors import Array, VicError, require
from vic_toolbox.estimation.windows_full import symmetric_index

BLOCK = 21
"""Free entries of a symmetric (6, 6) matrix."""
RIDGE = 1e-11
"""Added to P, relative to its diagonal's mean: entries of which the data say nothing stay near zero."""


class FitError(VicError, RuntimeError):
    """A solver did not find the best gains."""


def clarabel_installed() -> bool:
    """Whether the optional solver is there."""
    try:
        require("lmi", "clarabel")
    except ImportError:
        return False
    return True


def solve_cones(p: Any, q: Array, *, solver: str, floor: float = 0.0, start: Array | None = None) -> Array:
    """Solve one problem.

    Parameters
    ----------
    p : ndarray or sparse matrix, shape (21 k, 21 k)
        Symmetric, positive semidefinite; entries of about the same size.
    q : ndarray, shape (21 k,)
    solver : str
        ``clarabel`` or ``casadi``.
    floor : float, optional
        Smallest eigenvalue allowed.
    start : ndarray, optional
        Where CasADi's solver starts; brought into the cone first.

    Raises
    ------
    DependencyError
        Clarabel is wanted and not installed.
    FitError
        The solver gave up.
    """
    matrix = sparse.csc_matrix(p)
    size = float(np.mean(matrix.diagonal()))
    if size <= 0:
        return _identity(len(q), floor)
    # scaled to unit curvature: both solvers' tolerances are absolute
    matrix = sparse.csc_matrix(matrix / size + RIDGE * sparse.eye(len(q)))
    matrix.sort_indices()  # casadi.DM aborts the process on unsorted indices
    solve = _clarabel if solver == "clarabel" else _casadi
    return solve(matrix, q / size, floor, start)


def _clarabel(p: sparse.csc_matrix, q: Array, floor: float, start: Array | None) -> Array:
    del start
    require("lmi", "clarabel")
    import clarabel as library  # pyright: ignore[reportMissingImports]

    clarabel: Any = library

    rows, columns = symmetric_index()
    scale = np.tile(np.where(rows == columns, 1.0, np.sqrt(2)), len(q) // BLOCK)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.triu(p)),
        -q,
        sparse.csc_matrix(sparse.diags(-scale)),
        -_identity(len(q), floor),
        [clarabel.PSDTriangleConeT(6)] * (len(q) // BLOCK),
        settings,
    ).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise FitError(
            f"Clarabel stopped with {solution.status}; try solver='casadi' or a coarser resolution."
        )
    return np.asarray(solution.x)


def _casadi(p: sparse.csc_matrix, q: Array, floor: float, start: Array | None) -> Array:

    program = _cholesky_program(_pattern(p), len(q))
    theta = _identity(len(q), 1.0) if start is None else start
    lower = np.concatenate([_cholesky_entries(block, floor) for block in theta.reshape(-1, BLOCK)])
    result = program(x0=lower, p=np.concatenate([p.data, q, [floor]]))
    status = program.stats()
    if not status["success"] and status["return_status"] != "Solved_To_Acceptable_Level":
        raise FitError(
            f"IPOPT stopped with {status['return_status']}; try solver='clarabel' or a coarser resolution."
        )
    blocks = np.asarray(result["x"]).reshape(-1, BLOCK)
    return np.concatenate([_from_cholesky(block, floor) for block in blocks])


def _pattern(p: Any) -> tuple[int, int, tuple[int, ...], tuple[int, ...]]:
    n = len(p.indptr) - 1
    return n, n, tuple(p.indptr.tolist()), tuple(p.indices.tolist())


@lru_cache(maxsize=4)
def _cholesky_program(pattern: tuple[int, int, tuple[int, ...], tuple[int, ...]], n: int) -> Any:
    """IPOPT's program over Cholesky entries, for one sparsity pattern of P; its values are parameters."""
    import casadi

    sparsity = casadi.Sparsity(pattern[0], pattern[1], list(pattern[2]), list(pattern[3]))
    values = casadi.MX.sym("values", sparsity.nnz())
    q, floor = casadi.MX.sym("q", n), casadi.MX.sym("floor")
    x = casadi.MX.sym("x", n)
    entry, smallest = casadi.SX.sym("l", BLOCK), casadi.SX.sym("floor")
    block = casadi.Function("block", [entry, smallest], [_symbolic_block(entry, smallest)])
    count = n // BLOCK
    theta = casadi.vec(block.map(count)(casadi.reshape(x, BLOCK, count), casadi.repmat(floor, 1, count)))
    matrix = casadi.MX(sparsity, values)
    objective = 0.5 * casadi.dot(theta, matrix @ theta) - casadi.dot(q, theta)
    options = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": 1e-9,
        "ipopt.acceptable_tol": 1e-8,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.max_iter": 5000,
    }
    parameters = casadi.vertcat(values, q, floor)
    return casadi.nlpsol("cholesky", "ipopt", {"x": x, "p": parameters, "f": objective}, options)


def _symbolic_block(entry: Any, floor: Any) -> Any:
    """Upper triangle, column by column, of L Lᵀ + floor I, where `entry` is Lᵀ in the same order."""
    import casadi

    upper = casadi.SX.zeros(6, 6)
    for k, (i, j) in enumerate(zip(*symmetric_index(), strict=True)):
        upper[int(i), int(j)] = entry[k]
    matrix = upper.T @ upper + floor * casadi.SX.eye(6)
    return casadi.vertcat(*[matrix[int(i), int(j)] for i, j in zip(*symmetric_index(), strict=True)])


def _matrix(block: Array) -> Array:
    rows, columns = symmetric_index()
    matrix = np.zeros((6, 6))
    matrix[rows, columns] = matrix[columns, rows] = block
    return matrix


def _cholesky_entries(block: Array, floor: float) -> Array:
    """Lᵀ of the nearest matrix well inside the cone."""
    values, vectors = np.linalg.eigh(_matrix(block))
    values = np.maximum(values - floor, 1e-2 * max(np.abs(values).max(), 1e-3))
    lower = np.linalg.cholesky((vectors * values) @ vectors.T)
    return lower.T[symmetric_index()]


def _from_cholesky(block: Array, floor: float) -> Array:
    upper = np.zeros((6, 6))
    upper[symmetric_index()] = block
    return (upper.T @ upper + floor * np.eye(6))[symmetric_index()]


def _identity(n: int, value: float) -> Array:
    """`value` · I in every block."""
    rows, columns = symmetric_index()
    return np.tile(np.where(rows == columns, value, 0.0), n // BLOCK)
