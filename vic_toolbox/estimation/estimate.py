"""The result of every estimator: gains over time, how sure they are, and where the data say nothing."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vic_toolbox.errors import Array, FileError, InputError, finite_array
from vic_toolbox.files import read_arrays, write_arrays
from vic_toolbox.gains import AXES, ImpedanceGains

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FORMAT = 1


@dataclass(frozen=True, eq=False)
class GainEstimate:
    """Stiffness K(t) and damping B(t) of ``wrench = K e + B ė``, with their uncertainty.

    What the data do not determine is NaN, in the gains and in their standard deviations, and marked in
    `stiffness_observable` and `damping_observable`.

    Parameters
    ----------
    time : ndarray, shape (m,)
        Instants of the gains [s]: centres of the windows, or a grid of the smooth fit.
    stiffness, damping : ndarray, shape (m, 6, 6)
        K [N/m, N/rad, Nm/rad] and B [Ns/m, Ns/rad, Nms/rad], world axes.
    stiffness_sd, damping_sd : ndarray, shape (m, 6, 6)
        Standard deviation of every entry; zero where the structure fixes an entry at zero.
    stiffness_observable, damping_observable : ndarray of bool, shape (m, 6)
        Whether the data determine the axis: see :mod:`vic_toolbox.estimation.observability`.
    condition : ndarray, shape (m, 6)
        Condition number of the unregularised information about the axis' gains, in the units of their scale;
        infinite where there is none.
    residuals : ndarray, shape (n, 6)
        ``wrench − K e − B ė`` (and what else was fitted) at the samples, demonstrations one after another.
    noise : ndarray, shape (6,)
        Standard deviation of the wrench's noise, given or estimated [N, Nm].
    explained : ndarray, shape (6,)
        Share of each axis' wrench explained beyond a constant (centred r²).
    method : str
        One line: estimator, structure, constraint, solver.
    parameters : mapping of str to ndarray
        What else was estimated, and its standard deviation under the name with ``_sd``: ``bias``, ``latency``,
        ``attractor``, ``damping_factor``.
    warnings : tuple of str
        What a reader of the numbers should know, each with a remedy.
    """

    time: Array
    stiffness: Array
    damping: Array
    stiffness_sd: Array
    damping_sd: Array
    stiffness_observable: NDArray[np.bool_]
    damping_observable: NDArray[np.bool_]
    condition: Array
    residuals: Array
    noise: Array
    explained: Array
    method: str
    parameters: Mapping[str, Array] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def observable(self) -> NDArray[np.bool_]:
        """Where both gains of an axis are determined, shape (m, 6)."""
        return self.stiffness_observable & self.damping_observable

    def to_gains(self, t: ArrayLike, *, fallback: ImpedanceGains | None = None) -> ImpedanceGains:
        """Gains at given times, for the impedance law, a policy or a stability analysis.

        Between two instants the gains are interpolated linearly, which keeps them positive definite; outside
        they are held.

        Parameters
        ----------
        t : array_like, shape (...)
            Times [s].
        fallback : ImpedanceGains, optional
            One pair of gains for the axes that are not determined. Such an axis takes its diagonal from here
            and is coupled to none.

        Raises
        ------
        InputError
            An axis is not determined at one of the times and there is no fallback, or the gains there are not
            positive definite (fit with ``constraint="spd"``).
        """
        times = finite_array("t", t)
        left = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, max(len(self.time) - 2, 0))
        right = np.minimum(left + 1, len(self.time) - 1)
        span = np.where(right > left, self.time[right] - self.time[left], 1.0)
        share = np.clip((times - self.time[left]) / span, 0.0, 1.0)
        found = []
        for name, gain, seen in (
            ("stiffness", self.stiffness, self.stiffness_observable),
            ("damping", self.damping, self.damping_observable),
        ):
            # an end that carries no weight need not be known
            known = (seen[left] | (share == 1)[..., None]) & (seen[right] | (share == 0)[..., None])
            if fallback is None and not known.all():
                self._refuse(name, times, known)
            ends = np.nan_to_num(gain[left]), np.nan_to_num(gain[right])
            mixed = ends[0] + share[..., None, None] * (ends[1] - ends[0])
            if fallback is not None:
                spare = np.diagonal(getattr(fallback, name), axis1=-2, axis2=-1)
                both = known[..., :, None] & known[..., None, :]
                mixed = np.where(both, mixed, np.where(known, 0.0, spare)[..., None] * np.eye(6))
            found.append(mixed)
        return ImpedanceGains(*found)

    def _refuse(self, name: str, times: Array, known: NDArray[np.bool_]) -> None:
        rows = np.reshape(known, (-1, 6))
        missing = [axis for axis, lost in zip(AXES, np.any(~rows, axis=0).tolist(), strict=True) if lost]
        first = times.reshape(-1)[~rows.all(axis=1)][0]
        raise InputError(
            f"the data do not determine the {name} along {', '.join(missing)} (first at t = {first:g} s); pass "
            "gains for such axes as fallback, or times at which `observable` holds."
        )

    def plot(self) -> Figure:
        """Draw the diagonals of K and B with their 95 % bands; gaps are what the data do not determine."""
        from vic_toolbox.estimation.picture import draw

        return draw(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one ``.npz`` file, as a whole or not at all; nothing is pickled.

        Raises
        ------
        FileError
            The file cannot be written.
        """
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _TEXT}
        arrays |= {f"parameter_{name}": np.asarray(value) for name, value in self.parameters.items()}
        text = json.dumps({"method": self.method, "warnings": list(self.warnings)})
        write_arrays(path, {"format": _FORMAT, "text": np.frombuffer(text.encode(), np.uint8)} | arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> GainEstimate:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            The file is missing, damaged, or of another kind or version.
        """
        content = read_arrays(path, "a gain estimate", remedy="fit again")
        try:
            if int(content.pop("format")) != _FORMAT:
                raise FileError(f"{path} is of another version; fit again with this one.")
            text = json.loads(content.pop("text").tobytes().decode())
            prefix = "parameter_"
            extra = {k.removeprefix(prefix): content.pop(k) for k in list(content) if k.startswith(prefix)}
            result = cls(
                **content, parameters=extra, method=str(text["method"]), warnings=tuple(text["warnings"])
            )
            result._check_shapes(path)
        except FileError:
            raise
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileError(f"{path} cannot be read as a gain estimate ({error})") from error
        return result

    def _check_shapes(self, path: str | os.PathLike[str]) -> None:
        m = len(self.time)
        shapes = {
            "time": (m,),
            "residuals": (len(self.residuals), 6),
            "noise": (6,),
            "explained": (6,),
            "condition": (m, 6),
            "stiffness_observable": (m, 6),
            "damping_observable": (m, 6),
        } | dict.fromkeys(("stiffness", "damping", "stiffness_sd", "damping_sd"), (m, 6, 6))
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise FileError(
                    f"{path} is damaged: {name} has shape {getattr(self, name).shape}, not {shape}"
                )


_TEXT = ("method", "parameters", "warnings")


def gated(
    time: Array,
    stiffness: Array,
    damping: Array,
    *,
    deviations: tuple[Array, Array],
    seen: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    condition: Array,
    residuals: Array,
    noise: Array,
    explained: Array,
    method: str,
    parameters: Mapping[str, Array] | None = None,
    warnings: tuple[str, ...] = (),
) -> GainEstimate:
    """An estimate that shows only what `seen` (stiffness, damping) marks; gains are (m, 6, 6), or diagonals (m, 6)."""
    shown = [
        _hidden(gain, known)
        for gain, known in zip((stiffness, damping, *deviations), (*seen, *seen), strict=True)
    ]
    return GainEstimate(
        time=time,
        stiffness=shown[0],
        damping=shown[1],
        stiffness_sd=shown[2],
        damping_sd=shown[3],
        stiffness_observable=seen[0],
        damping_observable=seen[1],
        condition=condition,
        residuals=residuals,
        noise=noise,
        explained=explained,
        method=method,
        parameters=dict(parameters or {}),
        warnings=warnings,
    )


def _hidden(gain: Array, seen: NDArray[np.bool_]) -> Array:
    """Gains with NaN in the rows and columns of unknown axes; diagonals, whose couplings are zero, on the diagonal."""
    if gain.ndim == 3:
        return np.where(seen[:, :, None] & seen[:, None, :], gain, np.nan)
    matrices, index = np.zeros((*gain.shape, 6)), np.arange(6)
    matrices[:, index, index] = np.where(seen, gain, np.nan)
    return matrices
