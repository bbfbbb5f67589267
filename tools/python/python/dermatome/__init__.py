"""Somatosensory maps of robot skin.

`Skin` holds taxels, `build` maps them, `Map` holds the levels of receptive fields and their flat maps, `Map.index`
finds what is near a point, and `Map.pool` carries readings to the fields. Lengths are in m, angles in rad; arrays in
may be anything that numpy takes for an array, arrays out are new and in C order.
"""

from dermatome._dermatome import (
    Fields,
    Flattening,
    Hits,
    Index,
    Level,
    Map,
    Matrix,
    MeshLevel,
    Patch,
    Skin,
    __version__,
    build,
    check,
    coarsen,
    flatten,
)
from dermatome._errors import DataError, Error, FileError, MissingFileError

__all__ = [
    "DataError",
    "Error",
    "Fields",
    "FileError",
    "Flattening",
    "Hits",
    "Index",
    "Level",
    "Map",
    "Matrix",
    "MeshLevel",
    "MissingFileError",
    "Patch",
    "Skin",
    "__version__",
    "build",
    "check",
    "coarsen",
    "flatten",
]
