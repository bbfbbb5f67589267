"""Calibration of drawn skins, logs of touches, and calibration touch by touch: what the command finds, as objects."""

import json
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import dermatome


def command(folder, words):
    """What the command prints as JSON, line by line."""
    said = subprocess.run([sys.executable, "-m", "dermatome", *words.split()], cwd=folder, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    return said.stdout


def drawing():
    """Four hexagons of seven taxels on two patches."""
    taxels = []
    for module in range(4):
        cos, sin = np.cos(0.5 * module), np.sin(0.5 * module)
        for slot in range(7):
            u, v = (0, 0) if slot == 6 else (0.01 * np.cos(slot * np.pi / 3), 0.01 * np.sin(slot * np.pi / 3))
            at = (0.1 * cos - u * sin, 0.1 * sin + u * cos, v)
            taxels.append((10 * module + slot, *at, cos, sin, 0, f"m{module}", "left" if module < 2 else "right"))
    return taxels


@pytest.fixture
def folder(tmp_path):
    """The drawing, and contacts of its skin, which is mounted 4 mm too far along x; the probe is 5 mm off in its own y."""
    names = "taxel_id,x,y,z,nx,ny,nz,module,patch"
    rows = [",".join(map(str, taxel)) for taxel in drawing()]
    (tmp_path / "cad.csv").write_text("\n".join([names, *rows]) + "\n")
    random, half = np.random.default_rng(0), np.sqrt(0.5)
    columns = {name: [] for name in "i,x,y,z,touch,contact,weight,qx,qy,qz,qw,sigma".split(",")}
    for k, (i, x, y, z, *_) in enumerate(drawing()):
        turn, off = [((0, 0, 0, 1), (0, -5e-3, 0)), ((0, 0, half, half), (5e-3, 0, 0)), ((half, 0, 0, half), (0, 0, -5e-3))][k % 3]
        for repeat in range(2):
            at = np.array([x + 0.004, y, z]) + off + random.normal(0, 5e-4, 3)
            for name, value in zip(columns, (i, *at, 2 * k + repeat, k, 1, *turn, 5e-4)):
                columns[name].append(value)
    contacts = dermatome.Observations.from_columns(columns)
    contacts.write(tmp_path / "contacts.csv")
    return tmp_path, columns, contacts


def test_bodies_are_those_of_the_command(folder):
    at, _, contacts = folder
    said = json.loads(command(at, "calibrate contacts.csv --cad cad.csv --fit-probe --folds 4 -o out.csv --json"))
    found = dermatome.calibrate(contacts, cad=at / "cad.csv", fit_probe=True, folds=4)
    assert (found.touches, found.contacts, found.steps, found.converged) == tuple(said[k] for k in ("touches", "contacts", "steps", "converged"))
    assert len(found.rejected) == said["rejected"] and (found.chi2, found.dof) == (said["chi2"], said["dof"])
    assert np.allclose(1e3 * found.probe.offset, said["probe"]["offset_mm"], rtol=1e-12)
    assert np.allclose(1e3 * found.probe.sigma, said["probe"]["sigma_mm"], rtol=1e-12)
    assert abs(found.probe.offset[1] - 5e-3) < 5e-4 and found.standoff is None
    assert (1e3 * found.noise, found.noise_over_stated) == pytest.approx((said["noise_mm"], said["noise_over_stated"]))
    assert list(found.faults) == said["faults"] == []
    for body, row in zip(found.bodies, said["bodies"], strict=True):
        assert (body.level, body.name, body.contacts, body.dof, body.believable) == tuple(row[k] for k in ("level", "name", "contacts", "dof", "believable"))
        assert (1e3 * body.moved, np.degrees(body.turned)) == pytest.approx((row["moved_mm"], row["turned_deg"]), rel=1e-9)
        # Of a level that does not move nothing is known but its tolerance.
        sigma = None if body.sigma is None else (1e3 * body.sigma, np.degrees(body.sigma_turned))
        assert sigma == (None if row["sigma_mm"] is None else pytest.approx((row["sigma_mm"], row["sigma_deg"]), rel=1e-9))
        assert (body.chi2, body.p) == (row["chi2"], row["p"])
        assert np.linalg.norm(body.translation) == pytest.approx(body.moved) and np.linalg.norm(body.rotation) == pytest.approx(body.turned)
    assert [body.name for body in found.bodies] == ["mount", "left", "right", "m0", "m1", "m2", "m3"]
    assert found.held_back.supported == said["held_back"]["supported"] and found.held_back.explained == said["held_back"]["explained"]
    assert 1e3 * found.held_back.drawn[0] == pytest.approx(said["held_back"]["drawing_median_mm"])
    for level, row in zip(found.held_back.levels, said["held_back"]["levels"], strict=True):
        assert level.level == row["level"]
        assert 1e3 * level.median == pytest.approx(row["median_mm"]) and 1e3 * level.p90 == pytest.approx(row["p90_mm"])
        assert 1e3 * level.contact_mean == pytest.approx(row["contact_mean_mm"])
    found.write(at / "python.csv")
    assert (at / "python.csv").read_bytes() == (at / "out.csv").read_bytes()
    assert found.patches[0] == "left" and found.modules[-1] == "m3" and found.skin().n_taxels == len(found.ids) == 28
    assert np.allclose(found.positions[:, 0], [taxel[1] + 0.004 for taxel in drawing()], atol=1e-3)
    again = pickle.loads(pickle.dumps(found))
    assert repr(again) == repr(found) and again.bodies[2].name == "right" and np.array_equal(again.positions, found.positions)
    with pytest.raises(AttributeError):
        found.chi2 = 0
    assert all(len(repr(thing)) < 120 for thing in (found, *found.bodies, found.probe, found.held_back, *found.held_back.levels))


def test_a_skin_is_a_drawing_and_what_is_assumed_is_remarked(folder):
    at, columns, contacts = folder
    skin = dermatome.Skin.read(at / "cad.csv")
    modules = {taxel[0]: taxel[-2] for taxel in drawing()}
    of_skin = dermatome.calibrate(contacts, cad=skin, modules=modules, fit_probe=True)
    of_file = dermatome.calibrate(contacts, cad=at / "cad.csv", fit_probe=True)
    order = np.argsort(of_skin.ids)
    assert np.array_equal(of_skin.ids[order], np.sort(of_file.ids))
    # Patches are the pieces of the skin here, which are its modules.
    assert np.allclose(of_skin.positions[order], of_file.positions, atol=3e-4)
    bare = {name: column[:42] for name, column in columns.items() if name != "sigma"}
    assumed = dermatome.calibrate(dermatome.Observations.from_columns(bare), cad=skin, modules=modules)
    assert assumed.noise > 0 and assumed.untouched == ("m3",)
    assert assumed.remarks[0] == "the table gives no uncertainty; it is estimated from the touches"
    assert assumed.remarks[-1] == "without a touch, a module keeps its drawn pose on its patch: `m3`"
    assert not any("1 mm per axis" in remark for remark in assumed.remarks)
    copied = pickle.loads(pickle.dumps(dermatome.Observations.from_columns(bare)))
    assert dermatome.calibrate(copied, cad=skin, modules=modules).chi2 == assumed.chi2
    more = dermatome.calibrate(copied, cad=skin, modules={**modules, 4_000_000: "m"})
    assert more.chi2 == assumed.chi2
    assert "not in the drawing are passed over: 4000000" in " ".join(more.remarks)


def test_exchanged_modules_are_named(folder):
    at, columns, _ = folder
    # Nine modules in a row, touched all over, two of which are in each other's place.
    taxels = [(10 * m + k, 0.05 * m + 0.012 * (k % 3), 0.009 * (k // 3), 0.002 * m * m) for m in range(9) for k in range(9)]
    swap = {2: 5, 5: 2}
    places = {taxel[0]: taxel[1:] for taxel in taxels}
    truth = [places[10 * swap.get(i // 10, i // 10) + i % 10] for i in places]
    skin = dermatome.Skin.from_arrays([taxel[1:] for taxel in taxels], ids=list(places), patch=[f"p{i // 30}" for i in places], outside=(0, 0, 1))
    random = np.random.default_rng(1)
    at = np.repeat(truth, 3, axis=0) + random.normal(0, 5e-4, (3 * len(truth), 3))
    contacts = dermatome.Observations.from_columns({"i": np.repeat(list(places), 3), **dict(zip("xyz", at.T)), "sigma": np.full(len(at), 5e-4)})
    found = dermatome.calibrate(contacts, cad=skin, modules={i: f"m{i // 10}" for i in places})
    assert [set(pair) for pair in found.exchanged] == [{"m2", "m5"}]
    assert any("m2" in remark and "m5" in remark and "exchanged" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"cad": "skin", "modules": {999: "a"}}, "has no module"),
        ({"cad": "cad.csv", "modules": {0: "a"}}, "taxel 1 of the drawing has no module"),
        ({"cad": "cad.csv", "folds": 1}, "the number of folds is 1; needed: at least 2"),
        ({"cad": "cad.csv", "folds": 1000}, "the number of folds is 1000"),
        ({"cad": "other"}, "of taxel 0, which the drawing does not have"),
        ({"cad": "cad.csv", "module": 0.0}, "the tolerance of a module in m is 0"),
        ({"cad": "cad.csv", "level": "finger"}, "level: found"),
        ({"cad": "cad.csv", "robust": "gnc"}, "robust: found cad, too; needed: one of the two"),
        ({"folds": 3}, "folds: found no cad; needed: cad"),
        ({"modules": {0: "a"}}, "modules: found no cad"),
        ({"cad": 3}, "cad: found int; needed: a Skin"),
        ({"cad": "cad.csv", "folds": -1}, "folds: found -1"),
    ],
)
def test_wrong_input_is_refused(folder, options, said, monkeypatch):
    at, _, contacts = folder
    monkeypatch.chdir(at)
    skins = {
        "skin": dermatome.Skin.read("cad.csv"),
        "other": dermatome.Skin.from_arrays([[0.01 * x, 0.01 * y, 0] for y in range(4) for x in range(4)], ids=range(500, 516)),
    }
    options = {name: skins.get(value, value) if isinstance(value, str) else value for name, value in options.items()}
    with pytest.raises(dermatome.DataError) as error:
        dermatome.calibrate(contacts, **options)
    assert said in str(error.value), error.value


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({}, "columns: found dict; needed: a mapping"),
        ([1, 2], "columns: found list"),
        ({"i": [1], "x": [0, 1], "y": [0], "z": [0]}, "columns['x']: found 2 rows; needed: 1, as 'i' has"),
        ({"i": [1], "x": [[0]], "y": [0], "z": [0]}, "columns['x']: found shape (1, 1)"),
        ({"i": [1], "x": [np.nan], "y": [0], "z": [0]}, "line 2"),
        ({"i": [1.5], "x": [0], "y": [0], "z": [0]}, "line 2"),
        ({"i": [1], "x": [0], "y": [0]}, "columns"),
        ({"i": [1], "x": [0], "y": [0], "z": [0], "colour": ["red"]}, "colour"),
        ({"i": np.ma.masked_equal([1], 1), "x": [0], "y": [0], "z": [0]}, "masked"),
    ],
)
def test_wrong_columns_are_refused(columns, said):
    with pytest.raises(dermatome.DataError) as error:
        dermatome.Observations.from_columns(columns)
    assert said in str(error.value), error.value


def test_no_uncertainty_is_assumed_in_another_unit_than_m(folder):
    at, columns, _ = folder
    bare = {name: column for name, column in columns.items() if name != "sigma"}
    in_mm = bare | {name: [1e3 * x for x in bare[name]] for name in "xyz"}
    contacts = dermatome.Observations.from_columns(in_mm, unit="mm")
    for again in (contacts, pickle.loads(pickle.dumps(contacts))):
        with pytest.raises(dermatome.DataError, match="none is assumed in another unit than m; needed: a column sigma"):
            dermatome.calibrate(again)
    with pytest.raises(dermatome.DataError, match="none is assumed in another unit than m"):
        next(dermatome.follow([in_mm], unit="mm"))
    # Next to a drawing it is estimated.
    found = dermatome.calibrate(contacts, cad=at / "cad.csv", fit_probe=True)
    expected = dermatome.calibrate(dermatome.Observations.from_columns(bare), cad=at / "cad.csv", fit_probe=True)
    # The fit begins at another noise, and ends where a step is small.
    assert np.allclose(found.positions, expected.positions, atol=1e-6)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The log of a simulated arm, in files."""
    at = tmp_path_factory.mktemp("arm")
    command(at, "simulate --arm --taxels 60 -o log.csv --truth truth.csv")
    lines = [line.split(",") for line in (at / "log.csv").read_text().splitlines()]
    return at, {name: [cell if name in ("taxels", "link") else float(cell) for cell in column] for name, column in zip(lines[0], zip(*lines[1:]))}


def test_touches_are_those_of_the_command(arm):
    at, columns = arm
    said = json.loads(command(at, "touches log.csv -o contacts.csv --json"))
    contacts, summary = dermatome.touches(at / "log.csv")
    for name in ("frames", "touches", "taxels", "contacts", "fitted", "left_out", "reading_noise"):
        assert summary[name] == said[name], name
    assert (1e3 * summary["arm_noise"], 1e3 * summary["spacing"]) == pytest.approx((said["arm_noise_mm"], said["spacing_mm"]))
    for name in ("delay", "delay_sigma", "delay_removed"):
        assert 1e3 * summary[name] == pytest.approx(said[f"{name}_ms"]), name
    assert dermatome.touches(at / "log.csv", delay=0.02)[1]["delay_removed"] == 0.02
    with pytest.raises(dermatome.ArgumentError, match="delay: found 'late'"):
        dermatome.touches(at / "log.csv", delay="late")
    assert contacts.n_contacts == said["contacts"] and any("touches of 60 taxels" in remark for remark in contacts.remarks)
    of_arrays, _ = dermatome.touches(columns)
    of_dicts, _ = dermatome.touches({**columns, "taxels": [{int(i): float(x) for i, x in (part.split(":") for part in text.split(";"))} for text in columns["taxels"]]})
    expected = dermatome.calibrate(at / "contacts.csv")
    contacts.write(at / "python.csv")
    for each in (contacts, of_arrays, of_dicts, at / "python.csv"):
        found = dermatome.calibrate(each)
        assert np.array_equal(found.positions, expected.positions) and np.array_equal(found.covariances, expected.covariances)


def test_a_log_and_a_drawing_give_the_skin_of_the_command(arm):
    at, columns = arm
    names, *rows = [line.split(",") for line in (at / "truth.csv").read_text().splitlines()]
    truth = [dict(zip(names, map(float, row))) for row in rows]
    # Mounted 6 mm from where it is drawn, and a patch that nothing touches.
    drawn = [f"{row['id']:.0f},{int(row['x'] > 0)},skin,{row['x'] - 6e-3},{row['y']},{row['z']},{row['nx']},{row['ny']},{row['nz']}" for row in truth]
    drawn += [f"{900 + k},9,far,{0.4 + 5e-3 * (k % 3)},{5e-3 * (k // 3)},0,0,0,1" for k in range(9)]
    (at / "parts.csv").write_text("taxel_id,module,patch,x,y,z,nx,ny,nz\n" + "\n".join(drawn) + "\n")
    command(at, "touches log.csv --skin parts.csv -o of_parts.csv")
    command(at, "calibrate of_parts.csv --cad parts.csv -o command.csv")
    for log, skin in ((at / "log.csv", at / "parts.csv"), (columns, dermatome.Skin.read(at / "parts.csv"))):
        contacts, _ = dermatome.touches(log, skin=skin)
        found = dermatome.calibrate(contacts, cad=at / "parts.csv")
        found.write(at / "python.csv")
        assert (at / "python.csv").read_bytes() == (at / "command.csv").read_bytes()
    touched = [k for k, i in enumerate(found.ids) if i < 900]
    off = [np.linalg.norm(found.positions[k] - [truth[n][axis] for axis in "xyz"]) for n, k in enumerate(touched)]
    assert len(off) == 60 and np.sqrt(np.mean(np.square(off))) < 2e-3


def test_readings_poses_and_drawings_may_be_apart(arm):
    at, columns = arm
    frames, ids = len(columns["px"]), range(1, 61)
    active = [dict((int(i), float(x)) for i, x in (part.split(":") for part in text.split(";"))) for text in columns["taxels"]]
    names = sorted({i for frame in active for i in frame})
    values = [[frame.get(i, 0.0) for i in names] for frame in active]
    times = np.arange(frames) * 0.01
    log = {name: column for name, column in columns.items() if name != "taxels"} | {"time": times}
    readings = dermatome.Readings.from_arrays(values, ids=names, timestamps=times)
    apart, summary = dermatome.touches(log, readings=readings, threshold=1e-12)
    whole, _ = dermatome.touches({**columns, "time": times})
    assert np.array_equal(dermatome.calibrate(apart).positions, dermatome.calibrate(whole).positions)
    assert summary["taxels"] == len(ids) and apart.remarks[0].startswith("taxels are active above 1.000e-12")
    # What the recording states: its threshold, and what it measures.
    assert dermatome.touches(log, readings=replace(readings, threshold=1e-12))[1] == summary
    heat = dermatome.Readings.from_arrays(values, ids=names, timestamps=times, channels="temperature", units="degC")
    with pytest.raises(dermatome.DataError, match="does not measure touches"):
        dermatome.touches(log, readings=heat)
    with pytest.raises(dermatome.DataError, match="above the threshold"):
        dermatome.touches(log, readings=dermatome.Readings.from_arrays(np.add(values, 2000), ids=names, timestamps=times))
    found = dermatome.calibrate(whole)
    skin = dermatome.Skin.from_arrays(found.positions, ids=found.ids, outside=(0, 0, -1))
    drawn, _ = dermatome.touches(columns, skin=skin, skip=[names[0]])
    unnamed = dermatome.Readings.from_arrays(np.array(values)[:, [names.index(i) for i in skin.ids]], timestamps=times)
    of_order, _ = dermatome.touches(log, skin=skin, readings=unnamed, threshold=1e-12, skip=[names[0]])
    assert np.array_equal(dermatome.calibrate(of_order).positions, dermatome.calibrate(drawn).positions)
    # A taxel of a file that is in no triangle is one as the others, as for the command.
    lonely, places = int(found.ids[-1]), np.array(found.positions)
    places[-1] += [0, 0, 0.2]
    rows = [f"{i},{x},{y},{z},0,0,-1" for i, (x, y, z) in zip(found.ids, places)]
    (at / "drawn.csv").write_text("id,x,y,z,nx,ny,nz\n" + "\n".join(rows))
    assert lonely not in dermatome.Skin.read(at / "drawn.csv").ids
    assert json.loads(command(at, "touches log.csv --skin drawn.csv -o drawn_contacts.csv --json"))["taxels"] == 60
    assert dermatome.touches(at / "log.csv", skin=at / "drawn.csv")[1]["taxels"] == 60
    with pytest.raises(dermatome.DataError, match="no ids of taxels; needed: ids, or skin"):
        dermatome.touches(log, readings=unnamed)
    assert drawn.n_taxels == 59
    for options, said in (
        ({"joints": {"elbow": 1.0}}, "joints: found no robot as pose"),
        ({"threshold": 1.0}, "threshold: found no readings"),
        ({"link": "hand"}, "hand"),
        ({"taxel_radius": 0.0}, "taxel_radius: found 0"),
        ({"skin": 3}, "skin: found int"),
        ({"skip": [999]}, "taxel 999"),
    ):
        with pytest.raises(dermatome.DataError) as error:
            dermatome.touches(columns, **options)
        assert said in str(error.value), error.value


def test_followed_touches_end_at_the_batch_result():
    observations, _ = dermatome.simulate(taxels=40, anchors=8, seed=4)
    batch = dermatome.calibrate(observations)
    (state,) = [observations.__reduce__()[1]]
    _, taxels, edges, contacts, *_ = state
    ids = [taxel[0] for taxel in taxels]
    rows = []
    for (a, b), numbers in edges:
        rows.append({"i": ids[a], "j": ids[b], **dict(zip(("dx", "dy", "dz"), numbers)), "sigma": numbers[3] ** -0.5})
    for taxel, numbers in contacts:
        rows.append({"i": ids[taxel], **dict(zip("xyz", numbers)), "sigma": numbers[3] ** -0.5, "time": 3.5})
    following = dermatome.follow(rows, every=20)
    touches = list(following)
    assert [touch.touch for touch in touches] == list(range(1, len(rows) + 1))
    assert all((touch.moved is None and touch.undetermined is None) == (touch.touch % 20 != 0) for touch in touches)
    assert touches[0].fits is None and touches[0].time is None and touches[-1].time == 3.5
    judged = [touch for touch in touches if touch.fits is not None]
    assert judged and sum(not touch.fits for touch in judged) <= 3
    assert np.allclose(following.result.positions, batch.positions, atol=1e-9)
    assert type(following.result) is dermatome.Calibration and following.result is following.result


def test_lines_are_followed_as_by_the_command(folder):
    at, columns, contacts = folder
    text = (at / "contacts.csv").read_text()
    said = [json.loads(line) for line in command(at, "calibrate contacts.csv --follow --cad cad.csv --fit-probe --every 20 -o out.csv").splitlines()]
    with open(at / "contacts.csv") as file:
        following = dermatome.follow(file, cad=at / "cad.csv", fit_probe=True, every=20)
        touches = list(following)
    for touch, line in zip(touches, said, strict=True):
        assert (touch.touch, list(touch.taxels), touch.time, touch.sigmas, touch.undetermined) == tuple(line[k] for k in ("touch", "taxels", "time", "sigmas", "undetermined"))
        assert (touch.moved is None) == (line["moved_mm"] is None)
        if touch.moved is not None:
            assert 1e3 * touch.moved == pytest.approx(line["moved_mm"], rel=1e-9)
            assert touch.worst[0] == line["worst"]["taxel_id"] and 1e3 * touch.worst[1] == pytest.approx(line["worst"]["sigma_mm"])
    following.result.write(at / "python.csv")
    assert (at / "python.csv").read_bytes() == (at / "out.csv").read_bytes()
    # Half a line at the end is not read, and lines without ends are whole.
    half = dermatome.follow(iter((text + "0,0.1").splitlines(keepends=True)))
    assert len(list(half)) == 56 and any("has no end and was not read" in remark for remark in half.remarks)
    assert len(list(dermatome.follow(text.splitlines(), every=56))) == 56


def test_touches_are_followed_from_any_thread():
    lines = ["i,x,y,z,sigma", *["7,0.001,0,0,0.001"] * 5]
    following = dermatome.follow(lines)
    assert next(following).touch == 1
    with ThreadPoolExecutor(1) as pool:
        assert [touch.touch for touch in pool.submit(list, following).result()] == [2, 3, 4, 5]
    assert following.result.positions[0, 0] == pytest.approx(0.001)


def test_what_came_before_a_bad_touch_is_kept(folder):
    at, columns, _ = folder

    def lines():
        yield "i,x,y,z,sigma"
        yield "7,0,0,0,0.001"
        yield "7,0.002,0,0,0.001"
        raise OSError("the arm is off")

    following = dermatome.follow(lines())
    assert [touch.touch for touch in (next(following), next(following))] == [1, 2]
    with pytest.raises(OSError, match="the arm is off"):
        next(following)
    assert following.result.positions[0, 0] == pytest.approx(0.001)
    in_mm = dermatome.follow(["i,x,y,z,sigma", "7,1,0,0,1"], unit="mm")
    assert next(in_mm).touch == 1 and in_mm.result.positions.tolist() == [[0.001, 0, 0]]
    assumed = dermatome.follow([{"i": 7, "x": 1, "y": 0, "z": 0}])
    assert list(assumed) and assumed.remarks == ["the table gives no uncertainty; 1 mm per axis was assumed"]
    bad = dermatome.follow(["i,x,y,z,sigma", "7,0,0,0,0.001", "7,zero,0,0,0.001"])
    next(bad)
    with pytest.raises(dermatome.DataError, match="rows: line 3"):
        next(bad)
    assert bad.result.ids.tolist() == [7]
    unknown = dermatome.follow([{"i": 0, "x": 0.1, "y": 0, "z": 0}, {"i": 99, "x": 0, "y": 0, "z": 0}], cad=at / "cad.csv")
    assert next(unknown).taxels == (0,)
    with pytest.raises(dermatome.DataError, match="row 2 of the contacts is of taxel 99"):
        next(unknown)
    assert unknown.result.touches == 1 and unknown.result.noise > 0
    assert unknown.remarks == ["the table gives no uncertainty; it is estimated from the touches"]
    with pytest.raises(dermatome.DataError, match="every: found 0"):
        dermatome.follow([], every=0)
    with pytest.raises(dermatome.DataError, match="rows: found str"):
        dermatome.follow("contacts.csv")
    with pytest.raises(dermatome.DataError):
        dermatome.follow([]).result
    assert list(dermatome.follow([])) == []
