r"""How much of a rotational stiffness is left at a large angle: it depends on what is called the orientation error.

A torque :math:`k\,\varepsilon(\theta)` about the axis of an error of angle θ has the slope
:math:`k\,\varepsilon'(\theta)`:

=============== =========================  =========================  =====================================
error           :math:`\varepsilon`        slope                      found in
=============== =========================  =========================  =====================================
``"sine"``      :math:`\sin\theta`         :math:`\cos\theta`         cross products of axes, ``(R − Rᵀ)/2``
``"half-sine"`` :math:`2\sin(\theta/2)`    :math:`\cos(\theta/2)`     vector part of the quaternion, twice
``"log"``       :math:`\theta`             1                          the rotation vector: this toolbox
=============== =========================  =========================  =====================================

The first pushes away beyond 90 degrees; the second holds less and less up to 180.

References
----------
F. Caccavale, B. Siciliano, L. Villani, "The role of Euler parameters in robot control", Asian J. Control 1(1), 1999.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, array_within, one_of

SLOPES = {
    "sine": np.cos,
    "half-sine": lambda angle: np.cos(angle / 2),
    "log": np.ones_like,
}


def orientation_stiffness(angle: ArrayLike, *, error: Literal["sine", "half-sine", "log"] = "log") -> Array:
    """Return the effective rotational stiffness at an angle, over the nominal one.

    Parameters
    ----------
    angle : array_like
        Angle of the orientation error [rad], −π to π.
    error : {'sine', 'half-sine', 'log'}
        What the law calls the orientation error.

    Raises
    ------
    InputError
        Unknown error, or an angle beyond half a turn.

    Examples
    --------
    >>> import numpy as np
    >>> [float(orientation_stiffness(np.pi / 3, error=e).round(4)) for e in ("sine", "half-sine", "log")]
    [0.5, 0.866, 1.0]
    """
    theta = array_within("angle", angle, low=-np.pi, high=np.pi)
    return SLOPES[one_of("error", error, SLOPES)](theta)
