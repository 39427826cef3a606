"""What a table shows: which value of a result, which side is better, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from vic_toolbox.errors import FileError, one_of
from vic_toolbox.experiments.study.statistics import Estimate, mean_estimate, rate_estimate


@dataclass(frozen=True)
class Metric:
    """A quantity of a table."""

    name: str
    """How a study file calls it."""
    key: str
    """Its name in the values of a result."""
    label: str
    """In words, with the unit it is shown in."""
    factor: float
    """From the value to what is shown."""
    digits: int
    """Decimals that are shown."""
    paper_digits: int
    """Decimals, as shown, of the paper's numbers."""
    more_is_better: bool
    """Whether a larger value is better."""

    def value(self, values: Mapping[str, Any], *, where: str) -> float:
        """The value of one result.

        Raises
        ------
        FileError
            The result has no such number; `where` says which result it is.
        """
        found = values.get(self.key)
        if isinstance(found, bool) or not isinstance(found, int | float):
            raise FileError(
                f"the result of {where} has no number {self.key!r} (it is {found!r:.40}); a table of the metric "
                f"{self.name!r} needs it. Delete the folder of that cell and run the study again."
            )
        return float(found)

    def estimate(self, values: Sequence[float], *, episodes: int) -> Estimate:
        """Mean over the seeds with its interval; see :mod:`~vic_toolbox.experiments.study.statistics`."""
        if self.more_is_better:
            return rate_estimate(values, episodes=episodes)
        return mean_estimate(values, lowest=0.0)

    def reaches(self, value: float, target: float) -> bool:
        """Whether a value is at least as good as a printed number, rounded as that was."""
        shown = round(value * self.factor, self.paper_digits)
        wanted = round(target * self.factor, self.paper_digits)
        return shown >= wanted if self.more_is_better else shown <= wanted

    def better(self, one: float, other: float) -> bool:
        """Whether one value is better than another."""
        return one > other if self.more_is_better else one < other

    def text(self, value: float) -> str:
        """A value as tables show it."""
        return self._written(value, self.digits)

    def paper_text(self, value: float) -> str:
        """A number of the paper with the paper's decimals."""
        return self._written(value, self.paper_digits)

    def interval_text(self, low: float, high: float) -> str:
        """The ends of an interval."""
        return f"[{self.text(low)}, {self.text(high)}]"

    def _written(self, value: float, digits: int) -> str:
        text = f"{value * self.factor:.{digits}f}"
        return "100" if text == "100.0" and self.key == "success_rate" else text


METRICS: Mapping[str, Metric] = MappingProxyType({
    metric.name: metric
    for metric in (
        Metric("success", "success_rate", "success [%]", 100.0, 1, 1, True),
        Metric("difference", "relative_difference", "|score − expert's| / |expert's|", 1.0, 3, 2, False),
        Metric("deviation", "mean_deviation", "mean deviation from the human's path [mm]", 1.0, 1, 1, False),
        Metric("final deviation", "final_deviation", "deviation from the human at the end [mm]", 1.0, 1, 1, False),
    )
})  # fmt: skip
"""By name."""


def metric(name: str) -> Metric:
    """A metric by its name in the study file.

    Raises
    ------
    InputError
        Unknown name.
    """
    return METRICS[one_of("metric", name, METRICS)]
