"""A run on disk: a folder that says what was run, how it went, and what came out.

==========================  ==========================================================================
``config.json``             the complete configuration and the package's version
``metrics.jsonl``           one JSON object for each iteration
``checkpoint.safetensors``  state of an unfinished run, replaced as a whole every few iterations
``demonstrations.npz``      what the expert did
``policy.safetensors``      the policy; ``reward.safetensors`` the learned reward
``evaluation.json``         the latest evaluation; all of them under ``evaluations/<scenario>/``, sweeps
                            under ``evaluations/sweep-<name>/``
``figures/``                figures; ``report.html`` shows them all
==========================  ==========================================================================

A process may be killed at any moment: every file but ``metrics.jsonl`` is old or new, never a part, and the
lines of ``metrics.jsonl`` beyond the last checkpoint are cut off when the run is taken up again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import torch

import vic_toolbox
from vic_toolbox.errors import FileError
from vic_toolbox.experiments.claimed_folder import ClaimedFolder
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.files import read_json, write_atomically, write_json
from vic_toolbox.learning.checkpoints import load_tensors, save_tensors

FORMAT = "vic-run/2"


class RunFolder(ClaimedFolder):
    """The folder of one run; make it with :meth:`create` (to run) or :meth:`open` (to read).

    Attributes
    ----------
    path : Path
        The folder.
    kind : str
        "training" or "transfer".
    configuration : Mapping[str, Any]
        The nested values of ``config.json``.
    """

    marker = "config.json"
    content = "run"

    def __init__(self, path: Path, kind: str, configuration: Mapping[str, Any]):
        super().__init__(path)
        self.kind = kind
        self.configuration = configuration

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        kind: str,
        configuration: Mapping[str, Any],
        *,
        resume: bool = False,
    ) -> Self:
        """Begin a run in an empty or new folder, or with `resume` take up the run that is there.

        Use it as a context manager: it keeps other processes out of the folder.

        Raises
        ------
        FileError
            The folder holds something else, a run (without `resume`), a run with another configuration or
            version (the differing fields are named), is in use by another process, or cannot be written.
        """
        folder = cls(Path(path), kind, json.loads(json.dumps(configuration)))
        folder.claim()
        try:
            if (folder.path / "config.json").exists():
                folder._take_up(resume=resume)
            else:
                write_json(folder.path / "config.json", folder._identity())
        except BaseException:
            folder.close()
            raise
        return folder

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Self:
        """A run to read.

        Raises
        ------
        FileError
            No such folder, no run in it, or its ``config.json`` is damaged.
        """
        path = Path(path)
        if not path.is_dir():
            raise FileError(f"{path} is not a folder; pass the folder of a run, as given to --out.")
        if not (path / "config.json").is_file():
            raise FileError(
                f"{path} holds no run (no config.json); pass the folder of a run, as given to --out."
            )
        identity = _read_identity(path)
        return cls(path, identity["kind"], identity["configuration"])

    @property
    def complete(self) -> bool:
        """Whether the run ended with its report, which is its last file."""
        return (self.path / "report.html").exists()

    # --- iterations ---------------------------------------------------------------------------------------

    def append_metrics(self, metrics: Mapping[str, Any]) -> None:
        """Add one line to ``metrics.jsonl``."""
        self._append(json.dumps(metrics, allow_nan=False) + "\n")

    def _append(self, line: str, *, to_disk: bool = False) -> None:
        path = self.path / "metrics.jsonl"
        try:
            with path.open("a") as file:
                file.write(line)
                if to_disk:
                    file.flush()
                    os.fsync(file.fileno())
        except OSError as error:
            raise FileError(
                f"{path} cannot be written ({error}); free some space and take the run up again."
            ) from error

    def metrics(self) -> list[dict[str, Any]]:
        """The lines of ``metrics.jsonl``; an unfinished last line is left out.

        Raises
        ------
        FileError
            A line other than the last is not JSON.
        """
        path = self.path / "metrics.jsonl"
        try:
            lines = path.read_text().split("\n") if path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(f"{path} cannot be read ({error})") from error
        rows: list[dict[str, Any]] = []
        for number, line in enumerate(lines[:-1], 1):  # what follows the last line feed is no whole line
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError as error:
                raise FileError(
                    f"{path}, line {number}, is not JSON ({error}); delete the run and repeat it"
                ) from error
        return rows

    def save_checkpoint(self, state: Mapping[str, torch.Tensor], iteration: int) -> None:
        """Replace the checkpoint by this state; the metrics up to here reach the disk first."""
        self._append("", to_disk=True)
        save_tensors(
            self.path / "checkpoint.safetensors", state, {"kind": "checkpoint", "iteration": iteration}
        )

    def load_checkpoint(self) -> dict[str, torch.Tensor] | None:
        """The last checkpoint, or None; cuts the metrics to its iteration.

        Raises
        ------
        FileError
            The checkpoint is damaged.
        """
        path = self.path / "checkpoint.safetensors"
        state, header = load_tensors(path, kind="checkpoint") if path.exists() else (None, {"iteration": 0})
        rows = [row for row in self.metrics() if row["iteration"] <= header["iteration"]]
        write_atomically(self.path / "metrics.jsonl", "".join(json.dumps(row) + "\n" for row in rows))
        return state

    # --- beginning ----------------------------------------------------------------------------------------

    def _identity(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "version": vic_toolbox.__version__,
            "kind": self.kind,
            "configuration": self.configuration,
        }

    def _take_up(self, *, resume: bool) -> None:
        self.check_resume(resume=resume)
        there, here = flatten(_read_identity(self.path)), flatten(self._identity())
        changes = [
            f"{name} ({there.get(name, 'nothing')!r} there, {here.get(name, 'nothing')!r} now)"
            for name in sorted(there.keys() | here.keys())
            if there.get(name) != here.get(name)
        ]
        if changes:
            raise FileError(
                f"{self.path} holds another run: "
                f"{', '.join(changes[:5])}{', ...' if len(changes) > 5 else ''}. Repeat its options to take "
                "it up, or choose another folder."
            )
        for leftover in self.path.rglob(".*.*.*"):  # temporary files of a killed process
            leftover.unlink(missing_ok=True)


def _read_identity(path: Path) -> dict[str, Any]:
    identity = read_json(path / "config.json")
    if not isinstance(identity, dict) or identity.get("format") != FORMAT:
        raise FileError(
            f"{path / 'config.json'} does not describe a run of this version (format {FORMAT!r}); "
            "a run of another version must be used with that, or train it anew."
        )
    if not isinstance(identity.get("kind"), str) or not isinstance(identity.get("configuration"), dict):
        raise FileError(f"{path / 'config.json'} lacks the kind of the run or its configuration.")
    return identity
