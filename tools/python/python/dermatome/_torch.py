"""The classes of `dermatome.torch`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch  # type: ignore[import-not-found, unused-ignore]

from dermatome._arguments import A_MAP, READINGS, check_kind, flag_of, items_of, mapping_of, number_of, whole_of
from dermatome._dermatome import ContactTracker, Map, Renderer, as_floats, main_channel
from dermatome._errors import ArgumentError, DataError
from dermatome._readings import Readings, frames_of
from dermatome._torch_augment import Augment
from dermatome._weights import marks, shares

# A value whose weights have a smaller sum, in pixels, is shown by none, as the renderer has it.
LEAST_SEEN = 1e-3
# Times of a truth are those of its frames to this, in s.
SAME_TIME = 1e-6


def tensor_of(array: Any) -> Any:
    """The tensor of an array, which torch does not type."""
    untyped: Any = torch
    return untyped.from_numpy(array)


class _Gather(torch.nn.Module):  # type: ignore[misc, unused-ignore]
    """Weighted sums of values that are known: `rows[k]` gets `weights[k]` of `columns[k]`."""

    rows: torch.Tensor
    columns: torch.Tensor
    weights: torch.Tensor

    def __init__(self, rows: Any, columns: Any, weights: Any, shape: tuple[int, int]) -> None:
        super().__init__()  # pyright: ignore[reportUnknownMemberType]
        self.shape = (int(shape[0]), int(shape[1]))
        self.keep("rows", rows, np.int64)
        self.keep("columns", columns, np.int64)
        self.keep("weights", weights, np.float32)

    def keep(self, name: str, numbers: Any, dtype: Any) -> None:
        """A buffer that no checkpoint has: it follows from the map of this module, also where a checkpoint is of another."""
        self.register_buffer(name, tensor_of(np.array(numbers, dtype=dtype)), persistent=False)

    def flat(self, values: Any) -> Any:
        """Values (..., columns) as (columns, frames), whole numbers as floats."""
        if values.shape[-1] != self.shape[1]:
            raise DataError(f"values: found shape {tuple(values.shape)}; needed: shape (..., {self.shape[1]})")
        values = values if values.is_floating_point() else values.to(torch.get_default_dtype())
        return values.reshape(-1, self.shape[1]).T

    def gather(self, values: Any) -> tuple[Any, Any]:
        """The sums (rows, ...) and the weights that they have, of values (..., columns)."""
        flat = self.flat(values)
        known = torch.isfinite(flat)
        weights = self.weights.to(flat.dtype)[:, None]
        sums = flat.new_zeros((self.shape[0], flat.shape[1]))
        parts = torch.where(known, flat, torch.zeros_like(flat)).index_select(0, self.columns) * weights
        shares = known.to(flat.dtype).index_select(0, self.columns) * weights
        return sums.index_add(0, self.rows, parts), sums.index_add(0, self.rows, shares)


class Pool(_Gather):
    """Pools readings (..., N) to the fields of a level (..., fields), as `Map.pool`: NaN where no taxel has a reading.

    It has no parameters; its buffers move to a device and are copied with the module, and gradients flow through it. They
    are not in a `state_dict`: a checkpoint goes to the same policy on another skin.

    Parameters
    ----------
    map : Map
        The map.
    level : int or str
        The level; a patch without it has its coarsest level. Or one of the whole body, as "body.L0".
    patch : str, optional
        A patch, whose readings and fields alone there are then.
    extensive : bool
        Whether readings are amounts, as forces: their total is the same on every level.
    modality : str, optional
        Of which modality besides touch they are, as "thermal" (`Readings.modalities` says so).

    Raises
    ------
    DataError
        If the map has no such level or patch, or, when it is called, values have another number of taxels.

    Examples
    --------
    >>> import dermatome, torch
    >>> from dermatome.torch import Pool
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> bool(abs(Pool(palm, 1, extensive=True)(torch.ones(4, 2, 81)).sum(dim=-1) - 81).max() < 1e-3)
    True
    """

    def __init__(
        self, map: Map, level: int | str, *, patch: str | None = None, extensive: bool = False, modality: str | None = None
    ) -> None:
        taxel, field, weight, shape = shares(map, level, patch, flag_of("extensive", extensive), modality)
        # Averages need shares, not areas: those of a field have the sum 1 if none is missing.
        scale = 1.0 if extensive else np.bincount(field, weights=weight, minlength=shape[0])[field]
        super().__init__(field, taxel, weight / scale, shape)
        self.extensive = extensive

    def forward(self, values: Any) -> Any:
        sums, shares = self.gather(values)
        known = shares > 0
        if not self.extensive:
            sums = sums / torch.where(known, shares, torch.ones_like(shares))
        pooled = torch.where(known, sums, torch.full_like(sums, torch.nan))
        return pooled.T.reshape(*values.shape[:-1], self.shape[0])


class Draw(_Gather):
    """Draws values of the fields of a level (..., fields) as images (..., H, W): averages, or amounts per m^2 of the map where
    the renderer draws amounts.

    Images are those of the renderer: a pixel with missing (NaN) values around it follows from the others. Fields are those of
    the whole map, as `Pool` without a patch and `Map.pool` give them, also where the renderer draws one patch. As with `Pool`,
    no buffer is in a `state_dict`.

    Parameters
    ----------
    renderer : Renderer
        What draws the level; its channels are all amounts or all averages.
    fill : float
        What is drawn where nothing is known, in the unit of the images; NaN by default.

    Raises
    ------
    DataError
        If the renderer draws amounts and averages, or, when it is called, values have another number of fields.

    Examples
    --------
    >>> import dermatome, torch
    >>> from dermatome.torch import Draw, Pool
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> draw = torch.nn.Sequential(Pool(palm, 1), Draw(palm.renderer(1, size=(32, 32)), fill=0.0))
    >>> draw(torch.ones(8, 81)).shape
    torch.Size([8, 32, 32])
    """

    drawn: torch.Tensor
    nearest: torch.Tensor

    def __init__(self, renderer: Renderer, *, fill: float = float("nan")) -> None:
        check_kind("renderer", renderer, Renderer, "a Renderer, as Map.renderer makes it")
        pixel, value, weight, shape, nearest = marks(renderer)
        super().__init__(pixel, value, weight, shape)
        if len(set(renderer.extensive)) > 1:
            raise DataError("renderer: found channels that are amounts and others that are averages; needed: one of the two")
        self.size, self.fill, self.extensive = renderer.shape, number_of("fill", fill, "a number"), renderer.extensive[0]
        # Of a pixel, in m^2.
        self.area = renderer.pixel[0] * renderer.pixel[1]
        self.keep("drawn", np.flatnonzero(nearest >= 0), np.int64)
        self.keep("nearest", nearest[nearest >= 0], np.int64)

    def forward(self, values: Any) -> Any:
        if self.extensive:
            return self.amounts(values)
        sums, shares = self.gather(values)
        known = shares > 0
        drawn = torch.where(known, sums / torch.where(known, shares, torch.ones_like(shares)), torch.full_like(sums, self.fill))
        return drawn.T.reshape(*values.shape[:-1], *self.size)

    def amounts(self, values: Any) -> Any:
        """Amounts per m^2: each divided by the area of its pixels, or given to the nearest where it has none."""
        flat = self.flat(values)
        known = torch.isfinite(flat)
        amounts = torch.where(known, flat, torch.zeros_like(flat)) / self.area
        pixels, fields = (flat.new_zeros((count, flat.shape[1])) for count in self.shape)
        weights = known.to(flat.dtype).index_select(0, self.columns) * self.weights.to(flat.dtype)[:, None]
        sums = pixels.index_add(0, self.rows, weights)
        weights = weights / torch.where(sums > 0, sums, torch.ones_like(sums)).index_select(0, self.rows)
        seen = fields.index_add(0, self.columns, weights)
        is_seen = seen > LEAST_SEEN
        scaled = torch.where(is_seen, amounts / torch.where(is_seen, seen, torch.ones_like(seen)), torch.zeros_like(seen))
        drawn = pixels.index_add(0, self.rows, weights * scaled.index_select(0, self.columns))
        lost = (known & ~is_seen).index_select(0, self.drawn)
        drawn = drawn.index_add(0, self.nearest, torch.where(lost, amounts.index_select(0, self.drawn), torch.zeros_like(amounts[:1])))
        is_shown = pixels.index_add(0, self.nearest, lost.to(flat.dtype)) + sums > 0
        drawn = torch.where(is_shown, drawn, torch.full_like(drawn, self.fill))
        return drawn.T.reshape(*values.shape[:-1], *self.size)


class Touches(torch.utils.data.Dataset):  # type: ignore[misc, type-arg, unused-ignore]
    """A recording as a data set: for each frame its image, its fields and its contact.

    `dataset[k]` is a dict of tensors:

    - `image` (C, H, W) float32 and `mask` (C, H, W) bool, where it shows a known reading; `fill` elsewhere. Amounts, as
      forces, are drawn per m^2;
    - `fields` (C, fields) float32 and `valid` (C, fields) bool, where they are known; 0 elsewhere. Amounts keep their total;
    - `contact`: a dict of `touched` (bool), and of the strongest contact `force` (N, 0 without one; NaN where the unit is of no
      force or pressure), `centre` (3,) in m in the frame of its link, and `patch`, its number among those of the map (-1
      without one).

    It goes to forked and spawned workers: each makes the renderer of its own when it draws the first time. A loader that
    takes batches draws each at once.

    Parameters
    ----------
    map : Map
        The map.
    readings : Readings
        The recording, in the order of the map or with ids.
    truth : dict, optional
        The contacts of these frames, as `touch` returns them, its `time` that of the frame; by default a `ContactTracker`
        finds them in the first channel that measures touches.
    level : int or str
        The level of the fields; also one of `Map.field_levels`, as "body.L0".
    size : sequence of int
        Height and width of the images, which show level 0.
    patch : str, optional
        The patch that they show; by default all, packed if there are several.
    fill : float
        What is drawn where nothing is known, in the unit of the images.
    threshold : float, optional
        That of the `ContactTracker`, in the unit of the readings; by default that of the file, or else estimated.
    actions : (T, A) array_like, optional
        What a policy did in each frame: `action` (A,) float32 of the sample.
    history : int
        How many frames, the latest last, are in `image`, `mask`, `fields` and `valid`, which then have an axis of them in
        front; before the first frame is the first, also of a later episode, where times begin again. 1 by default, without that
        axis.
    augment : Augment, optional
        What changes the readings of each sample before they are drawn, and its contact.
    transform : callable, optional
        What is called with each sample and returns it, changed.

    Raises
    ------
    DataError
        If readings, truth or actions are not of these taxels and frames, or the map has no such level or patch.
    IndexError
        If there is no such frame, when a sample is asked for.

    Examples
    --------
    >>> import dermatome, torch
    >>> from dermatome.torch import Touches
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> touches = Touches(palm, *dermatome.touch(palm, presses=1), size=[32, 32])
    >>> batch = next(iter(torch.utils.data.DataLoader(touches, batch_size=8)))
    >>> batch["image"].shape, batch["contact"]["centre"].shape
    (torch.Size([8, 1, 32, 32]), torch.Size([8, 3]))
    """

    def __init__(
        self,
        map: Map,
        readings: Readings,
        truth: dict[str, Any] | None = None,
        *,
        level: int | str = 1,
        size: Sequence[int] = (64, 64),
        patch: str | None = None,
        fill: float = 0.0,
        threshold: float | None = None,
        actions: Any = None,
        history: int = 1,
        augment: Augment | None = None,
        transform: Callable[[dict[str, Any]], Any] | None = None,
    ) -> None:
        self.history, self.transform = whole_of("history", history, "a number of frames above 0"), transform
        if self.history < 1:
            raise DataError(f"history: found {history}; needed: a number of frames above 0")
        if transform is not None and not callable(transform):
            raise ArgumentError(f"transform: found {type(transform).__name__}; needed: a function of a sample")
        check_kind("map", map, Map, A_MAP)
        check_kind("readings", readings, Readings, READINGS)
        if augment is not None:
            check_kind("augment", augment, Augment, "an Augment")
            if augment.map != map:
                raise DataError("augment: found one of another map; needed: that of the readings")
        self.augment = augment
        self.actions: Any = None if actions is None else as_floats("actions", actions).astype(np.float32)
        if self.actions is not None:
            if self.actions.shape[:1] != (len(readings),):
                raise DataError(f"actions: found shape {self.actions.shape}; needed: a row for each of {len(readings)} frames")
            self.actions = self.actions.reshape(len(readings), math.prod(self.actions.shape[1:]))
        self.map, self.readings, self.level, self.patch = map, readings.on(map), level, patch
        self.fill = number_of("fill", fill, "a number")
        self.size = size
        # The first frame of each episode, of whose frames alone the history is.
        times = readings.timestamps
        numbers = np.zeros(len(times)) if readings.episodes is None else readings.episodes
        begins = np.concatenate([[0], np.flatnonzero((np.diff(times) < 0) | (np.diff(numbers) != 0)) + 1]).astype(np.int64)
        self._first: Any = begins[np.searchsorted(begins, np.arange(len(times)), side="right") - 1]
        self._renderer: Renderer | None = None
        self._made()  # What cannot be drawn is refused here, not in a worker.
        self.contacts = _truth(map, readings, truth) if truth is not None else _tracked(map, self.readings, threshold)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}

    def __len__(self) -> int:
        return len(self.readings)

    def __getitem__(self, frame: Any) -> Any:
        """The sample of a frame; of a slice, a mask or several frames the `Subset` of them."""
        subset: Any = torch.utils.data.Subset
        if isinstance(frame, slice):
            return subset(self, range(len(self))[frame])
        if np.ndim(frame) > 0:
            numbers = frames_of(frame, len(self))
            chosen = np.flatnonzero(numbers) if numbers.dtype == bool else numbers
            return subset(self, [range(len(self))[int(k)] for k in chosen])
        return self.__getitems__(frames_of(frame, len(self)))[0]

    def __getitems__(self, frames: Sequence[int]) -> list[dict[str, Any]]:
        """Some frames at once, which a loader asks for."""
        chosen = np.asarray([range(len(self))[int(frame)] for frame in frames], dtype=np.int64)
        # Each frame with those before it, of which every one is drawn once.
        back: Any = np.maximum(chosen[:, None] + np.arange(1 - self.history, 1), self._first[chosen][:, None])
        drawn: Any = np.unique(back)
        places: Any = drawn.searchsorted(back)
        if self.augment is not None:
            drawn = back.ravel()
            places = np.reshape(np.arange(len(drawn)), back.shape)
        part = self.readings[drawn]
        changes = None if self.augment is None else [self.augment.sample() for _ in chosen]
        if changes is not None:
            changed = [change.values(part.values[at], part.extensive) for change, at in zip(changes, places)]
            measured = part.measured
            part = replace(part.with_values(np.concatenate([*changed, part.values[:0]])), measured=measured)
        images, fields = self._made()(part.values, threads=1), part.pooled(self.map, self.level, threads=1)
        mask, valid = np.isfinite(images), np.isfinite(fields)
        if part.measured is not None:
            # What was filled has a value and was not measured.
            valid &= np.isfinite(replace(part, values=np.where(part.measured, part.values, np.nan)).pooled(self.map, self.level, threads=1))
        arrays = {
            "image": np.where(mask, images, np.float32(self.fill)),
            "mask": mask,
            "fields": np.where(valid, fields, np.float32(0)),
            "valid": valid,
        }
        of_sample = places if self.history > 1 else places[:, 0]
        tensors = {name: tensor_of(array[of_sample]) for name, array in arrays.items()}
        if self.actions is not None:
            tensors["action"] = tensor_of(self.actions[chosen])
        of_samples = {name: array[chosen] for name, array in self.contacts.items()}
        for k, change in enumerate(changes or []):
            for name, value in change.contact({name: array[k] for name, array in of_samples.items()}).items():
                of_samples[name][k] = value
        contacts = {name: tensor_of(array) for name, array in of_samples.items()}
        samples = [
            {**{name: each[k] for name, each in tensors.items()}, "contact": {name: each[k] for name, each in contacts.items()}}
            for k in range(len(chosen))
        ]
        return samples if self.transform is None else [self.transform(sample) for sample in samples]

    def _made(self) -> Renderer:
        if self._renderer is None:
            is_packed = self.patch is None and len(self.map.patches) > 1
            self._renderer = self.map.renderer(
                0,
                patch=self.patch,
                channels=len(self.readings.channels),
                extensive=self.readings.extensive,
                modality=self.readings.modalities(self.map),
                size=self.size,
                pack=is_packed,
            )
        return self._renderer


def _blank(frames: int) -> dict[str, Any]:
    return {
        "touched": np.zeros(frames, dtype=bool),
        "force": np.zeros(frames, dtype=np.float32),
        "centre": np.zeros((frames, 3), dtype=np.float32),
        "patch": np.full(frames, -1, dtype=np.int64),
    }


def _put(contacts: dict[str, Any], frame: int, force: float, centre: Any, patch: int) -> None:
    """Takes a contact of a frame."""
    for name, value in (("touched", True), ("force", force), ("centre", centre), ("patch", patch)):
        contacts[name][frame] = value


def _truth(map: Map, readings: Readings, truth: dict[str, Any]) -> dict[str, Any]:
    frames, times = len(readings), readings.timestamps
    contacts, numbers = _blank(frames), {name: number for number, name in enumerate(map.patches)}
    needed = "a dict of frame, force, centre and patch of each contact, as dermatome.touch returns it"
    known = mapping_of("truth", truth, needed)
    missing = {"frame", "force", "centre", "patch"} - set(known)
    if missing:
        raise DataError(f"truth: found no {sorted(missing)[0]}; needed: {needed}")
    columns = [items_of(f"truth[{name!r}]", known[name], needed) for name in ("frame", "force", "centre", "patch")]
    columns.append(items_of("truth['time']", known["time"], needed) if "time" in known else [np.nan] * len(columns[0]))
    lengths = [len(column) for column in columns]
    if len(set(lengths)) > 1:
        raise DataError(f"truth: found columns of {lengths} rows; needed: as many in each")
    columns[:2] = [as_floats(f"truth[{name!r}]", known[name]).tolist() for name in ("frame", "force")]
    centres = as_floats("truth['centre']", known["centre"])
    if lengths[0] and centres.shape != (lengths[0], 3):
        raise DataError(f"truth['centre']: found shape {centres.shape}; needed: ({lengths[0]}, 3)")
    for row, (frame, force, centre, patch, time) in enumerate(zip(*columns)):
        if not float(frame).is_integer():
            raise DataError(f"truth['frame']: found {frame}; needed: whole numbers")
        frame = int(frame)
        if not 0 <= frame < frames or patch not in numbers:
            needed = f"frames of {frames} and patches of the map"
            raise DataError(f"truth: found frame {frame}, patch {patch!r}; needed: {needed}")
        if abs(time - times[frame]) > SAME_TIME:
            raise DataError(f"truth: found time[{row}] = {time} s of frame {frame}; needed: {times[frame]} s, as the readings have it")
        # Of contacts without a known force the first one counts.
        if not contacts["touched"][frame] or force > contacts["force"][frame] or np.isnan(contacts["force"][frame]) > np.isnan(force):
            _put(contacts, frame, float(force), centre, numbers[patch])
    return contacts


def _tracked(map: Map, readings: Readings, threshold: float | None) -> dict[str, Any]:
    if len(parts := readings.by_episode()) > 1:
        made = [_tracked(map, part, threshold) for part in parts]
        return {name: np.concatenate([each[name] for each in made]) for name in made[0]}
    contacts, numbers = _blank(len(readings)), {name: number for number, name in enumerate(map.patches)}
    channel = main_channel(readings.channels, readings.units, readings.kinds)
    unit = readings.units[channel] if readings.units else ""
    threshold = readings.threshold if threshold is None else threshold
    tracker = ContactTracker(map, unit=unit, threshold=threshold, tared=readings.is_tared if readings.tared is None else readings.tared[channel])
    times = [time if np.isfinite(time) else None for time in readings.timestamps.tolist()]
    for frame, (values, time) in enumerate(zip(readings.values[:, channel], times)):
        found = [contact for contact in tracker.track(values, time) if contact["event"] != "release"]
        if found:
            # Readings of another unit have no force, but the strongest of them are known.
            strongest = max(found, key=lambda contact: contact["force"] if np.isfinite(contact["force"]) else contact["peak"])
            _put(contacts, frame, strongest["force"], strongest["centre"], numbers[strongest["patch"]])
    return contacts


for _class in (Augment, Pool, Draw, Touches):
    _class.__module__ = "dermatome.torch"
