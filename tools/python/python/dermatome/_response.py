"""How readings become pressures, which taxels can be trusted, and which column is of which taxel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dermatome._arguments import A_MAP, READINGS, check_kind, items_of, mapping_of, whole_of
from dermatome._dermatome import Map, Response, estimate_response, examine_taxels, order_columns
from dermatome._errors import DataError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from dermatome._readings import Readings

    _Arrays = tuple[Any, Any, list[str], list[str], Any, Any]


def response(
    map: Map,
    readings: Readings | Sequence[Readings],
    *,
    pressure: ArrayLike | None = None,
    force: ArrayLike | None = None,
    relative: Response | None = None,
    zero: float | None = None,
) -> Response:
    """Estimate how readings become pressures, as `dermatome response`: from touches alone, gains relative to each other.

    Parameters
    ----------
    map : Map
        The map of the skin.
    readings : Readings or sequence of Readings
        Recordings of touches, without conditioning.
    pressure : (k, 2) array_like, optional
        Steps of a pressure that is the same everywhere: the time in s at which each begins, and its pressure in Pa.
        Gains are then in Pa, and exponents are estimated.
    force : (k, 2) array_like, optional
        Forces on the whole skin: times in s, and forces in N. They give relative gains their scale.
    relative : Response, optional
        The relative gains to which `force` gives the scale; by default those of the same recordings.
    zero : float, optional
        The zero of all readings, in their unit; by default it is followed where nothing touches.

    Returns
    -------
    Response

    Raises
    ------
    DataError
        If readings are not of the map, or pressures and forces are not one for each recording.

    Examples
    --------
    >>> import dermatome
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> readings, truth = dermatome.touch(palm, presses=60, rate=20, duration=1.25, extensive=False, noise=500)
    >>> dermatome.response(palm, readings).scale
    'relative'
    """
    if pressure is not None and (force is not None or relative is not None):
        raise DataError("pressure: found force or relative, too; needed: one of the two")
    if relative is not None and force is None:
        raise DataError("relative: found no force; needed: force, to give the gains their scale")
    return estimate_response(map, _arrays(map, readings), pressure=pressure, force=force, relative=relative, zero=zero)


def examine(
    map: Map,
    readings: Readings | Sequence[Readings],
    *,
    threshold: float | None = None,
    modules: Mapping[int, str] | None = None,
    zero: float | None = None,
) -> tuple[list[dict[str, Any]], Response]:
    """Find the taxels that cannot be trusted, as `dermatome check --recording`.

    Parameters
    ----------
    map : Map
        The map of the skin.
    readings : Readings or sequence of Readings
        Recordings of ordinary touches, without conditioning.
    threshold : float, optional
        A taxel is touched above this, in the unit of the readings; by default four times the noise.
    modules : dict of int to str, optional
        The name of the module of each taxel, by its id. Without it no module is judged.
    zero : float, optional
        The zero of all readings, in their unit; by default it is followed where nothing touches.

    Returns
    -------
    findings : list of dict
        For each its `kind`, `patch`, `taxels` (ids), `other` (the taxel that it names, or None), `evidence` and `message`.
    states : Response
        The state of each taxel, without gains; `Readings.condition(response=states)` masks the faulty ones.

    Raises
    ------
    DataError
        If readings are not of the map, or the threshold or zero cannot be used.

    Examples
    --------
    >>> import dermatome, numpy as np
    >>> palm = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    >>> values = np.random.default_rng(0).normal(size=(100, 81))
    >>> values[:, 7] = 5  # The taxel 8: ids begin with 1.
    >>> findings, states = dermatome.examine(palm, dermatome.Readings.from_arrays(values))
    >>> [(finding["kind"], finding["taxels"]) for finding in findings]
    [('dead', [8])]
    """
    given = mapping_of("modules", {} if modules is None else modules, "a mapping of the id of each taxel to its module")
    named = [(whole_of("modules", taxel, "ids of taxels"), str(module)) for taxel, module in given.items()]
    return examine_taxels(map, _arrays(map, readings), threshold=threshold, modules=named, zero=zero)


def order(
    map: Map,
    readings: Readings | Sequence[Readings],
    *,
    known: Mapping[int, int] | None = None,
    threshold: float | None = None,
    zero: float | None = None,
) -> tuple[NDArray[np.int64], dict[str, Any]]:
    """Find which column of a recording is of which taxel, as `dermatome check --order`; `Readings.ids` is not used.

    Parameters
    ----------
    map : Map
        The map of the skin.
    readings : Readings or sequence of Readings
        Recordings of separate touches that roll, all over the skin, without conditioning.
    known : dict of int to int, optional
        Columns, counted from 0, whose taxel is known, with its id; three decide where the skin is symmetric.
    threshold : float, optional
        A column is touched above this, in the unit of the readings; by default four times the noise.
    zero : float, optional
        The zero of all readings, in their unit; by default it is followed where nothing touches.

    Returns
    -------
    ids : (N,) ndarray of int64
        The id of the taxel of each column; -1 of one that too few touches reached.
    report : dict
        `objective` (0 to 1), `runner_up` (that of the best order that differs, or None), `support` of each column, `touches`,
        `without_column` (taxels) and `threshold`.

    Raises
    ------
    DataError
        If touches do not determine the order, the skin is symmetric, or `known` does not fit.

    Examples
    --------
    >>> import dermatome, numpy as np
    >>> arms = [[0.006 * (x + y % 2 / 2), 0.0052 * y, 0] for y in range(10) for x in range(11) if y < 4 or x < 5]
    >>> skin_map = dermatome.build(dermatome.Skin.from_arrays(arms))
    >>> touched, _ = dermatome.touch(skin_map, presses=120, rate=20, duration=1.1, extensive=False, noise=2000)
    >>> wires = np.random.default_rng(0).permutation(skin_map.n_taxels)
    >>> shuffled = dermatome.Readings.from_arrays(touched.values[:, :, wires], units="Pa")
    >>> ids, report = dermatome.order(skin_map, shuffled)
    >>> bool((ids == touched.ids[wires]).mean() > 0.8)
    True
    """
    check_kind("map", map, Map, A_MAP)
    given = mapping_of("known", {} if known is None else known, "a mapping of columns to the ids of their taxels")
    arrays = [_of_one(each) for _, each in _every(readings)]
    pairs = [(whole_of("known", column, "numbers of columns"), whole_of("known", taxel, "ids of taxels")) for column, taxel in given.items()]
    return order_columns(map, arrays, known=pairs, threshold=threshold, zero=zero)


def _arrays(map: Map, readings: Readings | Sequence[Readings]) -> list[_Arrays]:
    arrays: list[_Arrays] = []
    for name, each in _every(readings):
        try:
            # Ids tell which taxels of a map with shared ids have one reading.
            each.on(map)
            arrays += [_of_one(part, part.ids) for part in each.by_episode()]
        except DataError as error:
            raise DataError(f"{name}: {error}", error.kind) from None
    return arrays


def _every(readings: Readings | Sequence[Readings]) -> list[tuple[str, Readings]]:
    """Recordings with their names in messages."""
    from dermatome._readings import Readings

    if isinstance(readings, Readings):
        return [("readings", readings)]
    every = [(f"readings[{number}]", each) for number, each in enumerate(items_of("readings", readings, READINGS))]
    for name, each in every:
        check_kind(name, each, Readings, READINGS)
    return every


def _of_one(readings: Readings, ids: Any = None) -> _Arrays:
    kinds = None if readings.kinds is None else list(readings.kinds)
    return readings.values, readings.timestamps, list(readings.channels), list(readings.units), kinds, ids
