"""Tensors, modules and data sets of torch: they draw and pool as the map does."""

import copy
import pickle
import subprocess
import sys
import warnings

import numpy as np
import pytest
from conftest import dome

import dermatome

torch = pytest.importorskip("torch")
from dermatome.torch import Augment, Draw, Pool, Touches, pixels, pooling, tensor  # noqa: E402


@pytest.fixture(scope="module")
def holed_map():
    """A dome of which a tenth of the taxels is not present."""
    present = (np.random.default_rng(0).random(256) > 0.1).astype(np.uint8)
    return dermatome.build(dermatome.Skin.from_arrays(*dome(), present=present, patch="dome", link="hand"))


def test_tensors_give_gradients_copy_and_do_not_warn(dome_map):
    values = np.random.default_rng(1).random((4, 256)).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        matrix = pooling(dome_map, 1)
        assert np.allclose((matrix @ torch.from_numpy(values).T).T.numpy(), dome_map.pool(values, 1), atol=1e-5)
        assert np.allclose((torch.from_numpy(values) @ matrix.T).numpy(), dome_map.pool(values, 1), atol=1e-5)
        assert torch.equal(copy.deepcopy(matrix).to_dense(), matrix.to_dense())
        renderer = dome_map.renderer(1)
        fields = torch.from_numpy(dome_map.pool(values, 1)).requires_grad_()
        images = (pixels(renderer) @ fields.T).T
        images.sum().backward()
        assert np.allclose(tensor(renderer.matrix()).to_dense(), renderer.matrix().scipy().todense())
    assert np.allclose(images.detach().numpy()[:, renderer.mask.ravel()], renderer(values)[:, 0][:, renderer.mask], atol=1e-5)
    assert fields.grad.shape == fields.shape and fields.grad.abs().sum() > 0


@pytest.mark.parametrize("extensive", [False, True])
def test_taxels_that_are_not_present_are_left_out(extensive, holed_map, uneven_map):
    for map in (holed_map, uneven_map):
        values = np.random.default_rng(2).random((3, map.n_taxels)).astype(np.float32)
        for level in range(map.n_levels):
            expected = map.pool(values, level, extensive=extensive)
            product = (pooling(map, level, extensive=extensive) @ torch.from_numpy(values).T).T.numpy()
            assert np.allclose(product, np.nan_to_num(expected), atol=1e-5)
            for name, patch in map.patches.items():
                own = pooling(map, level, patch=name, extensive=extensive)
                part = torch.from_numpy(values[:, patch.start : patch.start + patch.n_taxels])
                assert np.allclose((own @ part.T).sum(dim=0), (Pool(map, level, patch=name, extensive=extensive)(part)).nansum(dim=1), atol=1e-4)


@pytest.mark.parametrize("size", [None, (40, 48)])
@pytest.mark.parametrize("level", [0, 1])
def test_pixels_are_those_of_the_renderer(size, level, holed_map):
    values = np.random.default_rng(3).random((3, 256)).astype(np.float32)
    renderer = holed_map.renderer(level, size=size)
    fields = np.nan_to_num(holed_map.pool(values, level))
    drawn = (pixels(renderer) @ torch.from_numpy(fields).T).T.numpy()
    assert np.allclose(drawn, np.nan_to_num(renderer(values)[:, 0].reshape(3, -1)), atol=1e-5)
    several = holed_map.renderer(level, size=size, channels=2)
    drawn = (pixels(several) @ torch.from_numpy(fields).T).T.numpy()
    assert np.allclose(drawn, np.nan_to_num(renderer(values)[:, 0].reshape(3, -1)), atol=1e-5)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_modules_pool_and_draw_as_the_map_does(share, holed_map, uneven_map):
    rng = np.random.default_rng(4)
    for map in (holed_map, uneven_map):
        values = rng.random((2, 3, map.n_taxels)).astype(np.float32)
        values[rng.random(values.shape) < share] = np.nan
        for level in range(map.n_levels):
            for extensive in (False, True):
                made = copy.deepcopy(Pool(map, level, extensive=extensive))(torch.from_numpy(values)).numpy()
                assert np.allclose(made, map.pool(values, level, extensive=extensive), atol=1e-5, equal_nan=True)
            renderer = map.renderer(level, channels=3, pack=len(map.patches) > 1)
            draw = pickle.loads(pickle.dumps(torch.nn.Sequential(Pool(map, level), Draw(renderer))))
            assert np.allclose(draw(torch.from_numpy(values)).numpy(), renderer(values), atol=1e-5, equal_nan=True)
            assert torch.isfinite(torch.nn.Sequential(Pool(map, level), Draw(renderer, fill=0.0))(torch.from_numpy(values))).all()
    one = torch.from_numpy(values[0, 0]).requires_grad_()
    Draw(renderer)(Pool(map, map.n_levels - 1)(one)).nansum().backward()
    assert torch.isfinite(one.grad).all() and (one.grad[torch.isnan(one.detach())] == 0).all() and one.grad.abs().sum() > 0
    assert Pool(map, 0).double()(one.detach().double()).dtype == torch.float64
    with pytest.raises(dermatome.DataError, match="values: found shape"):
        Pool(map, 0)(torch.zeros(3, 2))


def test_touches_are_images_fields_and_contacts(uneven_map, holed_map):
    for map in (holed_map, uneven_map):
        readings, truth = dermatome.touch(map, presses=2, rate=25.0)
        readings = readings.on(map)
        touches = Touches(map, readings, truth, size=[32, 40], level=1)
        assert len(touches) == len(readings)
        batch = next(iter(torch.utils.data.DataLoader(touches, batch_size=len(touches))))
        renderer = map.renderer(0, size=(32, 40), extensive=True, pack=len(map.patches) > 1)
        images, fields = renderer(readings.values), readings.pooled(map, 1)
        assert np.array_equal(batch["image"], np.nan_to_num(images)) and np.array_equal(batch["mask"], np.isfinite(images))
        assert np.array_equal(batch["fields"], np.nan_to_num(fields)) and np.array_equal(batch["valid"], np.isfinite(fields))
        contact = batch["contact"]
        assert np.array_equal(np.flatnonzero(contact["touched"]), np.unique(truth["frame"]))
        strongest = [max(truth["force"][truth["frame"] == k]) for k in np.unique(truth["frame"])]
        assert np.allclose(contact["force"][contact["touched"]], strongest)
        assert set(contact["patch"][~contact["touched"]].tolist()) == {-1}
    assert torch.equal(touches[-1]["image"], batch["image"][-1])
    with pytest.raises(IndexError):
        touches[len(touches)]
    for index in (1.5, "a", None, [0.5]):
        with pytest.raises(dermatome.ArgumentError, match="frames: found"):
            touches[index]
    found = Touches(holed_map, dermatome.touch(holed_map, presses=1)[0])
    assert 0 < found.contacts["touched"].mean() < 1 and found.contacts["force"].max() > 0.1
    # Of another unit the force is not known, but the touch is.
    for units in (None, "count"):
        pressed = dermatome.touch(holed_map, presses=1)[0]
        counts = Touches(holed_map, dermatome.Readings.from_arrays(1000 * pressed.values, units=units)).contacts
        touched = counts["touched"]
        assert touched.any() and np.isnan(counts["force"][touched]).all() and not counts["force"][~touched].any()
    with pytest.raises(dermatome.DataError, match="truth: found frame 0, patch 'foot'"):
        Touches(map, readings, {"frame": [0], "force": [1.0], "centre": [[0, 0, 0]], "patch": ["foot"]})
    with pytest.raises(dermatome.DataError, match="patch"):
        Touches(map, readings, truth, patch="foot")


def test_augmented_touches_move_with_their_contacts(rough_map):
    """On a flat patch of uneven counts: the centre of pressure moves as the contact does, and nothing moves without a size."""
    readings, truth = dermatome.touch(rough_map, presses=12, rate=25.0, seed=4)
    readings = readings.on(rough_map)
    plain = Touches(rough_map, readings, truth, level=0, history=2)
    still = Touches(rough_map, readings, truth, level=0, history=2, augment=Augment(rough_map))
    for k in (0, 30, len(plain) - 1):
        for name in ("image", "fields", "valid"):
            assert torch.equal(plain[k][name], still[k][name])
    moved = Touches(rough_map, readings, truth, level=0, augment=Augment(rough_map, shift=0.004, turn=0.3))
    ids, starts = list(rough_map.patches), [patch.start for patch in rough_map.patches.values()] + [rough_map.n_taxels]
    errors, sums, lost = [], [], 0
    for k in np.flatnonzero(plain.contacts["touched"] & (plain.contacts["force"] > 1)):
        torch.manual_seed(k)
        sample, before = moved[k], readings.values[k, 0]
        number = int(plain.contacts["patch"][k])
        if not sample["contact"]["touched"]:
            lost += 1
            assert sample["contact"]["patch"] == -1 and sample["contact"]["force"] == 0
            continue
        assert sample["contact"]["patch"] == number
        part = slice(starts[number], starts[number + 1])
        places = rough_map.patches[ids[number]].levels[0].positions
        after, was = sample["fields"][0].numpy()[part], np.nan_to_num(before[part])
        absent = places[~np.isfinite(before[part])]
        ends = np.stack([plain.contacts["centre"][k], sample["contact"]["centre"].numpy()])
        is_near = np.linalg.norm(absent[:, None] - ends, axis=2) < 0.015
        if after.sum() < 0.9 * was.sum() or is_near.any():
            continue  # A part of it has left the patch, or is on a taxel without readings.
        offset = (was[:, None] * places).sum(axis=0) / was.sum() - plain.contacts["centre"][k]
        middle = (after[:, None] * places).sum(axis=0) / after.sum()
        errors.append(np.linalg.norm(middle - sample["contact"]["centre"].numpy()) - np.linalg.norm(offset))
        sums.append(after.sum() / was.sum())
    assert lost and len(errors) > 20 and np.max(errors) < 2e-3 and np.abs(np.mean(sums) - 1) < 0.05


def test_augmented_touches_have_faults_and_repeat(holed_map, uneven_map):
    for map in (holed_map, uneven_map):
        readings, truth = dermatome.touch(map, presses=1, rate=25.0)
        touches = Touches(map, readings, truth, level=0, history=3, augment=Augment(map, shift=0.005, turn=0.5, drop=0.3, gain=0.2))
        torch.manual_seed(3)
        first = touches.__getitems__([4, 9])
        torch.manual_seed(3)
        for a, b in zip(first, pickle.loads(pickle.dumps(touches)).__getitems__([4, 9])):
            assert all(torch.equal(a[name], b[name]) for name in ("image", "fields", "valid"))
        known = first[0]["valid"]
        assert torch.equal(known[0], known[2]) and 0.2 < 1 - known[0, :, map.present == 1].float().mean() < 0.9
        assert not torch.equal(known[0], first[1]["valid"][0]), "each sample has its own"
        only = Touches(map, readings, truth, level=0, augment=Augment(map, gain=0.1))
        made = np.stack([only[k]["fields"].numpy() for k in range(len(only))])
        before = readings.on(map).values
        spread = made[before > 0.01] / before[before > 0.01]
        assert len(spread) > 100 and abs(spread.mean() - 1) < 0.03 and 0.08 < spread.std() < 0.12 and spread.min() > 0.8
    with pytest.raises(dermatome.DataError, match="augment: found one of another map"):
        Touches(holed_map, dermatome.touch(holed_map, presses=1)[0], augment=Augment(uneven_map))
    with pytest.raises(dermatome.DataError, match="drop: found 2; needed: a number from 0 to 1"):
        Augment(holed_map, drop=2)


def test_touches_go_to_spawned_workers(tmp_path):
    (tmp_path / "load.py").write_text("""
import dermatome, torch
from dermatome.torch import Touches

if __name__ == "__main__":
    skin_map = dermatome.build(dermatome.Skin.from_arrays([[0.005 * x, 0.005 * y, 0] for y in range(9) for x in range(9)]))
    touches = Touches(skin_map, *dermatome.touch(skin_map, presses=1, rate=50.0), size=(16, 16))
    alone = torch.cat([batch["image"] for batch in torch.utils.data.DataLoader(touches, batch_size=8)])
    for start in ("spawn", "fork", "forkserver"):
        loader = torch.utils.data.DataLoader(touches, batch_size=8, num_workers=2, multiprocessing_context=start)
        assert torch.equal(torch.cat([batch["image"] for batch in loader]), alone), start
    print("equal", len(alone))
""")
    said = subprocess.run([sys.executable, "load.py"], cwd=tmp_path, capture_output=True, text=True)
    assert said.returncode == 0 and said.stdout.startswith("equal"), said.stderr


def test_examples_run():
    import doctest

    for thing in (Pool, Draw, Touches):
        test = doctest.DocTestParser().get_doctest(thing.__doc__, {}, thing.__name__, None, None)
        assert doctest.DocTestRunner().run(test).failed == 0


def _nothing():
    return {"frame": [], "force": [], "centre": np.zeros((0, 3)), "patch": []}


def test_touches_with_history_actions_and_a_transform(dome_map):
    readings, truth = dermatome.touch(dome_map, presses=1)
    one = Touches(dome_map, readings, truth, size=(16, 16))
    actions = np.arange(2 * len(readings), dtype=np.float32).reshape(-1, 2)
    several = Touches(
        dome_map, readings, truth, size=(16, 16), history=3, actions=actions, transform=lambda sample: {**sample, "seen": True}
    )
    sample = several[5]
    assert sample["seen"] and sample["image"].shape == (3, 1, 16, 16) and sample["action"].tolist() == [10.0, 11.0]
    for place, frame in enumerate([3, 4, 5]):
        assert all(torch.equal(sample[name][place], one[frame][name]) for name in ("image", "mask", "fields", "valid"))
    assert torch.equal(several[0]["image"][0], one[0]["image"]), "nothing is before the first frame"
    assert [len(one[2:5]), len(one[[1, 2]]), len(one[np.arange(len(one)) % 2 == 0])] == [3, 2, (len(one) + 1) // 2]
    assert torch.equal(one[2:5][1]["image"], one[3]["image"])
    # Times begin again with an episode, and so does what is before a frame.
    times = np.array([0, 0.01, 0.02, 0, 0.01, 0.02])
    values = np.arange(1.0, 7)[:, None, None] * np.ones((6, 1, dome_map.n_taxels))
    episodes = Touches(dome_map, dermatome.Readings.from_arrays(values, timestamps=times), _nothing(), size=(8, 8), history=3)
    seen = [[float(field.max()) for field in episodes[frame]["fields"]] for frame in (2, 3, 4)]
    assert np.allclose(seen, [[1, 2, 3], [4, 4, 4], [4, 4, 5]])
    patch = next(iter(dome_map.patches))
    for column, wrong_column in (("force", [1.0, 2.0]), ("centre", [0.0, 0.0, 0.0]), ("frame", [0.5, 1, 2])):
        rows = {"frame": [0, 1, 2], "force": [1.0, 2.0, 3.0], "centre": np.zeros((3, 3)), "patch": [patch] * 3}
        with pytest.raises(dermatome.DataError, match="truth"):
            Touches(dome_map, readings, rows | {column: wrong_column})
    for wrong in ({"history": 0}, {"actions": actions[1:]}):
        with pytest.raises(dermatome.DataError):
            Touches(dome_map, readings, truth, **wrong)
