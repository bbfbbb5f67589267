"""`Layout.draft` of a `Recording`, which the extension module does not know."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dermatome._dermatome import Layout
from dermatome._errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

_draft_of_cells = Layout.draft


def _draft(
    file: Any, cells: Sequence[int] | None = None, *, stream: str = "", says: dict[str, Any] | None = None
) -> str:
    """The text of a layout of what a file states, with null where it states nothing; `read` refuses null.

    Parameters
    ----------
    file : Recording, RecordingFile, str or os.PathLike
        A recording; or with `cells` the name of any file.
    cells : sequence of int, optional
        The shape of one frame.
    stream : str
        The name of the stream; with `cells`.
    says : dict, optional
        What the file states, as `decoder` takes it; with `cells`.

    Returns
    -------
    str
        The JSON; that of a `Recording` has a method `write(path)`.
    """
    if cells is None:
        if not hasattr(file, "draft"):
            raise DataError(f"cells: found none for {file}; needed: the shape of one frame, or a recording of Readings.open")
        made: str = file.draft()
        return made
    return _draft_of_cells(file, cells, stream=stream, says=says)


setattr(Layout, "draft", staticmethod(_draft))
