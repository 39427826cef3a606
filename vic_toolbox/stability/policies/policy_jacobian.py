r"""How a policy's wrench answers a small change of the state: effective stiffness and damping, and the rate of K.

With the wrench :math:`w = K(e,\dot e)\,e + B(e,\dot e)\,\dot e`, the arm does not feel K and B but

.. math::
    S = \frac{\partial w}{\partial e} = K + \sum_j \Bigl(\frac{\partial K}{\partial e_j} e
        + \frac{\partial B}{\partial e_j}\dot e\Bigr) u_j^T, \qquad
    E = \frac{\partial w}{\partial\dot e} = B + \sum_j \Bigl(\frac{\partial K}{\partial\dot e_j} e
        + \frac{\partial B}{\partial\dot e_j}\dot e\Bigr) u_j^T

(u_j: unit vectors). S may be negative, and is not symmetric in general, although every K is positive definite.
Along a motion the gains change by the *total* derivative
:math:`\dot K = \sum_j \partial K/\partial e_j\,\dot e_j + \partial K/\partial\dot e_j\,\ddot e_j`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.stability.policies.policy_loop import PolicyLoop


@dataclass(frozen=True, eq=False)
class PolicyJacobian:
    """The closed loop to first order about states (n, 2 d).

    Parameters
    ----------
    stiffness, damping : ndarray, shape (n, d, d)
        K and B themselves.
    effective_stiffness, effective_damping : ndarray, shape (n, d, d)
        S and E.
    stiffness_rate, damping_rate : ndarray, shape (n, d, d)
        K̇ and Ḃ along the motion.
    acceleration : ndarray, shape (n, d)
        ë.
    uncertainty : ndarray, shape (n, d, 2 d)
        What finite differences leave open in [S, E], entry by entry; large at a kink of the policy.
    """

    stiffness: Array
    damping: Array
    effective_stiffness: Array
    effective_damping: Array
    stiffness_rate: Array
    damping_rate: Array
    acceleration: Array
    uncertainty: Array

    @property
    def softest(self) -> Array:
        """Smallest eigenvalue of the symmetric part of S (n,): negative where a hand feels a negative spring."""
        return _smallest(self.effective_stiffness)

    @property
    def least_damping(self) -> Array:
        """Smallest eigenvalue of the symmetric part of E (n,): negative where motion is driven."""
        return _smallest(self.effective_damping)

    @property
    def curl(self) -> Array:
        """Largest entry of the curl ``∂w_i/∂e_j − ∂w_j/∂e_i`` (n,): zero where the spring has a potential."""
        skew = self.effective_stiffness - np.swapaxes(self.effective_stiffness, 1, 2)
        return np.asarray(np.abs(skew).max(axis=(1, 2)), dtype=np.float64)

    def system(self, mass: Array, *, index: int = 0) -> Array:
        """The matrix A (2 d, 2 d) of ``d/dt [δe, δė] = A [δe, δė]`` about one of the states."""
        d = len(mass)
        lower = -np.linalg.solve(
            mass, np.hstack([self.effective_stiffness[index], self.effective_damping[index]])
        )
        return np.asarray(np.vstack([np.hstack([np.zeros((d, d)), np.eye(d)]), lower]), dtype=np.float64)


def policy_jacobian(loop: PolicyLoop, states: Array, *, scale: Array | None) -> PolicyJacobian:
    """Differentiate a policy by central differences of fourth order.

    Parameters
    ----------
    loop : PolicyLoop
        Policy and mass.
    states : ndarray, shape (n, 2 d)
        Where.
    scale : ndarray, shape (2 d,), optional
        Over which distances in e and ė the gains change noticeably; steps are a small part of it (a larger one for
        a policy in single precision). None: the gradients are not needed, because all states are zero.

    Raises
    ------
    InputError
        As :meth:`PolicyLoop.__call__`.
    """
    n, d = len(states), loop.size
    here = loop(states)
    acceleration = np.matvec(np.linalg.inv(loop.mass), loop.load - here.pull(states))
    if scale is None:
        zero = np.zeros((n, d, d))
        return PolicyJacobian(
            here.stiffness,
            here.damping,
            here.stiffness,
            here.damping,
            zero,
            zero,
            acceleration,
            np.zeros((n, d, 2 * d)),
        )
    # constant answers hide in which precision they were computed; a state further off tells
    step = loop(np.concatenate([states, states + 0.1 * scale])).precision ** 0.2 * scale
    offsets = np.array([-2.0, -1.0, 1.0, 2.0])
    # (4, 2 d, n, 2 d): every state moved along every axis by four steps
    moved = states + offsets[:, None, None, None] * (np.diag(step)[:, None])
    there = loop(moved.reshape(-1, 2 * d))

    def gradient(values: Array, centre: Array) -> tuple[Array, Array]:
        far_left, left, right, far_right = values.reshape(4, 2 * d, *centre.shape)
        over = step.reshape(-1, *[1] * centre.ndim)
        near, far = (right - left) / (2 * over), (far_right - far_left) / (4 * over)
        bend = np.abs(right - 2 * centre + left) / over
        return (4 * near - far) / 3, np.maximum(np.abs(near - far), bend)

    dk, dk_open = gradient(there.stiffness, here.stiffness)
    db, db_open = gradient(there.damping, here.damping)
    df, df_open = gradient(there.force, here.force)
    e, rate = np.split(states, 2, axis=-1)
    sides = np.matvec(dk, e) + np.matvec(db, rate) + df  # (2 d, n, d)
    open_ = np.matvec(dk_open, np.abs(e)) + np.matvec(db_open, np.abs(rate)) + df_open
    whole = np.moveaxis(sides, 0, -1)  # (n, d, 2 d)
    speed = np.concatenate([rate, acceleration], axis=-1)
    return PolicyJacobian(
        stiffness=here.stiffness,
        damping=here.damping,
        effective_stiffness=here.stiffness + whole[..., :d],
        effective_damping=here.damping + whole[..., d:],
        stiffness_rate=np.einsum("jnab,nj->nab", dk, speed),
        damping_rate=np.einsum("jnab,nj->nab", db, speed),
        acceleration=acceleration,
        uncertainty=np.moveaxis(open_, 0, -1),
    )


def _smallest(matrices: Array) -> Array:
    symmetric = 0.5 * (matrices + np.swapaxes(matrices, 1, 2))
    return np.asarray(np.linalg.eigvalsh(symmetric)[:, 0], dtype=np.float64)
