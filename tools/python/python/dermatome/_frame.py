"""Rectangles of maps."""

from __future__ import annotations

from typing import NamedTuple


class MapFrame(NamedTuple):
    """A rectangle of a map that an image shows.

    Attributes
    ----------
    x, y : float
        Its lower left corner on the map, in m.
    width, height : float
        Its size along x and y, in m.
    pixels : tuple of int
        Rows and columns of the image, the first row on top.
    """

    x: float
    y: float
    width: float
    height: float
    pixels: tuple[int, int]


MapFrame.__module__ = "dermatome"
