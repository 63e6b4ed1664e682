"""What stands between the springs of a rig and the numbers of a trace: load cell, filter, zero, analogue-digital converter."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ._arguments import generator, instance, number, whole
from .trace import Trace

__all__ = ["Chain"]

_Floats = NDArray[np.float64]

ABOVE_ZERO = ("gain", "resonance", "damping", "filter")
NOT_NEGATIVE = ("hum", "hum_frequency", "step", "noise")


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
    drift : float
        Change of the tare with time [N/s].
    hum, hum_frequency : float
        Amplitude [N] and frequency [Hz] of what the mains induce.
    noise : float
        Standard deviation of white noise [N].
    step : float
        Resolution of the converter [N]; 0 for none.

    Notes
    -----
    A filter, and a resonance, above half of the sampling rate changes nothing.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 1001)
    >>> Chain(tare=0.3, step=0.01)(Trace(time, 1.0 + 0.1 * time)).force[:2]
    array([1.3, 1.3])
    """

    gain: float = 1.0
    resonance: float | None = None
    damping: float = 0.05
    filter: float | None = None
    order: int = 2
    tare: float = 0.0
    drift: float = 0.0
    hum: float = 0.0
    hum_frequency: float = 50.0
    noise: float = 0.0
    step: float = 0.0

    def __post_init__(self) -> None:
        whole("order", self.order, least=1)
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name != "order" and value is not None:
                limits = (
                    {"above": 0.0}
                    if each.name in ABOVE_ZERO
                    else {"least": 0.0}
                    if each.name in NOT_NEGATIVE
                    else {}
                )
                object.__setattr__(self, each.name, number(each.name, value, **limits))

    def response(self, interval: float, force: _Floats) -> _Floats:
        """What is the same in each cycle: gain, resonance, filter and tare, of a force that was at rest before.

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
            stages.append(
                tf2sos(
                    *bilinear([angular**2], [1.0, 2.0 * self.damping * angular, angular**2], 1.0 / interval)
                )
            )
        if self.filter is not None and self.filter * interval < 0.5:
            stages.append(butter(self.order, self.filter, fs=1.0 / interval, output="sos"))
        for stage in stages:
            shown, _ = sosfilt(stage, shown, zi=sosfilt_zi(stage) * shown[0])
        return np.asarray(shown + self.tare)

    def __call__(self, trace: Trace, rng: int | np.random.Generator | None = None) -> Trace:
        """The trace as this chain shows its force.

        Parameters
        ----------
        trace : Trace
            Force of the springs, ``Trace.of`` a run.
        rng : int or numpy.random.Generator, optional
            Source of the noise and of the phase of the hum: the same seed gives the same bits, None others each time.

        Returns
        -------
        Trace
            At the same, regular times.
        """
        trace = instance("trace", trace, Trace, "give what Trace.of returns").regular()
        random = generator(rng)
        time = trace.time
        phase = 2.0 * np.pi * (self.hum_frequency * time + random.uniform())
        force = self.response(trace.interval, trace.force) + self.drift * (time - time[0])
        force += self.hum * np.sin(phase) + self.noise * random.standard_normal(time.size)
        if self.step > 0.0:
            force = self.step * np.round(force / self.step)
        return Trace(time, force, trace.displacement, trace.lateral_force, trace.name, units=trace.units)
