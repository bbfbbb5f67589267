"""Arrays of Zarr, formats 2 and 3, in folders and zip archives.

Decoded by `numcodecs`, without the package zarr: an array is checked before it is read. Writers leave out chunks that are
their fill value throughout, and a copy may have lost some: a missing chunk is taken for the fill value only where a stored
one has a whole frame of it and none has nothing else, and it is stated. No chunk is larger than the array says.
"""

from __future__ import annotations

import itertools
import math
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._errors import DataError, FileError
from dermatome.recordings._track import MOST_BYTES, MOST_JSON, bytes_of, read_json, sizes, small_enough

# The index of a shard has the numbers of no chunk here.
ABSENT = 2**64 - 1
# Bytes of the header of a Blosc buffer: version, flags, item size, and the numbers of bytes before and after compression.
BLOSC_HEADER = 16
COMPRESSORS = ("blosc", "zstd", "lz4", "crc32c")
# The most chunks of an array of which some are not stored: their names are listed.
MOST_CHUNKS = 1 << 20
# Of so many of these the neighbours are looked at.
SAMPLED = 4
TYPES = ("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float16", "float32", "float64")


class Store:
    """The files of a folder or of a zip archive, by their names."""

    def __init__(self, path: Any) -> None:
        self.path = str(path)
        self.archive: zipfile.ZipFile | None = None
        self.root = ""
        if Path(path).is_dir():
            self.names = {
                str(Path(folder, name).relative_to(path)).replace(os.sep, "/")
                for folder, _, names in os.walk(path)
                for name in names
            }
        else:
            try:
                self.archive = zipfile.ZipFile(path)
            except (OSError, zipfile.BadZipFile, NotImplementedError, ValueError) as error:
                needed = "a whole archive; copy it again"
                raise FileError(f"{path}: found a zip archive that cannot be read: {error}; needed: {needed}", "zip") from error
            self.names = {name for name in self.archive.namelist() if not name.endswith("/")}
        if not any(name in self.names for name in (".zgroup", ".zarray", "zarr.json")):
            inner = {name.split("/")[0] for name in self.names if name.count("/") and name.split("/")[1] in (".zgroup", ".zarray", "zarr.json")}
            if len(inner) != 1:
                found = f"{len(inner)} folders with Zarr groups" if inner else "no .zgroup and no zarr.json"
                raise FileError(f"{path}: found {found}; needed: a Zarr group, at the root or in one folder", "zarr")
            self.root = f"{inner.pop()}/"
            self.names = {name[len(self.root) :] for name in self.names if name.startswith(self.root)}

    def read(self, name: str, most: int) -> bytes:
        """A file of at most `most` bytes."""
        if self.archive is None:
            data = bytes_of(Path(self.path, self.root + name), most)
        else:
            try:
                with self.archive.open(self.root + name) as file:
                    data = file.read(most + 1)
            except (OSError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
                needed = "the archive as it was written; copy it again"
                raise FileError(f"{self.path}: {name}: cannot be read: {error}; needed: {needed}", "zip") from error
        if len(data) > most:
            raise FileError(f"{self.path}: {name}: found more than {most} bytes; needed: at most what the array's shape takes", "too-large")
        return data

    def arrays(self) -> list[str]:
        """The names of all arrays; that of the store itself is empty."""
        made = [name.rpartition("/")[0] for name in self.names if name.rpartition("/")[2] == ".zarray"]
        for name in self.names:
            if name.rpartition("/")[2] == "zarr.json" and self.json(name).get("node_type") == "array":
                made.append(name.rpartition("/")[0])
        return sorted(made)

    def json(self, name: str) -> dict[str, Any]:
        """A file of JSON; empty where there is none."""
        return read_json(self.path, self.read(name, MOST_JSON), name) if name in self.names else {}


class Array:
    """An array, read along its first axis."""

    def __init__(self, store: Store, name: str) -> None:
        np = need("numpy", "zarr")
        self.store, self.name, self.where = store, name, f"{store.path}: {name}" if name else store.path
        self.folder = f"{name}/" if name else ""
        # Chunks that are not stored and were read as the fill value.
        self.filled: set[str] = set()
        # What `complete` has found: a store of many files is not searched for each episode.
        self.is_complete: dict[bool, bool] = {}
        self.may_fill: bool | None = None
        self.dtype: Any = np.dtype("u1")
        self.shape: Any = ()
        # Chunks are files; a shard is a file of inner chunks.
        self.chunk: Any = ()
        self.inner: Any = ()
        self.shard: Any = None
        about = store.json(f"{self.folder}.zarray")
        self.format = 2 if about else 3
        about = about or store.json(f"{self.folder}zarr.json")
        if about.get("zarr_format") != self.format:
            raise FileError(f"{self.where}: found zarr_format {about.get('zarr_format')!r}; needed: 2 or 3", "zarr")
        try:
            self._describe(np, about)
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            if isinstance(error, DataError):
                raise
            what = f"no {error}" if isinstance(error, KeyError) else str(error)
            raise FileError(f"{self.where}: found metadata that cannot be used: {what}; needed: those of Zarr 2 or 3", "zarr") from error
        if self.dtype.kind not in "biufUSO":
            raise DataError(f"{self.where}: found the type {self.dtype}; needed: numbers or text")
        self.shape = sizes(store.path, name, self.shape, self.dtype.itemsize)
        self.chunk = sizes(store.path, name, self.chunk, self.dtype.itemsize)
        self.inner = sizes(store.path, name, self.inner, self.dtype.itemsize)
        wrong = len(self.chunk) != len(self.shape) or 0 in self.chunk or 0 in self.inner
        if wrong or len(self.inner) != len(self.chunk) or any(a % b for a, b in zip(self.chunk, self.inner)):
            raise DataError(f"{self.where}: found chunks {self.chunk} of {self.inner} for the shape {self.shape}; needed: one size for each axis")
        self.bytes = small_enough(store.path, name, self.inner, self.dtype.itemsize)
        small_enough(store.path, name, self.chunk, self.dtype.itemsize)
        self.attributes = about.get("attributes") or store.json(f"{self.folder}.zattrs")
        self.fill = self._fill(np, about.get("fill_value"))
        # Decoded chunks by file and place, each with the first frame behind it; and the shard that was read last.
        self.kept: dict[tuple[str, tuple[int, ...]], tuple[int, Any]] = {}
        self.shard_kept: tuple[str, bytes, Any] | None = None

    def _describe(self, np: Any, about: dict[str, Any]) -> None:
        self.shape = about["shape"]
        if self.format == 2:
            if not isinstance(about["dtype"], str):
                raise DataError(f"{self.where}: found records {about['dtype']!r}; needed: numbers")
            self.dtype, self.chunk, self.inner = np.dtype(about["dtype"]), about["chunks"], about["chunks"]
            self.order, separator, self.prefix = about.get("order", "C"), about.get("dimension_separator", "."), ""
            codecs = list(about.get("filters") or []) + ([about["compressor"]] if about.get("compressor") else [])
            self.codecs = [(str(codec["id"]), codec) for codec in codecs]
        else:
            kind = about["data_type"]
            if kind not in TYPES:
                raise DataError(f"{self.where}: found the type {kind!r}; needed: one of {', '.join(TYPES)}")
            self.dtype, self.order = np.dtype(kind), "C"
            self.chunk = about["chunk_grid"]["configuration"]["chunk_shape"]
            keys: Any = about["chunk_key_encoding"]
            separator = (keys.get("configuration") or dict[str, Any]()).get("separator", "/" if keys["name"] == "default" else ".")
            self.prefix = f"c{separator}" if keys["name"] == "default" else ""
            codecs, self.inner = about["codecs"], self.chunk
            if codecs[0]["name"] == "sharding_indexed" and len(codecs) == 1:
                self.shard = codecs[0]["configuration"]
                codecs, self.inner = self.shard["codecs"], self.shard["chunk_shape"]
                names = [codec["name"] for codec in self.shard["index_codecs"]]
                if names not in (["bytes"], ["bytes", "crc32c"]):
                    raise DataError(f"{self.where}: found an index of {names}; needed: bytes, crc32c")
                self.checksum = names[-1] == "crc32c"
            self.codecs = [(str(codec["name"]), codec.get("configuration") or dict[str, Any]()) for codec in codecs]
            while self.codecs and self.codecs[0][0] == "bytes":
                if self.codecs.pop(0)[1].get("endian") == "big":
                    self.dtype = self.dtype.newbyteorder(">")
        if separator not in (".", "/") or self.order not in ("C", "F"):
            raise DataError(f"{self.where}: found separator {separator!r}, order {self.order!r}; needed: '.' or '/', 'C' or 'F'")
        self.separator = separator

    def _fill(self, np: Any, value: Any) -> Any:
        """The value of a chunk that is not stored; None if there is none."""
        try:
            found = np.asarray(value, self.dtype) if self.dtype.kind in "biuf" and value is not None else None
        except (TypeError, ValueError, OverflowError):
            return None
        return None if found is None or found.shape else found

    def complete(self, constant: bool = False) -> None:
        """Refuses an array of which a chunk is missing that may be lost. A constant may have none."""
        if 0 in self.shape or self.is_complete.get(constant):
            return
        counts = [math.ceil(size / chunk) for size, chunk in zip(self.shape, self.chunk)]
        # Names are counted first: a shape can claim more chunks than could be listed.
        first = f"{self.folder}{self.prefix}"
        found = sum(name.startswith(first) and name[len(first) :].replace(self.separator, "").isdigit() for name in self.store.names)
        known = self._known(counts) if math.prod(counts) <= max(found, MOST_CHUNKS) else {}
        missing = next((key for key, there in known.items() if not there), None)
        self.is_complete[constant] = bool(known) and missing is None
        if self.is_complete[constant]:
            return
        is_whole = bool(known) and sum(known.values()) == found and self.fill is not None
        if not is_whole or not (found or constant) or (found and not self._may_fill()):
            which = f"no chunk {self._file(missing)}" if missing and found >= len(known) else f"{found} chunks"
            needed = f"all {math.prod(counts)}; readers of Zarr give fill values for the others, which look like readings; copy the file again"
            raise DataError(f"{self.where}: found {which}; needed: {needed}")
        self.is_complete[constant] = True

    def _known(self, counts: list[int]) -> dict[tuple[int, ...], bool]:
        """Whether each chunk is stored."""
        return {key: self._file(key) in self.store.names for key in itertools.product(*map(range, counts))}

    def _may_fill(self) -> bool:
        """Whether chunks that are not stored may be those of fill values: one that is has a frame of them, and none is full of them."""
        if self.fill is None or self.may_fill is not None:
            return bool(self.may_fill)
        known = list(self._known([math.ceil(size / chunk) for size, chunk in zip(self.shape, self.chunk)]).items())
        stored = [at for at, (_, there) in enumerate(known) if there]
        # The chunks beside some that are missing, the first and the last.
        missing = [at for at, (_, there) in enumerate(known) if not there][:SAMPLED]
        beside = {near for at in missing for near in (at - 1, at + 1) if 0 <= near < len(known) and known[near][1]}
        frames: list[Any] = []
        for at in sorted(beside | {*stored[:1], *stored[-1:]}):
            for piece in self._stored_pieces(known[at][0]):
                frames.append((piece == self.fill).reshape(len(piece), -1).all(axis=1))
        self.may_fill = any(bool(each.any()) for each in frames) and not any(bool(each.all()) for each in frames)
        return self.may_fill

    def _stored_pieces(self, key: tuple[int, ...]) -> Iterator[Any]:
        """The numbers of a chunk that are within the shape: of each inner chunk that is stored."""
        corner, file = tuple(k * size for k, size in zip(key, self.chunk)), self._file(key)
        pieces = [(corner, self._decoded(file))] if self.shard is None else [
            (tuple(a + k * size for a, k, size in zip(corner, inner, self.inner)), self._numbers(data, f"{self.store.path}: {file}"))
            for inner, data in self._stored(file)
            if data is not None
        ]
        for at, piece in pieces:
            if all(a < size for a, size in zip(at, self.shape)):
                yield piece[tuple(slice(0, size - a) for a, size in zip(at, self.shape))]

    def _file(self, key: tuple[int, ...]) -> str:
        return f"{self.folder}{self.prefix}{self.separator.join(map(str, key))}" if key else f"{self.folder}{self.prefix.rstrip('/.') or '0'}"

    def read(self, start: int, stop: int) -> Any:
        """The frames from `start` to `stop`."""
        np = need("numpy", "zarr")
        made = np.empty((stop - start, *self.shape[1:]), self.dtype)
        for at, piece in self._pieces(start, stop):
            low, high = max(start, at[0]), min(stop, at[0] + len(piece))
            rest = [slice(a, min(a + n, size)) for a, n, size in zip(at[1:], piece.shape[1:], self.shape[1:])]
            made[(slice(low - start, high - start), *rest)] = piece[(slice(low - at[0], high - at[0]), *(slice(s.stop - s.start) for s in rest))]
        self.kept = {key: each for key, each in self.kept.items() if each[0] > stop}
        return made

    def whole(self, most: int = 1 << 24) -> Any:
        """All numbers, where they are few."""
        if math.prod(self.shape) > most:
            raise DataError(f"{self.where}: found the shape {self.shape}; needed: at most {most} numbers")
        return self.read(0, self.shape[0])

    def _pieces(self, start: int, stop: int) -> Iterator[tuple[tuple[int, ...], Any]]:
        """The first index and the numbers of each inner chunk."""
        if start >= stop or 0 in self.shape:
            return
        counts = [math.ceil(size / chunk) for size, chunk in zip(self.shape, self.chunk)]
        rows = range(start // self.chunk[0], (stop - 1) // self.chunk[0] + 1)
        for key in itertools.product(rows, *map(range, counts[1:])):
            file, corner = self._file(key), tuple(k * size for k, size in zip(key, self.chunk))
            if self.shard is None:
                yield corner, self._decoded(file, corner[0] + self.chunk[0])
            elif file not in self.store.names:
                yield corner, self._filled(file, self.chunk)
            else:
                yield from self._inner(file, corner, start, stop)

    def _inner(self, file: str, corner: tuple[int, ...], start: int, stop: int) -> Iterator[tuple[tuple[int, ...], Any]]:
        """The inner chunks of a shard that some frames are in."""
        np = need("numpy", "zarr")
        data, table = self._opened(file)
        # Those that are within the shape.
        there = [min(a // n, math.ceil((size - at) / n)) for a, n, size, at in zip(self.chunk, self.inner, self.shape, corner)]
        absent = (table[..., 0] == ABSENT)[tuple(map(slice, there))]
        if absent.any() and not self._may_fill():
            missing = tuple(np.argwhere(absent)[0].tolist())
            needed = "all; readers of Zarr give fill values, which look like readings; write it with write_empty_chunks"
            raise DataError(f"{self.store.path}: {file}: found no chunk {missing}; needed: {needed}")
        rows = range(max(0, (start - corner[0]) // self.inner[0]), min(there[0], math.ceil((stop - corner[0]) / self.inner[0])))
        for inner in itertools.product(rows, *map(range, there[1:])):
            at = tuple(a + k * size for a, k, size in zip(corner, inner, self.inner))
            if absent[inner]:
                yield at, self._filled(f"{file} {inner}", self.inner)
            else:
                first, count = table[inner].tolist()
                decode = partial(self._numbers, data[first : first + count], f"{self.store.path}: {file}")
                yield at, self._once((file, inner), at[0] + self.inner[0], decode)

    def _filled(self, file: str, shape: Any) -> Any:
        """A chunk that is not stored."""
        self.filled.add(file)
        return need("numpy", "zarr").full(shape, self.fill, self.dtype)

    def _decoded(self, file: str, end: int = 0) -> Any:
        if file not in self.store.names:
            return self._filled(file, self.inner)
        most = 2 * self.bytes + (1 << 16)
        return self._once((file, ()), end, lambda: self._numbers(self.store.read(file, most), f"{self.store.path}: {file}"))

    def _once(self, key: tuple[str, tuple[int, ...]], end: int, decode: Callable[[], Any]) -> Any:
        """The numbers of a chunk that ends before a frame. Frames are read in order: chunks that a block ends in are the first of the
        next one."""
        if key not in self.kept:
            made = decode()
            while self.kept and (len(self.kept) + 1) * self.bytes > MOST_BYTES:
                del self.kept[next(iter(self.kept))]
            self.kept[key] = (end, made)
        return self.kept[key][1]

    def _stored(self, file: str) -> Iterator[tuple[tuple[int, ...], bytes | None]]:
        """The inner chunks of a shard, None where one is not stored."""
        np = need("numpy", "zarr")
        data, table = self._opened(file)
        for key in np.ndindex(*table.shape[:-1]):
            first, count = table[key].tolist()
            yield key, None if first == ABSENT else data[first : first + count]

    def _opened(self, file: str) -> tuple[bytes, Any]:
        """The bytes of a shard, and where each inner chunk begins in them and how many it has."""
        if self.shard_kept is not None and self.shard_kept[0] == file:
            return self.shard_kept[1:]
        np = need("numpy", "zarr")
        self.shard_kept = None
        counts = [a // b for a, b in zip(self.chunk, self.inner)]
        index = 16 * math.prod(counts) + 4 * self.checksum
        where = f"{self.store.path}: {file}"
        data = self.store.read(file, 2 * self.dtype.itemsize * math.prod(self.chunk) + index + (1 << 16))
        if len(data) < index:
            raise FileError(f"{where}: found {len(data)} bytes; needed: an index of {index}", "zarr")
        stored = data[:index] if self.shard.get("index_location") == "start" else data[-index:]
        if self.checksum:
            if crc32c(stored[:-4]) != int.from_bytes(stored[-4:], "little"):
                raise FileError(f"{where}: found an index with another checksum; needed: the file as it was written", "zarr")
            stored = stored[:-4]
        big = self.shard["index_codecs"][0].get("configuration", {}).get("endian") == "big"
        table = np.frombuffer(stored, ">u8" if big else "<u8").reshape(*counts, 2)
        first, count = table[..., 0], table[..., 1]
        absent = (first == ABSENT) & (count == ABSENT)
        beyond = ~absent & ((first > len(data)) | (count > len(data) - np.minimum(first, len(data))))
        if beyond.any():
            at, size = table[beyond][0].tolist()
            raise FileError(f"{where}: found a chunk that ends at byte {at + size}; needed: at most {len(data)}", "zarr")
        self.shard_kept = (file, data, table)
        return data, table

    def _numbers(self, data: bytes, where: str) -> Any:
        np = need("numpy", "zarr")
        found: Any = data
        for name, options in reversed(self.codecs):
            found = self._decode(name, options, found, where)
        if self.dtype.kind == "O":
            array = np.asarray(found, object).ravel()
        else:
            array = np.frombuffer(memoryview(found).cast("B") if len(found) else b"", self.dtype) if len(found) == self.bytes else None
        if array is None or array.size != math.prod(self.inner):
            raise FileError(f"{where}: found {len(found)} bytes; needed: {self.bytes}, those of {self.inner} numbers", "zarr")
        return array.reshape(self.inner, order=self.order)

    def _decode(self, name: str, options: dict[str, Any], data: Any, where: str) -> Any:
        """What a codec makes of bytes; their number is known before, so that a lie takes no memory."""
        most = self.bytes + 64  # A checksum may follow.
        found: Any
        try:
            if name in ("gzip", "zlib"):
                decoder = zlib.decompressobj(zlib.MAX_WBITS | 32)
                found = decoder.decompress(bytes(data), most + 1)
                claimed = len(found) if decoder.eof else most + 1
            else:
                claimed = size_in(name, data)
                if name == "vlen-utf8" or self.dtype.kind == "O":
                    if name != "vlen-utf8" or claimed > math.prod(self.inner):
                        raise ValueError(f"objects by {name}")
                elif claimed > most:
                    raise ValueError(f"{claimed} bytes")
                # The options of compressors are for writing, and differ between the formats.
                codec = need("numcodecs.registry", "zarr").get_codec({**({} if name in COMPRESSORS else options), "id": name})
                found = codec.decode(data)
        except ImportError:
            raise
        except Exception as error:  # Each codec has errors of its own.
            if type(error).__name__ == "UnknownCodecError" or "codec not available" in str(error):
                raise DataError(f"{where}: found the codec {name!r}; needed: one that numcodecs has; write the array with another") from None
            raise FileError(f"{where}: cannot be decoded by {name}: {error}; needed: {self.bytes} bytes", "zarr") from error
        if claimed > most and self.dtype.kind != "O":
            raise FileError(f"{where}: found {claimed} bytes or more by {name}; needed: {self.bytes}", "zarr")
        if hasattr(found, "tobytes") and self.dtype.kind != "O":
            found = found.reshape(-1).view("u1").data
        return found


def size_in(name: str, data: Any) -> int:
    """How many bytes (items of text) an encoded buffer says that it decodes to."""
    head = bytes(data[:18])

    def number(at: int, size: int) -> int:
        return int.from_bytes(head[at : at + size], "little")

    if name == "blosc":
        if len(head) < BLOSC_HEADER or number(12, 4) != len(data):
            raise ValueError(f"{len(data)} bytes of {number(12, 4)}")
        return number(4, 4)
    if name == "lz4" or name == "vlen-utf8":
        return number(0, 4)
    if name == "zstd":
        if number(0, 4) != 0xFD2FB528:
            raise ValueError("no zstd frame")
        flags = head[4]
        size, single = flags >> 6, flags >> 5 & 1
        if not size and not single:
            raise ValueError("a frame that does not say its size")
        at = 5 + (1 - single) + (0, 1, 2, 4)[flags & 3]
        return number(at, 1 << size) + (256 if size == 1 else 0)
    return len(data)


def _crc_table() -> tuple[int, ...]:
    """The checksum of each byte, by Castagnoli's polynomial, reflected."""
    made: list[int] = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
        made.append(byte)
    return tuple(made)


CRC = _crc_table()


def crc32c(data: bytes) -> int:
    """The checksum of the index of a shard."""
    crc, table = 0xFFFFFFFF, CRC
    for byte in data:
        crc = crc >> 8 ^ table[crc & 255 ^ byte]
    return crc ^ 0xFFFFFFFF
