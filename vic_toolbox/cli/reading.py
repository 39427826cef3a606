"""How a log is read: the options that every command with a log has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from vic_toolbox.cli.options import MaybeFile
from vic_toolbox.errors import InputError

if TYPE_CHECKING:
    from vic_toolbox.recordings import Layout, Recording

Nine = Annotated[
    tuple[float, float, float, float, float, float, float, float, float] | None, arg(metavar="X ...")
]
Three = Annotated[tuple[float, float, float] | None, arg(metavar="X Y Z")]
Units = Annotated[tuple[str, ...], arg(metavar="QUANTITY=UNIT ...")]


@dataclass(frozen=True)
class Reading:
    """What the log does not say itself. Each option wins over the layout."""

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
    units: Units = ()
    """Units that are not SI, e.g. time=ms length=mm angle=deg force=kN moment=Nmm."""
    stamps: Literal["header", "arrival"] = "header"
    """Which times of a bag's messages to use."""
    repair: bool = False
    """Mend what can be mended without guessing, and read a file up to where it breaks off."""

    def stated(self) -> Layout:
        """The layout file with the options in it.

        Raises
        ------
        InputError, FileError
            The file cannot be read, or an option makes no sense.
        """
        from vic_toolbox.recordings import Layout

        layout = Layout.of(self.layout)
        changes: dict[str, Any] = {
            name: value
            for name in ("reference", "wrench_axes", "sensor_offset", "wrench_sign")
            if (value := getattr(self, name)) is not None
        }
        if (q := self.sensor_rotation) is not None:
            changes["sensor_rotation"] = (q[:3], q[3:6], q[6:])
        if self.units:
            changes["units"] = {**layout.units, **dict(map(_pair, self.units))}
        return replace(layout, **changes)

    def read(self, file: Path) -> Recording:
        """Read a log with these options."""
        from vic_toolbox.recordings import read

        return read(file, self.stated(), stamps=self.stamps, repair=self.repair)


def _pair(text: str) -> tuple[str, str]:
    quantity, equals, unit = text.partition("=")
    if not equals:
        raise InputError(f"--units is {text!r}; write the quantity and its unit, e.g. time=ms.")
    return quantity, unit
