"""Somatosensory maps of robot skin.

`Skin` holds taxels, `build` maps them, `Map` holds the levels of receptive fields and their flat maps, `Map.index`
finds what is near a point, and `Map.pool` carries readings to the fields. Lengths are in m, angles in rad; arrays in
may be anything that numpy takes for an array, arrays out are new and in C order.
"""

from typing import TYPE_CHECKING, Any

from dermatome._bodies import Body, BodyCalibration, HeldBack, JointOffset, LevelScore, ProbeOffset
from dermatome._calibrate import calibrate
from dermatome._dermatome import (
    Calibration,
    ContactTracker,
    Decoder,
    EventDetector,
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
    Response,
    Robot,
    Skin,
    __version__,
    build,
    check,
    coarsen,
    diff,
    flatten,
    simulate,
)
from dermatome._errors import ArgumentError, DataError, DermatomeWarning, Error, FileError, MissingFileError
from dermatome._frame import MapFrame
from dermatome._follow import FollowedTouch, Following, follow
from dermatome._readings import Readings
from dermatome._response import examine, order, response
from dermatome._touch import touch
from dermatome._touches import touches

if TYPE_CHECKING:
    from dermatome._recording import Recording

__all__ = [
    "ArgumentError",
    "Body",
    "BodyCalibration",
    "Calibration",
    "ContactTracker",
    "DataError",
    "Decoder",
    "DermatomeWarning",
    "Error",
    "EventDetector",
    "Fields",
    "FileError",
    "Flattening",
    "FollowedTouch",
    "Following",
    "HeldBack",
    "Hits",
    "Index",
    "JointOffset",
    "Layout",
    "Level",
    "LevelScore",
    "Map",
    "MapFrame",
    "Matrix",
    "MeshLevel",
    "MissingFileError",
    "Observations",
    "Patch",
    "Picture",
    "ProbeOffset",
    "Readings",
    "Recording",
    "RecordingFile",
    "Renderer",
    "Response",
    "Robot",
    "Skin",
    "__version__",
    "build",
    "calibrate",
    "check",
    "coarsen",
    "diff",
    "examine",
    "flatten",
    "follow",
    "order",
    "response",
    "simulate",
    "touch",
    "touches",
]


def __getattr__(name: str) -> Any:
    # A third of the time of the import, which most programs do not need.
    if name == "Recording":
        from dermatome._recording import Recording

        return Recording
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
