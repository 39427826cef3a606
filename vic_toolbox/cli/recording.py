"""The command that looks at logs: ``recording inspect``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from vic_toolbox.cli.console import print_table, say
from vic_toolbox.cli.options import MaybeFile
from vic_toolbox.cli.reading import Reading
from vic_toolbox.errors import FileError

Log = Positional[Annotated[Path, arg(metavar="FILE")]]


@dataclass(frozen=True)
class Recording:
    """Look at a log of poses, references and wrenches: what it holds, what was guessed, what is wrong with it.

    Reads CSV, TSV, npz, HDF5, ROS 1 bags and ROS 2 bags (SQLite, MCAP), checks clock, units, sensor, frame and
    latency, names a remedy for whatever it finds, and draws it. Nothing is changed unless it is asked for.

    Example: vic recording inspect log.csv --out log.svg
    """

    what: Positional[Literal["inspect"]]
    """What to do with it."""
    file: Log
    """The log; a folder for a ROS 2 bag."""
    out: MaybeFile = None
    """Figure to write (.svg, .png or .pdf); by default the log's name with .svg, here."""
    save: MaybeFile = None
    """Write the recording as it was read (.npz or .h5)."""
    reading: OmitArgPrefixes[Reading] = field(default_factory=Reading)

    def run(self) -> None:
        """Inspect."""
        from vic_toolbox.files import atomic_path
        from vic_toolbox.recordings import inspect
        from vic_toolbox.recordings.inspection import HEAD

        out = self.out or Path(f"{self.file.stem}.svg")
        if out.suffix.lower() not in (".svg", ".png", ".pdf"):
            raise FileError(f"{out} is no figure; end its name with .svg, .png or .pdf.")
        recording = self.reading.read(self.file)
        seen = inspect(recording)
        say(f"{seen.summary}\n")
        if seen.rows:
            print_table(HEAD, seen.rows)
        for note in seen.notes:
            say(f"note: {note}")
        if seen.frame is not None and not seen.frame.suspicious:
            say(f"frame: {seen.frame.message}")
        for finding in seen.findings:
            say(str(finding))
        if not seen.findings:
            say("nothing was found wrong with it")
        if self.save is not None:
            recording.save(self.save)
            say(f"saved: {self.save}")
        with atomic_path(out) as temporary:
            recording.plot().savefig(temporary)
        say(f"figure: {out}")
