"""Named shapes that the tests use."""

import numpy as np
import pytest

import dermatome


def lattice(columns, rows, spacing=0.005):
    """Positions and triangles of a flat lattice, seen from above."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    positions = np.stack([x.ravel() * spacing, y.ravel() * spacing, np.zeros(x.size)], axis=1)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return positions, np.concatenate([lower, upper])


def dome(columns=16, rows=16, spacing=0.005, radius=0.08):
    """A lattice bent onto a sphere, open at its rim."""
    positions, faces = lattice(columns, rows, spacing)
    middle = positions.mean(axis=0)
    flat = positions - middle
    positions[:, 2] = np.sqrt(radius**2 - (flat[:, :2] ** 2).sum(axis=1))
    return positions, faces


def tube(around=24, along=30, radius=0.02, spacing=0.005):
    """An open cylinder: two loops, which is cut."""
    turn = 2 * np.pi * np.arange(around) / around
    rows = [np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(around, k * spacing)], 1) for k in range(along)]
    faces = []
    for k in range(along - 1):
        for a in range(around):
            b = (a + 1) % around
            low, high = k * around, (k + 1) * around
            faces += [[low + a, low + b, high + b], [low + a, high + b, high + a]]
    return np.concatenate(rows), np.array(faces)


@pytest.fixture(scope="session")
def dome_map():
    return dermatome.build(dermatome.Skin.from_arrays(*dome(), patch="dome", link="hand"))


@pytest.fixture(scope="session")
def tube_map():
    return dermatome.build(dermatome.Skin.from_arrays(*tube(), patch="sleeve"), cut="all")


@pytest.fixture(scope="session")
def uneven_map():
    """A patch of one level next to one of several; three taxels are not present."""
    small, large = lattice(4, 4)[0], lattice(24, 24)[0]
    positions, present = np.concatenate([small, large + [0.5, 0, 0]]), np.ones(592, dtype=np.uint8)
    present[[3, 200, 201]] = 0
    made = dermatome.build(dermatome.Skin.from_arrays(positions, present=present, outside=(0, 0, 1)))
    assert [len(patch.levels) for patch in made.patches.values()] == [1, made.n_levels] and made.n_levels > 1
    return made


@pytest.fixture(scope="session")
def rough_map():
    """Two links and patches with spaces in their names that share ids, 41 x 9 and 5 x 24 taxels; one is not present, and
    fields are finer on the first patch."""
    present = np.ones(369, dtype=bool)
    present[50] = False
    arm = dermatome.Skin.from_arrays(*lattice(41, 9), patch="upper arm", link="left arm", present=present)
    tip = dermatome.Skin.from_arrays(*lattice(5, 24), patch="tip of it", link="left hand")
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.5, 0.1
    skin = dermatome.Skin.join([arm, tip], poses={"left hand": pose})
    made = dermatome.build(skin, acuity=np.repeat([2.0, 1.0], [369, 120]))
    assert [len(patch.ids) for patch in made.patches.values()] == [369, 120] and made.n_levels > 1
    return made


@pytest.fixture(scope="session")
def rough_readings(rough_map):
    """Three channels on it: a force, a pressure and a temperature, with a missing reading, and times from 3 s on with a
    pause."""
    values = np.random.default_rng(8).random((6, 3, 489)) + [[[0.5]], [[100.0]], [[30.0]]][0]
    values[2, 0, 7] = np.nan
    times = 3 + np.array([0, 0.01, 0.02, 0.03, 5.0, 5.01])
    return dermatome.Readings.from_arrays(values, timestamps=times, channels=["force", "pressure", "heat"], units=["N", "kPa", "degC"])
