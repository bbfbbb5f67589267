"""What `build` says: in Python as by the command, doubts as warnings."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from conftest import dome, lattice, tube

import dermatome


def ball(count=300, radius=0.05):
    """A closed surface."""
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return radius * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def five_sleeves():
    parts = [dermatome.Skin.from_arrays(*tube(12, 12), patch=f"sleeve {k}") for k in range(5)]
    return dermatome.Skin.join(parts)


def far_away():
    positions, faces = dome()
    return dermatome.Skin.from_arrays(positions + [3000, 0, 0], faces, patch="far")


def palm_and_ball():
    """A patch that has a map uncut, and one that has none."""
    palm = dermatome.Skin.from_arrays(*lattice(9, 9), patch="palm")
    return dermatome.Skin.join([palm, dermatome.Skin.from_arrays(ball() + 1, patch="ball")])


# What each says at least, and whether that is a warning.
CASES = {
    "flat": (lambda: dermatome.Skin.from_arrays(*lattice(9, 9), patch="palm"), {}, None, False),
    "sleeve": (lambda: dermatome.Skin.from_arrays(*tube(12, 12), patch="sleeve"), {"cut": "all"}, "sleeve: the map is cut open along a seam of 55 mm", False),
    "sleeves": (five_sleeves, {"cut": "all"}, "sleeve 4: the map is cut open", False),
    "uncut": (lambda: dermatome.Skin.from_arrays(*tube(8, 20), patch="sleeve"), {"cut": "none"}, "1 map is poor, `sleeve`", True),
    "large pixels": (lambda: dermatome.Skin.from_arrays(*lattice(9, 9, 0.5), patch="floor"), {}, "the images have pixels of", False),
    "ratio": (lambda: dermatome.Skin.from_arrays(*dome(), patch="dome"), {"max_area_ratio": 1.0001}, "the largest area ratio of the map is", True),
    "linear": (lambda: dermatome.Skin.from_arrays(*tube(8, 20), patch="sleeve"), {"method": "linear", "cut": "none"}, "sleeve", True),
    "ids": (lambda: dermatome.Skin.from_arrays(*lattice(9, 9), ids=np.maximum(np.arange(81) - 3, 0), patch="palm"), {}, "4 of 81 taxels have a placeholder id", True),
    "far": (far_away, {}, "far: so far from the origin of its link", True),
    "bare": (lambda: dermatome.Skin.from_arrays(ball(), patch="ball"), {}, "ball: the map is cut open", False),
    "left out": (palm_and_ball, {"cut": "none", "keep_going": True}, "ball", True),
}  # fmt: skip


def command(tmp_path, file, options):
    words = [word for name, value in options.items() for word in (f"--{name.replace('_', '-')}", value)]
    called = [sys.executable, "-m", "dermatome", "build", file, "-o", "out", "-v", *(str(word) for word in words if word is not True)]
    said = subprocess.run(called, capture_output=True, text=True, cwd=tmp_path)
    assert said.returncode < 2, said.stderr
    return [line.removeprefix("note: ") for line in said.stderr.splitlines() if line.startswith("note: ")]


@pytest.mark.parametrize("name", CASES)
def test_python_says_what_the_command_says(name, tmp_path):
    make, options, needed, is_warning = CASES[name]
    # A .glb has 32-bit numbers already.
    file = "skin.obj" if name == "far" else "skin.glb"
    make().write(tmp_path / file)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        made = dermatome.build(tmp_path / file, **options)
    notes = command(tmp_path, file, options)
    assert len(made.remarks) == len(notes) and all(note.startswith(remark) for note, remark in zip(notes, made.remarks)), (made.remarks, notes)
    assert needed is None or any(needed in remark for remark in made.remarks), made.remarks
    assert bool(caught) == is_warning, [str(each.message) for each in caught]
    assert all(each.category is dermatome.DermatomeWarning and each.filename == __file__ for each in caught)
    assert {str(each.message) for each in caught} <= set(made.remarks)
    assert dermatome.Map.from_bytes(made.to_bytes()).remarks == ()


def test_a_warning_can_end_a_build():
    skin = dermatome.Skin.from_arrays(*tube(8, 20), patch="sleeve")
    with warnings.catch_warnings():
        warnings.simplefilter("error", dermatome.DermatomeWarning)
        with pytest.raises(dermatome.DermatomeWarning, match="sleeve"):
            dermatome.build(skin, cut="none")
        assert dermatome.build(skin, cut="all").remarks


def test_remarks_of_a_skin_are_those_of_its_map(tmp_path):
    (tmp_path / "palm.csv").write_text("id,x,y,z\n" + "".join(f"{9 * y + x + 1},{0.005 * x},{0.005 * y},0\n" for y in range(9) for x in range(9)))
    skin = dermatome.Skin.read(tmp_path / "palm.csv")
    assert skin.remarks and dermatome.build(skin).remarks == dermatome.build(tmp_path / "palm.csv").remarks
    assert dermatome.build(skin).remarks[: len(skin.remarks)] == skin.remarks
