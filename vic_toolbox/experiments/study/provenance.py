"""What a study's numbers come from: command, version, machine, time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from vic_toolbox.experiments.study.definition import Study, load, shipped
from vic_toolbox.experiments.study.folder import Result


@dataclass(frozen=True)
class Provenance:
    """How the results came about."""

    command: str
    versions: tuple[str, ...]
    """Of the package."""
    machines: tuple[str, ...]
    """Processor, cores and system, each once."""
    cells: int
    """Results."""
    hours: float
    """Time of one core that they took together [h]."""
    day: str
    """Day of the report, UTC."""

    @classmethod
    def of(cls, study: Study, results: Mapping[str, Result]) -> Provenance:
        """Of a study with these results."""
        found = list(results.values())
        return cls(
            command=_command(study),
            versions=tuple(dict.fromkeys(result.version for result in found)),
            machines=tuple(dict.fromkeys(result.machine for result in found)),
            cells=len(found),
            hours=sum(result.seconds for result in found) / 3600.0,
            day=datetime.now(UTC).date().isoformat(),
        )

    @property
    def text(self) -> str:
        """All of it in one sentence, but for the command."""
        spent = f"{self.hours:.1f} hours" if self.hours >= 1.0 else f"{60.0 * self.hours:.0f} minutes"
        version = " and ".join(self.versions) or "?"
        machine = "; ".join(self.machines) or "no machine yet"
        return (
            f"vic_toolbox {version}; {machine}; {self.cells} cells, {spent} of one core; report of {self.day}"
        )


def _command(study: Study) -> str:
    """What makes the study, or a part of a shipped one that has other seeds than its file."""
    if study.name not in shipped():
        return f"vic study run {study.name}.toml --out DIR"
    other = study.seeds != load(study.name).seeds
    seeds = f" --seeds {' '.join(map(str, study.seeds))}" if other else ""
    return f"vic study run studies/{study.name}.toml --out DIR{seeds}"
