import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

_Path = str | os.PathLike[str]
_Unit = Literal["m", "mm", "cm", "in"] | float
_Weld = Literal["auto", "all", "none", "texture"]
_Method = Literal["intrinsic", "conformal", "linear"]
_Energy = Literal["sum", "symmetric-dirichlet"]
_Overlap = Literal["prevent", "allow"]
_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]
_U32 = NDArray[np.uint32]
_I32 = NDArray[np.int32]
_I64 = NDArray[np.int64]

def run_command(args: Sequence[str]) -> int: ...
@final
class Skin:
    @staticmethod
    def read(
        path: _Path,
        *,
        unit: _Unit | None = None,
        gap: float = 2.5,
        weld: _Weld = "auto",
        repair: bool | None = None,
        outside: ArrayLike | None = None,
        fill_holes: int | None = None,
        patches: Sequence[str] | None = None,
        keep_going: bool = False,
    ) -> Skin: ...
    @staticmethod
    def from_bytes(data: bytes, kind: str = "glb") -> Skin: ...
    @staticmethod
    def from_arrays(
        positions: ArrayLike,
        faces: ArrayLike | None = None,
        *,
        normals: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        present: ArrayLike | None = None,
        link: str = "link",
        patch: str = "skin",
        gap: float = 2.5,
        weld: _Weld = "auto",
        repair: bool = False,
        outside: ArrayLike | None = None,
        fill_holes: int | None = None,
    ) -> Skin: ...
    def write(self, path: _Path) -> None: ...
    def to_bytes(self, kind: str = "glb") -> bytes: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
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
class Matrix:
    @property
    def indptr(self) -> _I64: ...
    @property
    def indices(self) -> _I64: ...
    @property
    def data(self) -> _F64: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def scipy(self) -> Any: ...

@final
class Map:
    @staticmethod
    def read(path: _Path) -> Map: ...
    @staticmethod
    def from_bytes(data: bytes) -> Map: ...
    def to_bytes(self) -> bytes: ...
    def write(self, path: _Path) -> None: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    @property
    def patches(self) -> dict[str, Patch]: ...
    @property
    def links(self) -> tuple[str, ...]: ...
    @property
    def n_taxels(self) -> int: ...
    @property
    def n_levels(self) -> int: ...
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
    def pooling(self, level: int, *, patch: str | None = None) -> Matrix: ...
    def pool(self, values: ArrayLike, level: int, *, extensive: bool = False, threads: int = 0) -> _F32: ...
    def index(self, *, levels: bool = False, fields: bool = False, threads: int = 0) -> Index: ...
    def to_skin(self, patch: str, uv: ArrayLike, *, level: int = 0) -> tuple[_F64, _F64, _F64]: ...

@final
class Patch:
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

@final
class Level:
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
    def origin(self) -> tuple[float, float]: ...
    @property
    def size(self) -> tuple[float, float]: ...
    @property
    def pixels(self) -> tuple[int, int]: ...
    @property
    def distortion(self) -> dict[str, Any]: ...
    def up(self) -> Matrix | None: ...

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
    boundary: str = "free",
    cut: Literal["auto", "none", "all"] | ArrayLike | None = None,
    max_area_ratio: float | None = None,
    pixel: float | None = None,
    keep_going: bool = False,
    threads: int = 0,
    progress: Callable[[str, int, int], object] | None = None,
) -> Map: ...
@final
class Hits:
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
    def error(self) -> _F64 | None: ...
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
    def fields(self) -> Matrix | None: ...
    def __len__(self) -> int: ...

@final
class Fields:
    @property
    def indptr(self) -> _I64: ...
    @property
    def patch(self) -> _I32: ...
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
    def __len__(self) -> int: ...

@final
class Index:
    def locate(
        self,
        points: ArrayLike,
        *,
        link: str | None = None,
        only_link: str | None = None,
        level: int | None = 0,
        threads: int = 0,
    ) -> Hits: ...
    def ray(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        *,
        longest: float | None = None,
        link: str | None = None,
        only_link: str | None = None,
        level: int | None = 0,
        threads: int = 0,
    ) -> Hits: ...
    def reactive(
        self,
        points: ArrayLike,
        level: int,
        *,
        link: str | None = None,
        only_link: str | None = None,
        threads: int = 0,
    ) -> Hits: ...
    def nearest(
        self,
        points: ArrayLike,
        count: int = 1,
        *,
        level: int = 0,
        link: str | None = None,
        only_link: str | None = None,
        threads: int = 0,
    ) -> Fields: ...
    def within(
        self,
        points: ArrayLike,
        radius: float,
        *,
        level: int = 0,
        link: str | None = None,
        only_link: str | None = None,
        threads: int = 0,
    ) -> Fields: ...
    def posed(self, poses: Mapping[str, ArrayLike]) -> Index: ...
    @property
    def poses(self) -> dict[str, _F64]: ...

@final
class Flattening:
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

def flatten(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    cut: Literal["auto", "none", "all"] | ArrayLike | None = None,
    max_area_ratio: float | None = None,
    method: _Method = "intrinsic",
    energy: _Energy = "sum",
    angle: float = 1.0,
    area: float = 1.0,
    perimeter: float = 0.0,
    magnify: float = 0.0,
    overlap: _Overlap = "prevent",
    boundary: str = "free",
    threads: int = 0,
) -> Flattening: ...
@final
class MeshLevel:
    @property
    def positions(self) -> _F64: ...
    @property
    def faces(self) -> _U32: ...
    @property
    def areas(self) -> _F64: ...
    @property
    def origins(self) -> _U32: ...
    def pooling(self) -> Matrix: ...

def coarsen(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    ratio: float | None = None,
    levels: int | None = None,
    coarsest: int = 32,
    threads: int = 0,
) -> list[MeshLevel]: ...
