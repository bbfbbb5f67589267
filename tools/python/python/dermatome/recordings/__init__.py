"""Readers of containers: Zarr, LeRobot's Parquet, HDF5 and bags, each a module that needs its package when it is used."""

from __future__ import annotations

import os
from pathlib import Path

from dermatome._errors import FileError, MissingFileError
from dermatome.recordings._track import Block, Container, Track
from dermatome.recordings.areas import AREAS

__all__ = ["AREAS", "Block", "Container", "Track", "is_container", "open_container"]


def kind_of(path: str | os.PathLike[str]) -> str | None:
    """The kind of container at a path, by what is in it; None if it is none that is read here."""
    where = Path(path)
    if where.is_dir():
        if (where / "meta" / "info.json").is_file():
            return "lerobot"
        if (where / "metadata.yaml").is_file():
            return "bag"
        groups = (".zgroup", ".zarray", "zarr.json")
        inner = [each for each in where.iterdir() if each.is_dir()]
        is_zarr = any((folder / name).is_file() for folder in (where, *inner[:2]) for name in groups)
        return "zarr" if is_zarr or where.suffix == ".zarr" else None
    if not where.is_file():
        return None
    with open(where, "rb") as file:
        head = file.read(40)
    if head.startswith(b"version https://git-lfs.github.com/"):
        raise FileError(f"{path}: found a pointer of Git LFS; needed: the file that it stands for: git lfs pull", "pointer")
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return None if where.suffix.lower() in (".npz", ".xlsx") else "zarr"
    if head.startswith((b"\x89MCAP0", b"#ROSBAG", b"SQLite format 3")):
        return "bag"
    from dermatome.recordings.hdf5 import is_hdf5

    return "hdf5" if is_hdf5(where) else None


def is_container(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a container that is read here."""
    try:
        return kind_of(path) is not None
    except (OSError, ValueError):
        return False


def open_container(path: str | os.PathLike[str]) -> Container | None:
    """The container at a path; None if it is a file that the library may read itself."""
    if not Path(path).exists():
        raise MissingFileError(f"{path}: found nothing; needed: a recording", "missing")
    kind = kind_of(path)
    if kind == "lerobot":
        from dermatome.recordings.parquet import LeRobot

        return LeRobot(path)
    if kind == "bag":
        from dermatome.recordings.ros import Bag

        return Bag(path)
    if kind == "hdf5":
        from dermatome.recordings.hdf5 import Hdf5

        return Hdf5(path)
    if kind == "zarr" or Path(path).suffix.lower() == ".zip":
        from dermatome.recordings.oxt import Zarr

        return Zarr(path)
    return None
