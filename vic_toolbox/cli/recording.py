"""The command that looks at logs: ``recording inspect``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from vic_toolbox.cli.console import print_table, say
from vic_toolbox.cli.options import MaybeFile
from vic_toolbox.errors import FileError

Log = Positional[Annotated[Path, arg(metavar="FILE")]]
Nine = Annotated[
    tuple[float, float, float, float, float, float, float, float, float] | None, arg(metavar="X ...")
]
Three = Annotated[tuple[float, float, float] | None, arg(metavar="X Y Z")]


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
    layout: MaybeFile = None
    """TOML file that says where the log keeps what; names that it leaves out are guessed."""
    reference: Literal["logged", "start", "mean"] | None = None
    """Reference: in the log, or standing still where the pose was at the start or in the mean."""
    wrench_axes: Literal["world", "tool"] | None = None
    """Axes that the wrench was logged in."""
    sensor_rotation: Nine = None
    """How the sensor is mounted: its axes in those of the end-effector, row by row."""
    sensor_offset: Three = None
    """From the end-effector's origin to the sensor's, in its axes [m]."""
    wrench_sign: Literal[1, -1] | None = None
    """-1 for a sensor that reports what the robot does to the environment."""
    stamps: Literal["header", "arrival"] = "header"
    """Which times of a bag's messages to use."""
    repair: bool = False
    """Mend what can be mended without guessing, and read a file up to where it breaks off."""
    save: MaybeFile = None
    """Write the recording as it was read (.npz or .h5)."""

    def run(self) -> None:
        """Inspect."""
        from vic_toolbox.files import atomic_path
        from vic_toolbox.recordings import inspect, read
        from vic_toolbox.recordings.inspection import HEAD

        out = self.out or Path(f"{self.file.stem}.svg")
        if out.suffix.lower() not in (".svg", ".png", ".pdf"):
            raise FileError(f"{out} is no figure; end its name with .svg, .png or .pdf.")
        options: dict[str, Any] = {
            "reference": self.reference,
            "wrench_axes": self.wrench_axes,
            "sensor_offset": self.sensor_offset,
            "wrench_sign": self.wrench_sign,
        }
        if (q := self.sensor_rotation) is not None:
            options["sensor_rotation"] = (q[:3], q[3:6], q[6:])
        recording = read(self.file, self.layout, stamps=self.stamps, repair=self.repair, **options)
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
