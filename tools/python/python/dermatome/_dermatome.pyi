import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, NoReturn, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dermatome._frame import MapFrame
from dermatome._recording import Draft, Recording

__all__ = [
    "Calibration",
    "ContactTracker",
    "Decoder",
    "EventDetector",
    "Fields",
    "Flattening",
    "Hits",
    "Index",
    "Layout",
    "Level",
    "Map",
    "Matrix",
    "MeshLevel",
    "Observations",
    "Patch",
    "Picture",
    "RecordingFile",
    "Renderer",
    "Response",
    "Robot",
    "Skin",
    "TouchFollower",
    "TouchLines",
    "__version__",
    "as_floats",
    "as_numbers",
    "build",
    "calibrate_taxels",
    "check",
    "coarsen",
    "colours",
    "condition_readings",
    "contacts_of_log",
    "diff",
    "estimate_response",
    "examine_taxels",
    "fit_bodies",
    "flatten",
    "is_extensive",
    "is_of_touch",
    "is_same_unit",
    "join_readings",
    "main_channel",
    "order_columns",
    "read_readings",
    "run_command",
    "simulate",
    "simulate_touch",
    "summarise_readings",
    "write_taxels_of_bodies",
]

__version__: str

_Path = str | os.PathLike[str]
_Unit = Literal["m", "mm", "cm", "dm", "in"] | float
_Weld = Literal["auto", "all", "none", "texture"]
_Method = Literal["intrinsic", "conformal", "linear"]
_Energy = Literal["sum", "symmetric-dirichlet"]
_Overlap = Literal["prevent", "allow"]
_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]
_U32 = NDArray[np.uint32]
_I32 = NDArray[np.int32]
_I64 = NDArray[np.int64]
# Not `ArrayLike`, of which any text is one.
_Pairs = Sequence[Sequence[int]] | NDArray[np.integer[Any]]

class _Made:
    """What functions make, and no constructor."""

    def __init__(self, never: NoReturn, /) -> None: ...

def run_command(
    args: Sequence[str], open: Callable[..., Any] | None = None, draft: Callable[..., Any] | None = None
) -> int: ...
@final
class Skin(_Made):
    @staticmethod
    def read(
        path: _Path | Sequence[_Path],
        *,
        unit: _Unit | None = None,
        gap: float = 2.5,
        weld: _Weld = "auto",
        repair: bool | None = None,
        outside: ArrayLike | None = None,
        fill_holes: int | None = None,
        patches: Sequence[str] | None = None,
        keep_going: bool = False,
        outer: bool = False,
        spacing: float | Mapping[str, float] | None = None,
        least_area: float | None = None,
    ) -> Skin: ...
    @staticmethod
    def from_bytes(data: bytes | bytearray | memoryview, kind: str = "glb") -> Skin: ...
    @staticmethod
    def example() -> Skin: ...
    @staticmethod
    def from_arrays(
        positions: ArrayLike,
        faces: ArrayLike | None = None,
        *,
        normals: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        present: ArrayLike | None = None,
        link: str | Sequence[str] | None = None,
        patch: str | Sequence[str] | None = None,
        gap: float = 2.5,
        weld: _Weld = "auto",
        repair: bool = False,
        outside: ArrayLike | None = None,
        fill_holes: int | None = None,
    ) -> Skin: ...
    @staticmethod
    def from_mesh(
        mesh: Any,
        *,
        normals: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        present: ArrayLike | None = None,
        link: str | Sequence[str] | None = None,
        patch: str | Sequence[str] | None = None,
        gap: float = 2.5,
        weld: _Weld = "auto",
        repair: bool = False,
        outside: ArrayLike | None = None,
        fill_holes: int | None = None,
    ) -> Skin: ...
    @staticmethod
    def join(skins: Sequence[Skin], *, poses: Mapping[str, ArrayLike] | None = None) -> Skin: ...
    def write(self, path: _Path) -> tuple[str, ...]: ...
    def to_bytes(self, kind: str = "glb") -> bytes: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Skin: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...
    @property
    def patches(self) -> tuple[str, ...]: ...
    @property
    def links(self) -> tuple[str, ...]: ...
    @property
    def n_taxels(self) -> int: ...
    @property
    def positions(self) -> _F64: ...
    @property
    def normals(self) -> _F64: ...
    @property
    def faces(self) -> _U32: ...
    @property
    def ids(self) -> _U32: ...
    @property
    def areas(self) -> _F64: ...

def check(
    source: _Path | ArrayLike,
    faces: ArrayLike | None = None,
    *,
    unit: _Unit | None = None,
    gap: float = 2.5,
    weld: _Weld = "auto",
    repair: bool | None = None,
) -> list[dict[str, Any]]: ...
@final
class Robot(_Made):
    @staticmethod
    def read(path: _Path) -> Robot: ...
    def poses(self, joints: Mapping[str, float] | None = None) -> dict[str, _F64]: ...
    @property
    def links(self) -> tuple[str, ...]: ...
    @property
    def joints(self) -> tuple[str, ...]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Robot: ...

@final
class Matrix(_Made):
    @property
    def indptr(self) -> _I64: ...
    @property
    def indices(self) -> _I64: ...
    @property
    def data(self) -> _F64: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def scipy(self) -> Any: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Map(_Made):
    @staticmethod
    def read(path: _Path) -> Map: ...
    @staticmethod
    def from_bytes(data: bytes | bytearray | memoryview) -> Map: ...
    def to_bytes(self) -> bytes: ...
    def write(self, path: _Path) -> None: ...
    def export(
        self, path: _Path, *, level: int = 0, patch: str | None = None, robot: _Path | None = None
    ) -> None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Map: ...
    def _repr_html_(self) -> str: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...
    @property
    def patches(self) -> dict[str, Patch]: ...
    @property
    def links(self) -> tuple[str, ...]: ...
    @property
    def n_taxels(self) -> int: ...
    @property
    def n_levels(self) -> int: ...
    @property
    def field_levels(self) -> tuple[str, ...]: ...
    @property
    def ids(self) -> _U32: ...
    @property
    def present(self) -> NDArray[np.uint8]: ...
    @property
    def patch_of(self) -> _U32: ...
    @property
    def link_of(self) -> _U32: ...
    @property
    def report(self) -> list[dict[str, Any]]: ...
    @property
    def regions(self) -> tuple[str, ...]: ...
    @property
    def region_of(self) -> _I32: ...
    def with_regions(self, regions: str | os.PathLike[str] | Mapping[str, Iterable[int]]) -> Map: ...
    def pool_regions(self, values: ArrayLike, *, extensive: bool = False, modality: str | None = None) -> _F32: ...
    def _pool_groups(
        self, values: ArrayLike, groups: Sequence[int], count: int, *, extensive: bool = False, modality: str | None = None
    ) -> _F32: ...
    def modality(self, channel: str, unit: str = "") -> str | None: ...
    def _read(self, modality: str | None = None) -> NDArray[np.bool_]: ...
    def n_fields(self, level: int | str) -> int: ...
    def field_regions(self, level: int | str) -> _I32: ...
    def _name_in_levels(self, patch: str) -> str: ...
    def fields(self, level: int) -> tuple[_I32, _I32, _I64]: ...
    def pooling(self, level: int | str, *, patch: str | None = None) -> Matrix: ...
    def pool(
        self,
        values: ArrayLike,
        level: int | str,
        *,
        extensive: bool = False,
        contrast: bool = False,
        modality: str | None = None,
        threads: int = 0,
    ) -> _F32: ...
    def index(self, *, reactive: bool = False, fields: bool = False, threads: int = 0) -> Index: ...
    def renderer(
        self,
        level: int = 0,
        *,
        patch: str | None = None,
        channels: int | None = None,
        extensive: bool | Sequence[bool] | None = None,
        modality: str | Sequence[str | None] | None = None,
        size: Sequence[int] | None = None,
        pixel: float | None = None,
        pack: bool | Literal["tight", "body"] | None = None,
        fill: float | None = None,
        mask: bool = False,
        atlas: Map | None = None,
    ) -> Renderer: ...
    @property
    def atlas(self) -> dict[str, Any] | None: ...
    def carry_to(self, other: Map, *, extensive: bool = False) -> Matrix: ...
    def plot(
        self,
        values: ArrayLike | None = None,
        *,
        patches: Sequence[str] | None = None,
        levels: Sequence[int] | None = None,
        show: Literal["fields", "angle", "area", "sigma"] = "fields",
        space: bool = False,
        view: Sequence[float] | None = None,
        unfold: Sequence[float] | None = None,
        range: Sequence[float] | None = None,
        width: int = 1600,
        extensive: bool = False,
        modality: str | None = None,
        ax: Any = None,
    ) -> Picture: ...
    def to_skin(self, patch: str, uv: ArrayLike, *, level: int = 0) -> tuple[_F64, _F64, _F64]: ...

@final
class Patch(_Made):
    @property
    def start(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def link(self) -> str: ...
    @property
    def n_taxels(self) -> int: ...
    @property
    def ids(self) -> _U32: ...
    @property
    def levels(self) -> tuple[Level, ...]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Level(_Made):
    @property
    def number(self) -> int: ...
    @property
    def positions(self) -> _F64: ...
    @property
    def normals(self) -> _F64: ...
    @property
    def tangents(self) -> _F64 | None: ...
    @property
    def faces(self) -> _U32: ...
    @property
    def edges(self) -> _U32: ...
    @property
    def areas(self) -> _F64: ...
    @property
    def origins(self) -> _U32: ...
    @property
    def taxel_ids(self) -> _U32: ...
    @property
    def uv(self) -> _F64: ...
    @property
    def uv_faces(self) -> _U32: ...
    @property
    def vertex_of_place(self) -> _U32: ...
    @property
    def frame(self) -> MapFrame: ...
    @property
    def distortion(self) -> dict[str, Any]: ...
    def up(self) -> Matrix | None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

def build(
    skin: Skin | _Path,
    *,
    ratio: float | None = None,
    levels: int | None = None,
    coarsest: int = 32,
    method: _Method = "intrinsic",
    energy: _Energy = "sum",
    angle: float = 1.0,
    area: float = 1.0,
    perimeter: float = 0.0,
    magnify: float = 0.0,
    magnify_over: Literal["skin", "patch"] = "skin",
    overlap: _Overlap = "prevent",
    boundary: Literal["free", "circle"] = "free",
    cut: Literal["auto", "none", "all"] | _Pairs | None = None,
    max_area_ratio: float | None = None,
    seam_side: ArrayLike | None = None,
    across: float | None = None,
    pixel: float | None = None,
    keep_going: bool = False,
    acuity: ArrayLike | None = None,
    atlas: Map | None = None,
    landmarks: ArrayLike | _Path | None = None,
    mirror: bool = False,
    threads: int = 0,
    progress: Callable[[str, int, int], object] | None = None,
) -> Map: ...
@final
class Hits(_Made):
    @property
    def patch(self) -> _I32: ...
    @property
    def link(self) -> _I32: ...
    @property
    def face(self) -> _I64: ...
    @property
    def barycentric(self) -> _F64: ...
    @property
    def distance(self) -> _F64: ...
    @property
    def point(self) -> _F64: ...
    @property
    def normal(self) -> _F64: ...
    @property
    def least(self) -> _F64 | None: ...
    @property
    def most(self) -> _F64 | None: ...
    @property
    def level(self) -> _I32 | None: ...
    @property
    def uv(self) -> _F64 | None: ...
    @property
    def pixel(self) -> _U32 | None: ...
    @property
    def field(self) -> _I64 | None: ...
    @property
    def taxel_id(self) -> _U32 | None: ...
    @property
    def region(self) -> _I32 | None: ...
    @property
    def fields(self) -> Matrix | None: ...
    def __len__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Fields(_Made):
    @property
    def indptr(self) -> _I64: ...
    @property
    def patch(self) -> _I32: ...
    @property
    def level(self) -> _I32: ...
    @property
    def field(self) -> _I64: ...
    @property
    def taxel_id(self) -> _U32: ...
    @property
    def distance(self) -> _F64: ...
    @property
    def point(self) -> _F64: ...
    @property
    def normal(self) -> _F64: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __len__(self) -> int: ...

@final
class Index(_Made):
    def locate(
        self,
        points: ArrayLike,
        *,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        level: int | str | None = 0,
        threads: int = 0,
    ) -> Hits: ...
    def ray(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        longest: float | None = None,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        level: int | str | None = 0,
        threads: int = 0,
    ) -> Hits: ...
    def reactive(
        self,
        points: ArrayLike,
        level: int | str | None = None,
        *,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        threads: int = 0,
    ) -> Hits: ...
    def nearest(
        self,
        points: ArrayLike,
        count: int = 1,
        *,
        level: int = 0,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        threads: int = 0,
    ) -> Fields: ...
    def within(
        self,
        points: ArrayLike,
        radius: float,
        *,
        level: int = 0,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
        threads: int = 0,
    ) -> Fields: ...
    def readings(
        self,
        points: ArrayLike,
        force: ArrayLike,
        radius: ArrayLike | None = None,
        *,
        taxel_radius: float = 0.002,
        max_distance: float | None = None,
        link: str | None = None,
        only_link: str | Sequence[str | None] | Sequence[int] | NDArray[np.integer[Any]] | None = None,
    ) -> tuple[_F64, NDArray[np.bool_]]: ...
    def posed(self, poses: Mapping[str, ArrayLike]) -> Index: ...
    @property
    def poses(self) -> dict[str, _F64]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Index: ...

@final
class Flattening(_Made):
    @property
    def uv(self) -> _F64: ...
    @property
    def faces(self) -> _U32: ...
    @property
    def vertex_of_place(self) -> _U32: ...
    @property
    def distortion(self) -> dict[str, Any]: ...
    @property
    def converged(self) -> bool | None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

def flatten(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    cut: Literal["auto", "none", "all"] | _Pairs | None = None,
    max_area_ratio: float | None = None,
    method: _Method = "intrinsic",
    energy: _Energy = "sum",
    angle: float = 1.0,
    area: float = 1.0,
    perimeter: float = 0.0,
    magnify: float = 0.0,
    overlap: _Overlap = "prevent",
    boundary: Literal["free", "circle"] = "free",
    acuity: ArrayLike | None = None,
    threads: int = 0,
) -> Flattening: ...
@final
class MeshLevel(_Made):
    @property
    def positions(self) -> _F64: ...
    @property
    def faces(self) -> _U32: ...
    @property
    def areas(self) -> _F64: ...
    @property
    def origins(self) -> _U32: ...
    def pooling(self) -> Matrix: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> MeshLevel: ...

def coarsen(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    ratio: float | None = None,
    levels: int | None = None,
    coarsest: int = 32,
    acuity: ArrayLike | None = None,
    threads: int = 0,
) -> list[MeshLevel]: ...
@final
class Renderer(_Made):
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def pixel(self) -> tuple[float, float]: ...
    @property
    def extensive(self) -> tuple[bool, ...]: ...
    def __call__(self, values: ArrayLike, *, threads: int = 0) -> _F32: ...
    @property
    def mask(self) -> NDArray[np.bool_]: ...
    @property
    def patch(self) -> _I32: ...
    @property
    def field(self) -> _I64: ...
    @property
    def taxel_id(self) -> _U32: ...
    @property
    def region(self) -> _I32: ...
    @property
    def charts(self) -> list[dict[str, Any]]: ...
    def pixels(self, hits: Hits) -> _F64: ...
    def to_skin(self, rows: ArrayLike, columns: ArrayLike) -> tuple[_I32, _F64, _F64, _F64]: ...
    def video(
        self,
        values: ArrayLike,
        path: _Path,
        *,
        channel: int = 0,
        rate: float = 30.0,
        range: Sequence[float] | None = None,
        magnification: int = 4,
    ) -> None: ...
    def matrix(self, channel: int = 0) -> Matrix: ...
    def _marks(self) -> tuple[Matrix, _I64]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Renderer: ...

@final
class ContactTracker:
    def __new__(
        cls,
        map: Map,
        *,
        unit: str = "Pa",
        probe: Literal["any", "finger", "foot"] = "any",
        threshold: float | None = None,
        tared: bool = False,
        low: float | None = None,
        least: int = 2,
        prominence: float = 0.4,
        part: int = 4,
        noise_frames: int = 5,
        reach: float = 0.01,
        lasting: int = 1,
    ) -> ContactTracker: ...
    def track(self, values: ArrayLike, time: float | None = None) -> list[dict[str, Any]]: ...
    @property
    def threshold(self) -> float | None: ...
    @property
    def at_once(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class EventDetector:
    def __new__(
        cls,
        map: Map,
        *,
        unit: str = "Pa",
        probe: Literal["any", "finger", "foot"] = "any",
        threshold: float | None = None,
        tared: bool = False,
        words: Sequence[tuple[str, Sequence[float], str]] | None = None,
        **limits: float,
    ) -> EventDetector: ...
    def see(self, time: float, values: ArrayLike) -> list[dict[str, Any]]: ...
    def finish(self) -> list[dict[str, Any]]: ...
    @property
    def at_once(self) -> int: ...
    @property
    def threshold(self) -> float | None: ...

def diff(
    before: _Path, after: _Path, *, modules: Mapping[int, str] | None = None, sigma: float | None = None
) -> list[dict[str, Any]]: ...
def colours(values: _F32, mask: NDArray[np.bool_], range: Sequence[float]) -> NDArray[np.uint8]: ...

@final
class Layout(_Made):
    @staticmethod
    def read(path: _Path) -> Layout: ...
    @staticmethod
    def parse(text: str, name: str = "layout", folder: _Path | None = None) -> Layout: ...
    @overload
    @staticmethod
    def draft(
        file: Recording, cells: None = None, *, stream: str = "", says: dict[str, Any] | None = None
    ) -> Draft: ...
    @overload
    @staticmethod
    def draft(
        file: _Path, cells: Sequence[int], *, stream: str = "", says: dict[str, Any] | None = None
    ) -> str: ...
    @overload
    @staticmethod
    def draft(
        file: RecordingFile, cells: None = None, *, stream: str = "", says: dict[str, Any] | None = None
    ) -> str: ...
    @staticmethod
    def draft_columns(file: _Path, names: Sequence[str], *, says: dict[str, Any] | None = None) -> str | None: ...
    def named_columns(
        self, file: _Path, names: Sequence[str]
    ) -> tuple[list[int], int, list[list[int] | None]] | None: ...
    def decoder(
        self,
        file: _Path,
        cells: Sequence[int],
        *,
        stream: str = "",
        says: dict[str, Any] | None = None,
        zero: ArrayLike | None = None,
    ) -> Decoder: ...
    @property
    def stream(self) -> str | None: ...
    @property
    def axes(self) -> tuple[str, ...]: ...
    @property
    def frame_axis(self) -> int: ...
    @property
    def channels(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str, ...]: ...
    @property
    def time(self) -> dict[str, Any]: ...
    @property
    def zero_stream(self) -> str | None: ...
    @property
    def text(self) -> str: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Layout: ...

@final
class Decoder(_Made):
    def decode(
        self, raw: ArrayLike, times: ArrayLike | None = None, episode: int = 0, zero: ArrayLike | None = None
    ) -> tuple[NDArray[np.floating[Any]], _F64]: ...
    @property
    def ids(self) -> _U32: ...
    @property
    def channels(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str, ...]: ...
    @property
    def learn_frames(self) -> int: ...
    @property
    def rest(self) -> tuple[list[bool], float | None]: ...
    @property
    def kinds(self) -> tuple[str, ...] | None: ...
    @property
    def statements(self) -> list[tuple[str, str, str]]: ...

@final
class RecordingFile:
    def __new__(
        cls, path: _Path, stream: str | None = None, layout: Layout | None = None, episode: int | None = None
    ) -> RecordingFile: ...
    @staticmethod
    def is_known(path: _Path) -> bool: ...
    def next(self, frames: int) -> tuple[int, _F64, _F64] | None: ...
    def draft(self) -> str: ...
    @property
    def ids(self) -> _U32 | None: ...
    @property
    def channels(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str, ...]: ...
    @property
    def frames(self) -> int | None: ...
    @property
    def episodes(self) -> int: ...
    @property
    def rest(self) -> tuple[list[bool], float | None]: ...
    @property
    def kinds(self) -> tuple[str, ...] | None: ...
    @property
    def streams(self) -> dict[str, tuple[int, ...]]: ...
    @property
    def says(self) -> dict[str, Any]: ...
    @property
    def statements(self) -> list[tuple[str, str, str]]: ...

def read_readings(path: _Path, layout: Literal["tnc", "tcn"] = "tnc") -> dict[str, Any]: ...
def join_readings(
    map: Map, values: ArrayLike, ids: ArrayLike, names: Sequence[str], units: Sequence[str]
) -> tuple[_F64, list[str]]: ...
def condition_readings(
    map: Map,
    values: ArrayLike,
    ids: _U32 | None,
    timestamps: ArrayLike,
    channels: Sequence[str],
    units: Sequence[str],
    *,
    kinds: Sequence[str] | None = None,
    tared: Sequence[bool] = ...,
    baseline: int = 0,
    zero: str | None = None,
    gains: Sequence[tuple[int, float]] = ...,
    response: Response | None = None,
    clip: tuple[float, float] | None = None,
    split_hz: float | None = None,
    fill: str = "none",
) -> dict[str, Any]: ...
@final
class Response(_Made):
    @staticmethod
    def read(path: _Path) -> Response: ...
    def write(self, path: _Path) -> None: ...
    @property
    def ids(self) -> _I64: ...
    @property
    def zero(self) -> _F64: ...
    @property
    def gain(self) -> _F64: ...
    @property
    def exponent(self) -> _F64: ...
    @property
    def sigma(self) -> _F64: ...
    @property
    def states(self) -> list[str]: ...
    @property
    def unit(self) -> str: ...
    @property
    def channel(self) -> str: ...
    @property
    def scale(self) -> str | None: ...
    @property
    def method(self) -> str: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

def estimate_response(
    map: Map,
    recordings: Sequence[tuple[ArrayLike, ArrayLike, Sequence[str], Sequence[str], Sequence[str] | None, ArrayLike | None]],
    *,
    pressure: ArrayLike | None = None,
    force: ArrayLike | None = None,
    relative: Response | None = None,
    zero: float | None = None,
) -> Response: ...
def examine_taxels(
    map: Map,
    recordings: Sequence[tuple[ArrayLike, ArrayLike, Sequence[str], Sequence[str], Sequence[str] | None, ArrayLike | None]],
    *,
    threshold: float | None = None,
    modules: Sequence[tuple[int, str]] = ...,
    zero: float | None = None,
) -> tuple[list[dict[str, Any]], Response]: ...
def order_columns(
    map: Map,
    recordings: Sequence[tuple[ArrayLike, ArrayLike, Sequence[str], Sequence[str], Sequence[str] | None, ArrayLike | None]],
    *,
    known: Sequence[tuple[int, int]] = ...,
    threshold: float | None = None,
    zero: float | None = None,
) -> tuple[_I64, dict[str, Any]]: ...
def summarise_readings(
    map: Map,
    values: ArrayLike,
    timestamps: ArrayLike,
    channel: str,
    unit: str,
    *,
    kind: str | None = None,
    threshold: float | None = None,
    is_tared: bool = False,
    stated: float | None = None,
    probe: Literal["any", "finger", "foot"] = "any",
    level: str | None = None,
    by: Literal["group", "step"] = "group",
) -> tuple[list[dict[str, Any]], float | None, int]: ...
def main_channel(channels: Sequence[str], units: Sequence[str], kinds: Sequence[str] | None = None) -> int: ...
def is_extensive(name: str, unit: str) -> bool: ...
def is_of_touch(name: str, unit: str, kind: str | None = None) -> bool: ...
def is_same_unit(unit: str, other: str) -> bool: ...
def as_floats(name: str, value: ArrayLike) -> _F64: ...
def as_numbers(name: str, value: ArrayLike, count: int) -> _U32: ...
def simulate_touch(
    skin: Skin | Map,
    *,
    presses: int = 5,
    touches: int = 1,
    radius: float = 0.015,
    depth: float = 0.002,
    stiffness: float = 2e7,
    roll: float = 0.02,
    duration: float = 1.0,
    pause: float = 0.25,
    rate: float = 100.0,
    taxel_radius: float = 0.002,
    extensive: bool = True,
    noise: float = 0.0,
    drift: float = 0.0,
    dead: float = 0.0,
    seed: int = 0,
) -> dict[str, Any]: ...
@final
class Observations(_Made):
    @staticmethod
    def read(
        path: _Path,
        *,
        contacts: Sequence[_Path] | None = None,
        unit: _Unit | None = None,
        clip_information: bool = False,
    ) -> Observations: ...
    @staticmethod
    def from_columns(columns: Mapping[str, ArrayLike], *, unit: _Unit | None = None) -> Observations: ...
    def write(self, path: _Path) -> None: ...
    @property
    def remarks(self) -> list[str]: ...
    @property
    def n_taxels(self) -> int: ...
    @property
    def n_edges(self) -> int: ...
    @property
    def n_contacts(self) -> int: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Observations: ...

@final
class Calibration(_Made):
    @property
    def ids(self) -> _U32: ...
    @property
    def positions(self) -> _F64: ...
    @property
    def rotations(self) -> _F64: ...
    @property
    def covariances(self) -> _F64 | None: ...
    @property
    def cost(self) -> float: ...
    @property
    def chi2(self) -> float: ...
    @property
    def dof(self) -> int: ...
    @property
    def converged(self) -> bool: ...
    @property
    def rejected(self) -> tuple[_U32, _U32]: ...
    @property
    def residuals(self) -> list[_F64]: ...
    def skin(self, faces: ArrayLike | None = None) -> Skin: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Calibration: ...

def calibrate_taxels(observations: Observations, options: dict[str, Any], threads: int) -> Calibration: ...
def fit_bodies(
    observations: Observations,
    cad: Skin | Map | _Path,
    modules: dict[int, str] | _Path | None,
    options: dict[str, Any],
    threads: int,
) -> dict[str, Any]: ...
def write_taxels_of_bodies(
    path: _Path, rows: Sequence[tuple[int, Sequence[float], Sequence[float], Sequence[float], str, str]]
) -> None: ...
def contacts_of_log(log: dict[str, str] | _Path, arguments: dict[str, Any]) -> tuple[Observations, dict[str, Any]]: ...
@final
class TouchLines:
    def __new__(cls, lines: Iterable[str], unit: _Unit | None = None) -> TouchLines: ...
    def next(self) -> tuple[Observations, float | None] | None: ...
    @property
    def half_row(self) -> int | None: ...

@final
class TouchFollower(_Made):
    @staticmethod
    def of_taxels(options: dict[str, Any], every: int, threads: int) -> TouchFollower: ...
    @staticmethod
    def of_bodies(
        cad: Skin | Map | _Path,
        modules: dict[int, str] | _Path | None,
        options: dict[str, Any],
        every: int,
        threads: int,
    ) -> TouchFollower: ...
    def remarks_of(self, touch: Observations) -> list[str]: ...
    def push(
        self, touch: Observations
    ) -> tuple[int, list[int], float | None, int | None, bool | None, float | None, tuple[int, float] | None, int | None]: ...
    def finish(self) -> Calibration | dict[str, Any]: ...

def simulate(
    *,
    taxels: int = 500,
    model: Literal["positions", "poses"] = "positions",
    spacing: float = 5e-3,
    radius: float = 0.1,
    noise: float = 1e-3,
    rotation_noise: float | None = None,
    anchors: int = 0,
    anchor_noise: float = 1e-3,
    normal_noise: float | None = None,
    indentation: float = 0.0,
    arm_noise: float = 0.0,
    arm_rotation_noise: float = 0.0,
    outliers: float = 0.0,
    seed: int = 0,
) -> tuple[Observations, dict[str, Any]]: ...
@final
class Picture(_Made):
    def svg(self) -> str: ...
    def _repr_svg_(self) -> str: ...
    def png(self) -> bytes: ...
    def array(self) -> NDArray[np.uint8]: ...
    def save(self, path: _Path) -> None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __deepcopy__(self, _memo: Any) -> Picture: ...
