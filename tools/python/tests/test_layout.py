"""Layouts and decoders: what the numbers of a file mean."""

import json

import numpy as np
import pytest

import dermatome
from dermatome import Layout

PAD = {
    "dermatome_layout": 1,
    "axes": ["frame", "row", "col"],
    "time": {"stream": "t", "unit": "ns"},
    "channels": [{"name": "pressure", "unit": "count"}],
    "press": "lowers",
    "zero": 100,
    "taxels": {"shape": [2, 3], "first_id": 7},
}


def layout(**changes):
    return Layout.parse(json.dumps({**PAD, **changes}), "pad.json")


def test_numbers_of_every_type_are_readings():
    raw = np.array([[[90, 100, 100], [100, 100, 100]], [[99, 100, 40], [100, 100, 1]]])
    times = 1_700_000_000_000_000_000 + np.arange(2) * 10_000_000
    expected = [[10, 0, 0, 0, 0, 0], [1, 0, 60, 0, 0, 99]]
    for kind, narrow in (("u1", "f4"), (">i2", "f4"), ("f2", "f4"), ("f4", "f4"), ("i4", "f8"), (">f8", "f8")):
        decoder = layout().decoder("a.npy", (2, 3))
        values, seconds = decoder.decode(raw.astype(kind), times)
        assert values.dtype == narrow and values[:, 0].tolist() == expected and seconds.tolist() == [0.0, 0.01], kind
    decoder = layout().decoder("a.npy", (2, 3), says={"unit": "raw", "sensor": "glove 3"}, stream="right")
    dates = times.astype("datetime64[ns]").astype("datetime64[us]")
    assert decoder.decode(raw, dates)[1].tolist() == [0.0, 0.01]
    assert decoder.ids.tolist() == list(range(7, 13)) and decoder.learn_frames == 256
    assert (decoder.channels, decoder.units) == (("pressure",), ("count",))
    assert ("sensor", "glove 3", "file") in decoder.statements and ("unit", "count", "file") in decoder.statements


def test_what_a_file_states_otherwise_is_refused():
    frames = np.full((3, 2, 3), 100)
    times = np.arange(3) * 10_000_000
    for says, expected in (({"unit": "kPa"}, "found the unit kPa"), ({"axes": ["frame", "col", "row"]}, "axes: found"), ({"time_unit": "us"}, "found times in us")):
        with pytest.raises(dermatome.DataError, match=expected):
            layout().decoder("a.h5", (2, 3), says=says)
    with pytest.raises(dermatome.DataError, match="time_unit: found min"):
        layout().decoder("a.h5", (2, 3), says={"time_unit": "min"})
    with pytest.raises(dermatome.DataError, match=r"a.h5: cells of a frame: found \[3, 2\]"):
        layout().decoder("a.h5", (3, 2))
    decoder = layout().decoder("a.h5", (2, 3))
    for raw, given, expected in (
        (frames[:, 0], times, "raw: found shape"),
        (frames.astype(str), times, "raw: found dtype"),
        (frames, times[:2], "times: found 2 for 3 frames"),
        (frames, times[::-1], "frame 1: found"),
        (frames, None, "times: found none"),
        (frames, np.array(["2026-01-01", "NaT", "2026-01-02"], "datetime64[ns]"), "times: found NaT"),
    ):
        with pytest.raises(dermatome.DataError, match=expected):
            layout().decoder("a.h5", (2, 3)).decode(raw, given)
    assert decoder.decode(frames, times)[0].shape == (3, 1, 6)
    with pytest.raises(dermatome.DataError, match="press: found none"):
        Layout.parse(json.dumps({key: value for key, value in PAD.items() if key != "press"}))


def test_zero_comes_from_another_stream_and_tables_from_the_folder(tmp_path):
    (tmp_path / "cells.csv").write_text("row,col,taxel_id\n1,2,4\n0,0,3\n")
    text = json.dumps({**PAD, "zero": {"stream": "rest"}, "taxels": "cells.csv", "time": {"rate": 4}})
    (tmp_path / "a.json").write_text(text)
    for one in (Layout.read(tmp_path / "a.json"), Layout.parse(text, "a.json", tmp_path)):
        assert (one.zero_stream, one.time, one.frame_axis, one.axes) == ("rest", {"rate": 4}, 0, ("frame", "row", "col"))
        decoder = one.decoder("a.h5", (2, 3), zero=np.arange(6).reshape(2, 3))
        values, seconds = decoder.decode(np.zeros((2, 2, 3)))
        assert (values[1, 0].tolist(), decoder.ids.tolist(), seconds.tolist()) == ([0.0, 5.0], [3, 4], [0.0, 0.25])
    with pytest.raises(dermatome.DataError, match="zero: found shape"):
        one.decoder("a.h5", (2, 3), zero=np.arange(6))
    draft = json.loads(Layout.draft("some/a.h5", (2, 3), says={"rate": 30.0}, stream="left"))
    assert (draft["stream"], draft["time"], draft["press"]) == ("left", {"rate": 30.0}, None)
    with pytest.raises(dermatome.DataError, match="null"):
        Layout.parse(json.dumps(draft))


def test_files_of_the_library_are_read_some_frames_at_a_time(tmp_path):
    rows = "".join(f"Frame {k}\nB,{k},2\n3,4,5\n" for k in range(5))
    head = "DATA_TYPE MOVIE\nROWS 2\nCOLS 3\nROW_SPACING 5 mm\nCOL_SPACING 5 mm\nSECONDS_PER_FRAME 0.5\nUNITS KPa\nASCII_DATA @@\n"
    (tmp_path / "walk.asf").write_text(head + rows + "@@\n")
    file = dermatome.RecordingFile(tmp_path / "walk.asf")
    assert dermatome.RecordingFile.is_known(tmp_path / "walk.asf") and file.streams == {"": (2, 3)} and file.says["unit"] == "kPa"
    assert (file.ids.tolist(), file.channels, file.units, file.frames) == ([2, 3, 4, 5, 6], ("pressure",), ("kPa",), None)
    parts = []
    while (part := file.next(2)) is not None:
        parts.append(part)
    assert [len(values) for _, values, _ in parts] == [2, 2, 1] and parts[2][2].tolist() == [2.0]
    assert parts[1][1][:, 0, 0].tolist() == [2.0, 3.0] and ("unit", "kPa", "file") in file.statements
    assert json.loads(file.draft())["channels"] == [{"name": "pressure", "unit": "kPa"}]
    with pytest.raises(dermatome.DataError, match="no stream"):
        dermatome.RecordingFile(tmp_path / "walk.asf", "left")
    assert dermatome.Skin.read(tmp_path / "walk.asf").n_taxels == 5
