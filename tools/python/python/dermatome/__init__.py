"""Somatosensory maps of robot skin.

`Skin` holds taxels, `build` maps them, `Map` holds the levels of receptive fields and their flat maps, `Map.index`
finds what is near a point, and `Map.pool` carries readings to the fields. Lengths are in m, angles in rad; arrays in
may be anything that numpy takes for an array, arrays out are new and in C order.
"""

from dermatome._dermatome import (
    Calibration,
    ContactTracker,
    Decoder,
    Fields,
    Flattening,
    Hits,
    Index,
    Layout,
    Level,
    Map,
    Matrix,
    MeshLevel,
    Observations,
    Patch,
    Picture,
    RecordingFile,
    Renderer,
    Robot,
    Skin,
    __version__,
    build,
    calibrate,
    check,
    coarsen,
    flatten,
    simulate,
)
from dermatome._errors import DataError, Error, FileError, MissingFileError
from dermatome._readings import Readings
from dermatome._recording import Recording
from dermatome._touch import touch

__all__ = [
    "Calibration",
    "ContactTracker",
    "DataError",
    "Decoder",
    "Error",
    "Fields",
    "FileError",
    "Flattening",
    "Hits",
    "Index",
    "Layout",
    "Level",
    "Map",
    "Matrix",
    "MeshLevel",
    "MissingFileError",
    "Observations",
    "Patch",
    "Picture",
    "Readings",
    "Recording",
    "RecordingFile",
    "Renderer",
    "Robot",
    "Skin",
    "__version__",
    "build",
    "calibrate",
    "check",
    "coarsen",
    "flatten",
    "simulate",
    "touch",
]
