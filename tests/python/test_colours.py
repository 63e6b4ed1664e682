"""Colours of the figures, as readers with each of the three colour-vision deficiencies see them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from dynstiction.plot import notation, style, time_series
from matplotlib.colors import to_rgb

# Machado, Oliveira & Fernandes (2009), doi:10.1109/TVCG.2009.113, whole deficiency, for linear RGB.
SEEN = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
WHITE = [0.95047, 1.0, 1.08883]
LEAST = 15.0
"""CIE 1976 distance; 2.3 is just noticeable side by side, thin lines need several times that."""


def lab(colour: str, seen: str) -> np.ndarray:
    """CIE L*a*b* of a colour under a deficiency."""
    value = np.array(to_rgb(colour))
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    ratio = np.array(XYZ) @ np.clip(np.array(SEEN[seen]) @ linear, 0.0, 1.0) / WHITE
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def closest(colours: list[str], seen: str) -> tuple[float, str, str]:
    """The two colours of a list that are hardest to distinguish, and their distance."""
    pairs = itertools.combinations(dict.fromkeys(colours), 2)
    return min((float(np.linalg.norm(lab(a, seen) - lab(b, seen))), a, b) for a, b in pairs)


@pytest.mark.parametrize("seen", SEEN)
def test_colours_can_be_told_apart(seen: str) -> None:
    used = {
        "palette": list(style.PALETTE),
        "columns": [symbol.colour for symbol in notation.COLUMNS.values()],
        "overlay": list(time_series.COLOURS),
    }
    assert set().union(*used.values()) == set(style.PALETTE)
    for name, colours in used.items():
        distance, *pair = closest(colours, seen)
        assert distance >= LEAST, (name, seen, pair, distance)
