"""The twin: one robot, drawn by a seed, to be guided by hand or to run policies."""

from __future__ import annotations

import functools

import numpy as np

from vic_toolbox.errors import integer
from vic_toolbox.twin.loop import Loop
from vic_toolbox.twin.parameters import Imperfections, Specimen
from vic_toolbox.twin.plant import links


class Twin:
    """A digital twin of the LR Mate with the cup gripper: what the model says, and what this robot is.

    Parameters
    ----------
    imperfections : Imperfections
        How far it may be from the model.
    seed : int
        Which robot; the same seed is the same robot.
    """

    def __init__(self, imperfections: Imperfections | None = None, *, seed: int = 0) -> None:
        self.imperfections = Imperfections() if imperfections is None else imperfections
        self.seed = integer("seed", seed, low=0)

    @functools.cached_property
    def specimen(self) -> Specimen:
        """The robot, as it is."""
        return self.imperfections.sample(links(), joints=6, seed=self.seed)

    def loop(self, count: int, *, rng: np.random.Generator, threads: int = 1) -> Loop:
        """Copies of this robot under its controller, to be reset and stepped."""
        return Loop(self.imperfections, self.specimen, count, rng=rng, threads=threads)
