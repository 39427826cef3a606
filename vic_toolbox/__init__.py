"""Variable impedance control: model it, control it, learn it from demonstrations, carry it over.

Everything in the toolbox makes, uses or judges impedance gains, a stiffness matrix ``K`` and a damping
matrix ``B``. The parts, each a subpackage or module that is imported on first use:

====================  ====================================================================
``errors``            one family of errors; validation of arrays and numbers
``spatial``           poses, twists, wrenches, the pose error and its transport
``gains``             ``K`` and ``B``, their parametrisations and damping design
``recordings``        logs of pose, reference and wrench: readers, validation, conditioning
``models``            robot models on Pinocchio: M, C, G, J, operational-space terms
``estimation``        gains from recordings, with their uncertainty
``control``           the impedance law, the force law, nullspaces, experts
``tasks``             batched MuJoCo simulation, scenarios, Gymnasium environments
``learning``          policies, rewards, TRPO, AIRL, behaviour cloning, transfer
``experiments``       runs, evaluations, reports
====================  ====================================================================

>>> import vic_toolbox as vic
>>> arm = vic.models.load_robot("fanuc_lrmate200id7l")  # doctest: +SKIP
"""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

__version__ = "0.1.0"


def __getattr__(name: str) -> ModuleType:
    """Import a subpackage on first access, so that ``import vic_toolbox`` itself costs nothing."""
    if not name.startswith("_"):
        qualified = f"{__name__}.{name}"
        try:
            return importlib.import_module(qualified)
        except ModuleNotFoundError as error:
            if error.name != qualified:  # the part exists, one of its own dependencies does not
                raise
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__dir__())}")


def __dir__() -> list[str]:
    """Names of the parts, found by looking: a new part needs no entry here."""
    parts = (part.name for part in pkgutil.iter_modules(__path__))
    return ["__version__", *sorted(part for part in parts if not part.startswith("_"))]
