"""What stands between the springs of a rig and the numbers of a trace: load cell, filter, zero."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ._arguments import instance, number, whole
from .trace import Trace

__all__ = ["Chain"]

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """A measuring chain: it changes a force as instruments do, in the order of its attributes.

    Attributes
    ----------
    gain : float
        Factor of the force.
    resonance : float, optional
        Natural frequency of the load cell [Hz]; without one it is rigid.
    damping : float
        Its damping ratio.
    filter : float, optional
        Corner frequency of a Butterworth low pass [Hz].
    order : int
        Its order.
    tare : float
        Reading without a force [N].

    Notes
    -----
    A filter, and a resonance, above half of the sampling rate changes nothing.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 1001)
    >>> Chain(gain=2.0, tare=0.5)(Trace(time, 1.0 + 0.1 * time)).force[[0, -1]]
    array([2.5, 2.7])
    """

    gain: float = 1.0
    resonance: float | None = None
    damping: float = 0.05
    filter: float | None = None
    order: int = 2
    tare: float = 0.0

    def __post_init__(self) -> None:
        whole("order", self.order, least=1)
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name != "order" and value is not None:
                above = None if each.name == "tare" else 0.0
                object.__setattr__(self, each.name, number(each.name, value, above=above))

    def response(self, interval: float, force: _Floats) -> _Floats:
        """Gain, resonance, filter and tare, of a force that was at rest before.

        Parameters
        ----------
        interval : float
            Time between two samples [s].
        force : ndarray, shape (n,)
            Force [N].
        """
        from scipy.signal import bilinear, butter, sosfilt, sosfilt_zi, tf2sos  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import)

        shown = self.gain * force
        stages = []
        if self.resonance is not None and self.resonance * interval < 0.5:
            angular = 2.0 * np.pi * self.resonance
            cell = [angular**2], [1.0, 2.0 * self.damping * angular, angular**2]
            stages.append(tf2sos(*bilinear(*cell, 1.0 / interval)))
        if self.filter is not None and self.filter * interval < 0.5:
            stages.append(butter(self.order, self.filter, fs=1.0 / interval, output="sos"))
        for stage in stages:
            shown, _ = sosfilt(stage, shown, zi=sosfilt_zi(stage) * shown[0])
        return np.asarray(shown + self.tare)

    def __call__(self, trace: Trace) -> Trace:
        """The trace as this chain shows its force, at the same, regular times.

        Parameters
        ----------
        trace : Trace
            Force of the springs, ``Trace.of`` a run.
        """
        trace = instance("trace", trace, Trace, "give what Trace.of returns").regular()
        return replace(trace, force=self.response(trace.interval, trace.force), lines=None)
