"""Responses: from touches, from known forces, from files; and the health of taxels."""

import pickle

import numpy as np
import pytest
from conftest import lattice

import dermatome


@pytest.fixture(scope="module")
def sheet():
    return dermatome.build(dermatome.Skin.from_arrays(lattice(9, 9)[0], patch="sheet"))


@pytest.fixture(scope="module")
def touched(sheet):
    """Presses that are read through gains which differ, and the truth."""
    readings, truth = dermatome.touch(
        sheet, presses=60, depth=0.003, rate=20, duration=1.25, extensive=False, noise=200, seed=3
    )
    gains = np.exp(np.random.default_rng(1).normal(0, 0.3, sheet.n_taxels))
    return readings.condition(sheet, gain=1 / gains, units="count"), gains, truth


def test_touches_give_gains_and_known_forces_their_scale(sheet, touched, tmp_path):
    readings, gains, truth = touched
    relative = dermatome.response(sheet, readings)
    known = np.isfinite(relative.gain)
    assert relative.scale == "relative" and relative.unit == "count" and known.mean() > 0.6
    assert [state == "ok" for state in relative.states] == known.tolist()
    off = np.log(relative.gain / gains)[known]
    assert off.std() < 0.15, off.std()
    rows = np.column_stack([truth["time"], truth["force"]])
    scaled = dermatome.response(sheet, readings, force=rows, relative=relative)
    assert scaled.scale == "Pa" and abs(np.median(scaled.gain[known] / gains[known]) - 1) < 0.2
    scaled.write(tmp_path / "response.csv")
    for same in (dermatome.Response.read(tmp_path / "response.csv"), pickle.loads(pickle.dumps(scaled))):
        assert np.array_equal(same.gain, scaled.gain, equal_nan=True) and same.states == scaled.states
        assert (same.scale, same.unit, same.method) == (scaled.scale, scaled.unit, scaled.method)
    followed = readings.condition(sheet, response=scaled, zero="follow")
    assert followed.units == ("Pa",) and np.isnan(followed.values[:, 0, ~known]).all()
    stored = readings.condition(sheet, response=scaled, zero="stored")
    late = slice(-200, None)
    assert np.nanmax(abs(stored.values[late] - followed.values[late])) < 0.1 * np.nanmax(stored.values)


def test_a_pressure_that_is_the_same_everywhere_gives_pascals(sheet):
    times = np.arange(0, 12, 0.1)
    rows = [[1, 5e3], [3, 2e4], [5, 6e4], [7, 2e4], [9, 0]]
    pressure = np.zeros(len(times))
    for begin, step in rows:
        pressure[times >= begin] = step
    gain, exponent = np.linspace(20, 60, sheet.n_taxels), 1.2
    values = (pressure[:, None] / gain) ** (1 / exponent)
    found = dermatome.response(sheet, dermatome.Readings.from_arrays(values, timestamps=times), pressure=rows, zero=0)
    assert found.scale == "Pa" and abs(found.exponent - exponent).max() < 0.05
    at = (2e4 / gain) ** (1 / exponent)
    assert abs(found.gain * at**found.exponent / 2e4 - 1).max() < 0.03


def test_faulty_taxels_are_found_and_masked(sheet, touched):
    readings, _, _ = touched
    values = readings.values.copy()
    values[:, 0, 40] = 7
    findings, states = dermatome.examine(sheet, dermatome.Readings.from_arrays(values, timestamps=readings.timestamps))
    assert [(finding["kind"], finding["taxels"], finding["patch"]) for finding in findings] == [("dead", [41], "sheet")]
    assert findings[0]["evidence"]["frames"] == len(values) and states.scale is None and states.states[40] == "dead"
    assert "sheet: " not in findings[0]["message"]
    # Where patches share ids the message has the patch.
    skins = [dermatome.Skin.from_arrays(sheet.patches["sheet"].levels[0].positions, patch=name, link=name) for name in ("a", "b")]
    both = dermatome.build(dermatome.Skin.join(skins))
    twice = dermatome.Readings.from_arrays(np.concatenate([readings.values, values], axis=2), timestamps=readings.timestamps)
    assert [finding["message"][:3] for finding in dermatome.examine(both, twice)[0]] == ["b: "]
    masked = dermatome.Readings.from_arrays(values).condition(sheet, response=states)
    assert np.isnan(masked.values[:, 0, 40]).all() and np.isfinite(masked.values[:, 0, 39]).all()


def test_what_determines_nothing_is_refused(sheet, touched):
    readings = touched[0]
    still = dermatome.Readings.from_arrays(np.zeros((50, 81)))
    foreign = dermatome.Readings.from_arrays(np.zeros((50, 2)), ids=[900, 901])
    warm = dermatome.Readings.from_arrays(np.zeros((50, 81)), channels=["temperature"], units="K")
    for call, text in [
        (lambda: dermatome.response(sheet, still), "0 touches"),
        (lambda: dermatome.response(sheet, []), "0 touches"),
        (lambda: dermatome.response(sheet, readings, pressure=[[0, 5]]), "5 Pa"),
        (lambda: dermatome.response(sheet, [still, still], pressure=[[0, 2e4]]), "2 are given"),
        (lambda: dermatome.response(sheet, readings, pressure=[[0, 2e4]], force=[[0, 1]]), "one of the two"),
        (lambda: dermatome.response(sheet, readings, force=[[0, np.nan]]), "NaN N"),
        (lambda: dermatome.response(sheet, readings, force=[0, 1]), "force: found shape (2,)"),
        (lambda: readings.condition(sheet, zero="stored"), "without a response"),
        (lambda: dermatome.response(sheet, foreign), "readings: none of the 2 taxel ids"),
        (lambda: dermatome.response(sheet, [still, foreign]), "readings[1]: none of the 2 taxel ids"),
        (lambda: dermatome.response(sheet, [still, "a.csv"]), "readings[1]: found str; needed: Readings"),
        (lambda: dermatome.response(sheet, "a.csv"), "Readings.read(path)"),
        (lambda: dermatome.examine(sheet, [still, warm]), "recording 2: no channel of the readings"),
        (lambda: dermatome.examine(sheet, []), "frame"),
        (lambda: dermatome.examine(sheet, still, threshold=0), "threshold"),
        (lambda: dermatome.examine(sheet, still, modules={9999: "a"}), "modules"),
    ]:
        with pytest.raises(dermatome.DataError) as found:
            call()
        assert text in str(found.value), str(found.value)


def test_shuffled_columns_find_their_taxels():
    at = [[0.006 * (x + y % 2 / 2), 0.0052 * y, 0] for y in range(10) for x in range(11) if y < 4 or x < 5]
    skin_map = dermatome.build(dermatome.Skin.from_arrays(at))
    touched, _ = dermatome.touch(skin_map, presses=120, rate=10, duration=1.1, extensive=False, noise=2000, seed=1)
    wires = np.random.default_rng(0).permutation(skin_map.n_taxels)
    truth = touched.ids[wires]
    shuffled = dermatome.Readings.from_arrays(touched.values[:, :, wires], timestamps=touched.timestamps, units="Pa")
    ids, report = dermatome.order(skin_map, shuffled, zero=0)
    assert ids.dtype == np.int64 and (ids == truth).mean() > 0.8
    assert report["objective"] > 0.88 and report["support"].shape == ids.shape and report["touches"] > 100
    known = {0: int(truth[0]), 40: int(truth[40])}
    found, _ = dermatome.order(skin_map, [shuffled, shuffled], known=known, zero=0)
    assert found[0] == truth[0] and found[40] == truth[40]
    for wrong, kind in (
        ({"known": {9999: 1}}, "known_column"),
        ({"known": {0: 987_654}}, "known_taxel"),
        ({"threshold": 1e12}, "no_touch"),
        ({"threshold": 0}, "option"),
    ):
        with pytest.raises(dermatome.DataError) as refused:
            dermatome.order(skin_map, shuffled, zero=0, **wrong)
        assert refused.value.kind in (kind, "signal"), refused.value
