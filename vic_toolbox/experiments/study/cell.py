"""The unit of a study: a computation that is described completely by data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from vic_toolbox.errors import FileError, InputError


@dataclass(frozen=True)
class Cell:
    """One computation of a study; its result is a pure function of its settings and of the cells that it needs."""

    kind: str
    """Key of :data:`~vic_toolbox.experiments.study.kinds.KINDS`, which says how it is done."""
    name: str
    """Its folder below ``DIR/cells``, with ``/`` between the parts; no cell lies inside another one."""
    settings: Mapping[str, Any] = field(hash=False)
    """All that its result depends on, as JSON values."""
    needs: tuple[str, ...] = ()
    """Names of the cells that have to be done before."""

    def __post_init__(self) -> None:
        parts = self.name.split("/")
        if not all(parts) or any(part.startswith(".") or "\\" in part or "\0" in part for part in parts):
            raise InputError(
                f"{self.name!r} cannot name a cell; use parts that are file names, with '/' between them."
            )
        object.__setattr__(self, "settings", json.loads(json.dumps(self.settings, allow_nan=False)))

    def to_json(self) -> dict[str, Any]:
        """The fields as JSON values."""
        return {
            "kind": self.kind,
            "name": self.name,
            "settings": self.settings,
            "needs": list(self.needs),
        }

    @classmethod
    def from_json(cls, value: Any, *, where: str) -> Self:
        """Rebuild a cell from :meth:`to_json`.

        Raises
        ------
        FileError
            The value does not describe a cell; `where` (the file) is named.
        """
        try:
            kind, name, settings, needs = (value[key] for key in ("kind", "name", "settings", "needs"))
            if not isinstance(kind, str) or not isinstance(name, str) or not isinstance(settings, dict):
                raise TypeError("kind and name are texts, settings a table")
            return cls(kind, name, settings, tuple(map(str, needs)))
        except (KeyError, TypeError, InputError) as error:
            raise FileError(f"{where} does not describe a cell ({error}); delete its folder.") from error


def digests(cells: Iterable[Cell]) -> dict[str, str]:
    """Fingerprint of each cell: of its kind, its settings, and the fingerprints of what it needs.

    Two cells of the same fingerprint have the same result.

    Parameters
    ----------
    cells : iterable of Cell
        Each of them after those that it needs.
    """
    found: dict[str, str] = {}
    for cell in cells:
        whole = [cell.kind, cell.settings, [[name, found[name]] for name in cell.needs]]
        text = json.dumps(whole, sort_keys=True, separators=(",", ":"))
        found[cell.name] = hashlib.sha256(text.encode()).hexdigest()[:16]
    return found
