"""Columns as the text of a table, which the library reads as it reads a file."""

from __future__ import annotations

import csv
import io
from typing import Any

from dermatome._arguments import shown
from dermatome._errors import DataError
from dermatome._kinds import is_mapping

# Columns of whole numbers, which arrays may have as floats.
WHOLE = ("i", "j", "touch", "contact")


def table(argument: str, columns: Any) -> str:
    """The text of a table with these columns."""
    if not hasattr(columns, "keys") or not len(columns.keys()):
        raise DataError(f"{argument}: found {type(columns).__name__}; needed: a mapping of names of columns to arrays of shape (k,)")
    cells = {str(name): _cells(f"{argument}[{str(name)!r}]", str(name), columns[name]) for name in columns.keys()}
    first, count = next((name, len(of)) for name, of in cells.items())
    for name, of in cells.items():
        if len(of) != count:
            raise DataError(f"{argument}[{name!r}]: found {len(of)} rows; needed: {count}, as {first!r} has")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(cells)
    writer.writerows(zip(*cells.values()))
    return text.getvalue()


def _cells(argument: str, name: str, values: Any) -> list[str]:
    """The texts of a column; what is not known is empty."""
    import numpy as np

    if isinstance(values, str):
        return [values]
    if np.ma.is_masked(values):
        raise DataError(f"{argument}: found masked numbers; needed: .filled(numpy.nan)")
    # Of the taxels of a frame there may be one, or as many as frames.
    array: Any = np.empty(0, object) if name == "taxels" else np.atleast_1d(np.asarray(values))
    if array.dtype.kind in "iuf":
        if array.ndim != 1:
            raise DataError(f"{argument}: found shape {array.shape}; needed: shape (k,)")
        return [_number(name, number) for number in array.tolist()]
    try:
        return [_word(argument, name, value) for value in values]
    except TypeError:
        raise DataError(f"{argument}: found {type(values).__name__}; needed: shape (k,)") from None


def _number(name: str, number: float) -> str:
    if number != number:
        return ""
    return str(int(number)) if name in WHOLE and isinstance(number, float) and number.is_integer() else repr(number)


def _id(argument: str, taxel: Any) -> int:
    """The id of a taxel, which arrays may have as a whole float."""
    try:
        number = int(taxel)
    except (TypeError, ValueError, OverflowError):
        number = None
    if number is None or number != taxel:
        raise DataError(f"{argument}: found {shown(taxel)}; needed: ids of taxels, whole numbers")
    return number


def _word(argument: str, name: str, value: Any) -> str:
    """A text, a number, or the active taxels of a frame: with readings, or ids alone."""
    if value is None or isinstance(value, str):
        return value or ""
    if hasattr(value, "item") and getattr(value, "ndim", None) == 0:  # A number of numpy.
        value = value.item()
    if is_mapping(value):
        return ";".join(f"{_id(argument, taxel)}:{float(reading)!r}" for taxel, reading in value.items())
    if isinstance(value, (int, float)):
        return _number(name, value)
    try:
        taxels = list(value)
    except TypeError:
        raise DataError(f"{argument}: found {type(value).__name__}; needed: numbers or texts") from None
    return ";".join(str(_id(argument, taxel)) for taxel in taxels)
