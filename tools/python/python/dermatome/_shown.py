"""What notebooks and videos show."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from dermatome._adapter import need
from dermatome._dermatome import Map, Renderer, as_floats, colours
from dermatome._errors import DataError
from dermatome._whole import written

# Frames that are drawn at once.
AT_ONCE = 256


def table(map: Map) -> str:
    """The map as HTML: its picture, and the measures of each level."""
    heads = "".join(f"<th>{name}</th>" for name in ("patch", "link", "level", "fields", "distortion of angles", "of areas", "flips"))
    rows: list[str] = []
    for name, patch in map.patches.items():
        for level in patch.levels:
            worst = level.distortion
            cells = (html.escape(name), html.escape(patch.link), level.number, len(level.areas))
            measures = (f"{worst['qc_mean']:.4f}", f"{worst['area_mean']:.4f}", worst["flips"])
            rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in (*cells, *measures)) + "</tr>")
    said = html.escape(repr(map)[1:-1])
    return f"<p>{said}</p>{map.plot(width=900).svg()}<table><tr>{heads}</tr>{''.join(rows)}</table>"


def on_axes(ax: Any, map: Map, patch: str | None, number: int, values: Any, options: dict[str, Any]) -> None:
    """Shows a level of a patch, or readings on it, in map coordinates."""
    patch = next(iter(map.patches)) if patch is None else patch
    levels = map.patches[patch].levels
    level = levels[min(number, len(levels) - 1)]
    if values is None:
        ax.triplot(level.uv[:, 0], level.uv[:, 1], level.uv_faces, linewidth=0.5)
    else:
        how = {name: options[name] for name in ("extensive", "modality")}
        renderer = map.renderer(level.number, patch=patch, **how)
        frame, (low, high) = renderer.charts[0]["frame"], options["range"] or (None, None)
        extent = (frame.x, frame.x + frame.width, frame.y, frame.y + frame.height)
        ax.imshow(renderer(values)[0], extent=extent, vmin=low, vmax=high, interpolation="nearest")
    ax.set_aspect("equal")
    ax.set_xlabel("u (m)")
    ax.set_ylabel("v (m)")


def video(renderer: Renderer, values: Any, path: Path, numbers: tuple[int, float, int], range: Sequence[float] | None) -> None:
    """Writes images of readings as a video or an animation."""
    import numpy as np

    imageio, (channel, rate, magnification) = need("imageio.v2", "video"), numbers
    array = as_floats("values", values)
    if array.ndim == 2:
        array = array[:, None]
    if array.ndim != 3 or not channel < array.shape[1]:
        raise DataError(f"values: found shape {array.shape}; needed: shape (T, N) or (T, C, N) with channel {channel}")

    def images() -> Iterator[Any]:
        for first in np.arange(0, len(array), AT_ONCE):
            yield renderer(array[first : first + AT_ONCE])[:, channel]

    if range is None:
        bounds = [(float(np.nanmin(part)), float(np.nanmax(part))) for part in images() if np.isfinite(part).any()]
        low, high = min([0.0, *(low for low, _ in bounds)]), max([0.0, *(high for _, high in bounds)])
        range = (low, high if high > low else low + 1)
    if not path.suffix:
        raise DataError(f"path: found {str(path)!r}; needed: a name that ends with .mp4, .gif or another kind of video")
    is_gif = path.suffix.lower() == ".gif"
    options = {"mode": "I", "duration": 1000 / rate, "loop": 0} if is_gif else {"fps": rate, "macro_block_size": 1}
    with written(path) as part, imageio.get_writer(part, **options) as writer:
        for drawn in images():
            # Videos have even sides.
            shown = colours(drawn, renderer.mask, range).repeat(magnification, axis=1).repeat(magnification, axis=2)
            odd = ((0, 0), (0, shown.shape[1] % 2), (0, shown.shape[2] % 2), (0, 0))
            for frame in np.pad(shown, odd, constant_values=255):
                writer.append_data(frame)
