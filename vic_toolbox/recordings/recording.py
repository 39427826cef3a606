"""A recording: poses, references and wrenches on one clock, validated, in SI units and stated frames."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_number, one_of
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.differentiation import WINDOW, derivative, pose_twist
from vic_toolbox.recordings.validation import Finding, findings

WRENCH_AXES = ("world", "tool")

SHAPES: dict[str, tuple[int | None, ...]] = {
    "time": (None,),
    "position": (None, 3),
    "quat_wxyz": (None, 4),
    "reference_position": (None, 3),
    "reference_quat_wxyz": (None, 4),
    "wrench": (None, 6),
    "joint_position": (None, None),
    "joint_velocity": (None, None),
    "stiffness": (None, 6),
    "damping": (None, 6),
    "twist": (None, 6),
    "reference_twist": (None, 6),
    "given_error": (None, 6),
}
"""Every array of a recording, with the shape of one."""
OPTIONAL = tuple(SHAPES)[6:]


@dataclass(frozen=True, eq=False)
class Recording:
    """Poses, references and wrenches on one clock.

    The wrench is the one that the end-effector exerts on its virtual spring and damper,

    ``wrench = K e + B ė = −F_fb``,  ``e = [p − p_d; log(R R_dᵀ)]``,  ``ė = [v − v_d; ω − ω_d]``,

    in world axes, about the end-effector's origin. Where inertia plays no part it balances the environment:
    ``wrench = −F_ext``, what the environment does to the robot (``F_ext`` of the conventions is what the robot
    does to the environment). A sensor that pushes back is thus logged with the sign of the push it feels; one
    that reports the opposite is turned round when it is read (``wrench_sign``).

    Shapes are checked here. What the numbers say is looked at by :attr:`findings`; whatever computes with a
    recording calls :meth:`check` first, which refuses one with errors.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Increasing [s].
    position, reference_position : ndarray, shape (n, 3)
        ``p`` and ``p_d``, world axes [m].
    quat_wxyz, reference_quat_wxyz : ndarray, shape (n, 4)
        Orientation of the end-effector, ``R``, and of its reference, ``R_d``, in world axes.
    wrench : ndarray, shape (n, 6)
        ``[f; m]`` [N, Nm].
    joint_position, joint_velocity : ndarray, shape (n, k), optional
        [rad, rad/s].
    stiffness, damping : ndarray, shape (n, 6), optional
        Diagonal of the gains that were applied, where they are known [N/m, Nm/rad; Ns/m, Nms/rad].
    twist, reference_twist : ndarray, shape (n, 6), optional
        Measured ``[v; ω]`` and wanted ``[v_d; ω_d]``, world axes [m/s, rad/s].
    given_error : ndarray, shape (n, 6), optional
        ``e`` as it was given, instead of the one that the poses make.
    wrench_axes : str
        ``world``, or ``tool`` for a wrench as logged, in axes fixed to the end-effector: such a recording has
        to go through :func:`~vic_toolbox.recordings.wrench_to_world` before gains are fitted.
    source : str
        Where it was read from.
    notes : tuple of str
        What was guessed, resampled or repaired on the way.

    Raises
    ------
    InputError
        A shape is wrong, or the arrays are not of the same length.
    """

    time: Array
    position: Array
    quat_wxyz: Array
    reference_position: Array
    reference_quat_wxyz: Array
    wrench: Array
    joint_position: Array | None = None
    joint_velocity: Array | None = None
    stiffness: Array | None = None
    damping: Array | None = None
    twist: Array | None = None
    reference_twist: Array | None = None
    given_error: Array | None = None
    wrench_axes: str = "world"
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        one_of("wrench_axes", self.wrench_axes, WRENCH_AXES)
        count = None
        for name, shape in SHAPES.items():
            value = getattr(self, name)
            if value is None and name in OPTIONAL:
                continue
            array = _real_array(name, value, shape)
            if count is None:
                count = len(array)
                if count == 0:
                    raise InputError("a recording has no samples; pass at least one.")
            if len(array) != count:
                raise InputError(
                    f"{name} has {len(array)} samples and time has {count}; bring all arrays onto one clock."
                )
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "notes", tuple(map(str, self.notes)))

    @classmethod
    def from_errors(
        cls, time: ArrayLike, error: ArrayLike, error_rate: ArrayLike, wrench: ArrayLike
    ) -> Recording:
        """Build a recording straight from the quantities of the law ``wrench = K e + B ė``.

        The reference stands still at the origin of the world, and the end-effector is where `error` says.

        Parameters
        ----------
        time : array_like, shape (n,)
            Increasing [s].
        error : array_like, shape (n, 6)
            ``e = [p − p_d; log(R R_dᵀ)]`` [m, rad].
        error_rate : array_like, shape (n, 6)
            ``ė = [v − v_d; ω − ω_d]`` [m/s, rad/s].
        wrench : array_like, shape (n, 6)
            ``K e + B ė`` [N, Nm].

        Raises
        ------
        InputError
            Wrong shapes or lengths.
        """
        e = _real_array("error", error, (None, 6))
        rest = np.zeros((len(e), 6))
        return cls(
            time=np.asarray(time),
            position=e[:, :3],
            quat_wxyz=quaternions.exp(e[:, 3:]),
            reference_position=rest[:, :3],
            reference_quat_wxyz=np.tile(quaternions.IDENTITY, (len(e), 1)),
            wrench=np.asarray(wrench),
            twist=_real_array("error_rate", error_rate, (None, 6)),
            reference_twist=rest,
            given_error=e,
        )

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        name = f" of {self.source}" if self.source else ""
        extra = ", ".join(name for name in OPTIONAL if getattr(self, name) is not None)
        rate = f"{self.rate:.4g} Hz" if len(self) > 1 else "one sample"
        return (
            f"<Recording{name}: {len(self)} samples, {self.duration:.4g} s, {rate}{extra and ', ' + extra}>"
        )

    def arrays(self) -> dict[str, Array]:
        """Every array that there is, by name; all have one row for each sample."""
        return {name: array for name in SHAPES if (array := getattr(self, name)) is not None}

    # --- what follows from the arrays ------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.time[-1]) - float(self.time[0])

    @cached_property
    def rate(self) -> float:
        """Samples per second, from the median step [Hz]; NaN for a single sample."""
        with np.errstate(over="ignore", invalid="ignore"):  # a time that is damaged is a finding
            step = np.median(np.diff(self.time)) if len(self) > 1 else np.nan
        return float(1.0 / step) if step else np.inf

    @cached_property
    def error(self) -> Array:
        """``e = [p − p_d; log(R R_dᵀ)]`` (n, 6) in world axes [m, rad].

        Raises
        ------
        InputError
            The recording has errors (:meth:`check`).
        """
        self.check()
        if self.given_error is not None:
            return self.given_error
        turned = quaternions.multiply(
            quaternions.normalised(self.quat_wxyz),
            quaternions.conjugate(quaternions.normalised(self.reference_quat_wxyz)),
        )
        return _read_only(np.hstack([self.position - self.reference_position, quaternions.log(turned)]))

    @cached_property
    def error_rate(self) -> Array:
        """``ė = [v − v_d; ω − ω_d]`` (n, 6) in world axes [m/s, rad/s].

        From the twists where the log has them; a missing one, and without any the whole, is the
        Savitzky-Golay derivative of the pose (order 3, 80 ms). :func:`~vic_toolbox.recordings.differentiate`
        chooses another window, and filters pose and wrench alike.

        Raises
        ------
        InputError
            The recording has errors (:meth:`check`), or too few samples.
        """
        self.check()
        if self.twist is None:
            return _read_only(derivative(self.time, self.error, window=WINDOW))
        wanted = self.reference_twist
        if wanted is None:
            wanted = pose_twist(self.time, self.reference_position, self.reference_quat_wxyz, window=WINDOW)
        return _read_only(self.twist - wanted)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Everything that is wrong or looks so, errors first: see :mod:`vic_toolbox.recordings.validation`."""
        return findings(self)

    def check(self) -> None:
        """Refuse a recording whose numbers are meaningless.

        Raises
        ------
        InputError
            It has findings that are errors; the first is told in full.
        """
        errors = [finding for finding in self.findings if finding.severity == "error"]
        if errors:
            more = f" And {len(errors) - 1} more in recording.findings." if len(errors) > 1 else ""
            first = errors[0]
            raise InputError(
                f"{self.source or 'the recording'}: {first.message} (first at sample {first.index}). "
                f"{first.remedy}.{more}"
            )

    # --- other recordings ------------------------------------------------------------------------------------

    def between(self, start: float, stop: float) -> Recording:
        """The samples from `start` to `stop` [s], both included.

        Raises
        ------
        InputError
            There is none.
        """
        low, high = finite_number("start", start), finite_number("stop", stop)
        keep = (self.time >= low) & (self.time <= high)
        if not keep.any():
            raise InputError(
                f"no sample lies between {low:g} s and {high:g} s; "
                f"the recording goes from {self.time[0]:g} s to {self.time[-1]:g} s."
            )
        return self.rows(keep)

    def rows(self, which: Any) -> Recording:
        """The samples that indices, a slice or a mask pick, in that order."""
        return dataclasses.replace(self, **{name: array[which] for name, array in self.arrays().items()})

    def noted(self, *notes: str, **changes: Any) -> Recording:
        """The same recording with other arrays, and with a note on what was done."""
        return dataclasses.replace(self, **changes, notes=(*self.notes, *notes))

    def repaired(self, kinds: Sequence[str] | None = None) -> Recording:
        """Mend what can be mended without guessing: see :func:`~vic_toolbox.recordings.repair`."""
        from vic_toolbox.recordings.repairs import repair

        return repair(self, kinds)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to ``.npz`` or ``.h5``, by the suffix; an earlier file stays until this one is whole.

        Raises
        ------
        InputError
            Another suffix.
        FileError
            The file cannot be written.
        """
        from vic_toolbox.recordings.saving import save

        save(self, path)

    def plot(self) -> Any:
        """Draw error, its rate and wrench over time with the findings; returns a matplotlib figure."""
        from vic_toolbox.recordings.drawing import draw

        return draw(self)


def _real_array(name: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """A copy as ``float64`` with the shape of a field; NaN is a finding, not a wrong type."""
    try:
        raw = np.array(value)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name} is not an array of numbers ({error}).") from error
    if raw.dtype.kind not in "fiu":
        raise InputError(f"{name} holds {raw.dtype}, not real numbers; pass an array of numbers.")
    if len(raw.shape) != len(shape) or any(
        wanted is not None and got != wanted for got, wanted in zip(raw.shape, shape, strict=True)
    ):
        wanted = ", ".join("n" if length is None else str(length) for length in shape)
        raise InputError(f"{name} has shape {raw.shape}; pass real numbers of shape ({wanted}).")
    return raw.astype(np.float64, copy=False)


def _read_only(array: Array) -> Array:
    array.setflags(write=False)
    return array
