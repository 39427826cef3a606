"""The joint model: its unknowns, its derivatives and its CasADi program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from scipy import sparse

from vic_toolbox.errors import Array
from vic_toolbox.estimation.cones import FitError
from vic_toolbox.estimation.differences import ORDER
from vic_toolbox.estimation.penalised import Problem
from vic_toolbox.estimation.samples import LATENCY, Samples, root_mean_square
from vic_toolbox.estimation.splines import Basis, normal_equations


@dataclass(frozen=True, eq=False)
class Unknowns:
    """A point of the program, in SI units.

    Parameters
    ----------
    coefficients : ndarray, shape (m, 6, q)
        Of √K (tied, q = 1), or of K and B.
    factor : ndarray, shape (2,)
        d of translation and of rotation; ones where the damping is on its own.
    attractor : ndarray, shape (6,)
    bias : ndarray, shape (recordings, 6)
    delay : float
    """

    coefficients: Array
    factor: Array
    attractor: Array
    bias: Array
    delay: float


@dataclass(frozen=True, eq=False)
class JointModel:
    """What is unknown, and the data.

    Parameters
    ----------
    parts : list of Samples
    basis : Basis
    tied, attractor, bias, latency : bool
    """

    parts: list[Samples]
    basis: Basis
    tied: bool
    attractor: bool
    bias: bool
    latency: bool

    @property
    def splines(self) -> int:
        """Splines of an axis."""
        return 1 if self.tied else 2

    def gains(self, x: Unknowns, times: Array) -> tuple[Array, Array]:
        """K and B, (m, 6) each."""
        values = self.basis.evaluate(x.coefficients, times)
        if self.tied:
            return values[..., 0] ** 2, np.repeat(x.factor, 3) * values[..., 0]
        return values[..., 0], values[..., 1]

    def motion(self, x: Unknowns) -> list[Samples]:
        """The motion that belongs to the wrench: as it was one delay ago."""
        return [p.delayed(x.delay) for p in self.parts]

    def residuals(self, x: Unknowns) -> Array:
        """Measured less expected wrench, (n, 6)."""
        found = []
        for index, p in enumerate(self.motion(x)):
            stiffness, damping = self.gains(x, p.time)
            found.append(p.wrench - stiffness * (p.error - x.attractor) - damping * p.rate - x.bias[index])
        return np.concatenate(found)

    def constants(self) -> list[tuple[str, int]]:
        """Names of the unknown constants, and how many numbers each is."""
        sizes = {"damping_factor": 2 * self.tied, "attractor": 6 * self.attractor}
        sizes |= {"bias": 6 * len(self.parts) * self.bias, "latency": int(self.latency)}
        return [(name, size) for name, size in sizes.items() if size]

    # --- linearised at a point -----------------------------------------------------------------------------------

    def slopes(self, x: Unknowns, index: int, p: Samples) -> tuple[Array, Array]:
        """Derivatives of the expected wrench of one recording: by the splines (n, 6, q), by the constants (n, 6, r)."""
        stiffness, damping = self.gains(x, p.time)
        stretch = p.error - x.attractor
        n, six = len(p), np.arange(6)
        columns = []
        if self.tied:
            root = np.sqrt(stiffness)
            splines = (2 * root * stretch + np.repeat(x.factor, 3) * p.rate)[..., None]
            by_factor = np.zeros((n, 6, 2))
            by_factor[:, six, six // 3] = root * p.rate
            columns.append(by_factor)
        else:
            splines = np.stack([stretch, p.rate], axis=2)
        if self.attractor:
            by_attractor = np.zeros((n, 6, 6))
            by_attractor[:, six, six] = -stiffness
            columns.append(by_attractor)
        if self.bias:
            by_bias = np.zeros((n, 6, len(self.parts), 6))
            by_bias[:, six, index, six] = 1
            columns.append(by_bias.reshape(n, 6, -1))
        if self.latency:
            acceleration = np.gradient(p.rate, p.time, axis=0)
            columns.append(-(stiffness * p.rate + damping * acceleration)[..., None])
        return splines, np.concatenate(columns, axis=2)

    def linearised(self, x: Unknowns, noise: Array, weight: Array | None) -> tuple[list[Problem], Problem]:
        """The problem of every axis with the constants fixed (for REML), and that of all axes and constants."""
        axes, together, start = None, None, 0
        left = self.residuals(x)
        for index, p in enumerate(self.motion(x)):
            rows = slice(start, start + len(p))
            start += len(p)
            splines, constants = self.slopes(x, index, p)
            local = np.sum(splines * self.basis.evaluate(x.coefficients, p.time), axis=2)
            share = None if weight is None else weight[rows]
            y = left[rows] + local
            part = normal_equations(self.basis, p.time, x=splines, y=y, weight=share)
            whole = normal_equations(self.basis, p.time, x=splines, y=y, z=constants, weight=share)
            axes = part if axes is None else axes + part
            together = whole if together is None else together + whole
        assert axes is not None
        assert together is not None
        q = self.splines
        groups = np.arange(q)
        single = [Problem.of(axes, i, groups) for i in range(6)]
        share = 1 / noise**2
        width, m = together.gram.shape[1:3]
        gram, border = np.zeros((width, m, 6, q, 6, q)), np.zeros((m, 6, q, together.corner.shape[-1]))
        right = np.zeros((m, 6, q))
        for i in range(6):
            gram[:, :, i, :, i, :] = share[i] * together.gram[i]
            border[:, i], right[:, i] = share[i] * together.border[i], share[i] * together.right[i]
        return single, Problem(
            gram.reshape(width, m, 6 * q, 6 * q),
            right.reshape(m, 6 * q),
            float(share @ together.squares),
            border.reshape(m, 6 * q, -1),
            np.einsum("p,prs->rs", share, together.corner),
            share @ together.border_right,
            float(together.count.sum()),
            np.arange(6 * q),
        )

    # --- the program ---------------------------------------------------------------------------------------------

    def solve(self, x: Unknowns, logs: Array, noise: Array, weight: Array | None) -> Unknowns:
        """Minimise over everything, from `x`; log λ (6, q) and noise are given.

        Raises
        ------
        FitError
            IPOPT gave up.
        """
        m, q = self.basis.size, self.splines
        sizes = np.maximum(np.abs(x.coefficients).mean(axis=0), 1e-9 * np.abs(x.coefficients).max() + 1e-300)
        c = [casadi.MX.sym(f"c{i}", m, q) for i in range(6)]
        free = dict(self.constants())
        units = self._units(x)
        symbols = {name: casadi.MX.sym(name, size) for name, size in free.items()}
        scaled = {name: symbol * units[name] for name, symbol in symbols.items()}
        bands = sparse.csc_matrix(np.diff(np.eye(m), ORDER, axis=0)) if m > ORDER else None
        objective: Any = 0
        for i in range(6):
            coefficients = c[i] @ casadi.DM(np.diag(sizes[i]))
            if bands is not None:
                for k in range(q):
                    bend = casadi.DM(bands) @ coefficients[:, k]
                    objective += 0.5 * float(np.exp(logs[i, k])) / noise[i] ** 2 * casadi.sumsqr(bend)
            start = 0
            for index, p in enumerate(self.motion(x)):
                rows = slice(start, start + len(p))
                start += len(p)
                share = np.ones(len(p)) if weight is None else weight[rows, i]
                rest = self._symbolic_residual(x, scaled, coefficients, index, p, i)
                objective += 0.5 * casadi.sumsqr(np.sqrt(share) / noise[i] * rest)
        order = sum(len(p) for p in self.parts)
        variables = casadi.vertcat(*[casadi.vec(block) for block in c], *symbols.values())
        first = [np.ravel(x.coefficients[:, i] / sizes[i], order="F") for i in range(6)]
        low = [np.full(m * q, 1e-3 if self.tied else -np.inf)] * 6
        high = [np.full(m * q, np.inf)] * 6
        for name, size in free.items():
            first.append(np.ravel(self._value(x, name)) / units[name])
            bound = {"damping_factor": (0.0, np.inf), "latency": (-LATENCY - x.delay, LATENCY - x.delay)}
            one = np.array(bound.get(name, (-np.inf, np.inf)))
            low.append(np.full(size, one[0] / units[name] if name == "latency" else one[0]))
            high.append(np.full(size, one[1] / units[name] if name == "latency" else one[1]))
        options = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": 1e-8,
            "ipopt.max_iter": 300,
            # the objective is a mean over samples: what changes it by less than this changes no likelihood
            "ipopt.acceptable_obj_change_tol": 1e-8,
            "ipopt.acceptable_tol": 1e-2,
            "ipopt.acceptable_iter": 4,
        }
        solver = casadi.nlpsol("joint", "ipopt", {"x": variables, "f": objective / order}, options)
        begin, lower, upper = (np.concatenate(v) for v in (first, low, high))
        result = solver(x0=np.clip(begin, lower, upper), lbx=lower, ubx=upper)
        status = solver.stats()["return_status"]
        # without noise, rounding ends the descent before the tolerance does
        if status not in (
            "Solve_Succeeded",
            "Solved_To_Acceptable_Level",
            "Search_Direction_Becomes_Too_Small",
        ):
            remedy = "is there a spring at all? If so, ask for less at once, or for larger knots"
            raise FitError(f"IPOPT stopped with {status}: {remedy}.")
        return self._unpacked(x, np.asarray(result["x"])[:, 0], sizes, units)

    def _symbolic_residual(
        self, x: Unknowns, free: dict[str, Any], c: Any, index: int, p: Samples, i: int
    ) -> Any:
        """Residual of one axis of one recording; the motion is expanded in the change of the delay."""
        first, values = self.basis(p.time)
        rows = np.repeat(np.arange(len(p)), values.shape[1])
        columns = (first[:, None] + np.arange(values.shape[1])).ravel()
        design = sparse.csc_matrix((values.ravel(), (rows, columns)), shape=(len(p), self.basis.size))
        design.sort_indices()  # casadi.DM aborts the process on unsorted indices
        spline = casadi.DM(design) @ c
        e, v = casadi.DM(p.error[:, i]), casadi.DM(p.rate[:, i])
        if self.latency:
            acceleration = casadi.DM(np.gradient(p.rate[:, i], p.time))
            step = free["latency"]
            e, v = e - step * v + 0.5 * step**2 * acceleration, v - step * acceleration
        if self.attractor:
            e = e - free["attractor"][i]
        if self.tied:
            expected = spline**2 * e + free["damping_factor"][i // 3] * spline * v
        else:
            expected = spline[:, 0] * e + spline[:, 1] * v
        if self.bias:
            expected = expected + free["bias"][6 * index + i]
        return p.wrench[:, i] - expected

    def _units(self, x: Unknowns) -> dict[str, Array]:
        """About one of each constant."""
        e, w = (
            root_mean_square(np.concatenate([getattr(p, n) for p in self.parts])) for n in ("error", "wrench")
        )
        e, w = np.where(e > 0, e, 1.0), np.where(w > 0, w, 1.0)
        return {
            "damping_factor": np.where(x.factor > 0, x.factor, 1.0),
            "attractor": e,
            "bias": np.tile(w, len(self.parts)),
            "latency": np.array([0.01]),
        }

    def _value(self, x: Unknowns, name: str) -> Array:
        values = {
            "damping_factor": x.factor,
            "attractor": x.attractor,
            "bias": x.bias,
            "latency": np.zeros(1),
        }
        return values[name]

    def _unpacked(self, x: Unknowns, flat: Array, sizes: Array, units: dict[str, Array]) -> Unknowns:
        m, q = self.basis.size, self.splines
        blocks = flat[: 6 * m * q].reshape(6, q, m).transpose(2, 0, 1)
        found, start = {}, 6 * m * q
        for name, size in self.constants():
            found[name] = flat[start : start + size] * units[name]
            start += size
        return Unknowns(
            blocks * sizes,
            found.get("damping_factor", x.factor),
            found.get("attractor", x.attractor),
            found["bias"].reshape(-1, 6) if self.bias else x.bias,
            x.delay + float(found["latency"][0]) if self.latency else x.delay,
        )
