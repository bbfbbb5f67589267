"""The examples as programs: learning from images, a simulated hand, a bag of ROS."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import lattice

import dermatome
import dermatome.ros

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(example, *args, cwd):
    said = subprocess.run([sys.executable, EXAMPLES / example, *map(str, args)], capture_output=True, text=True, cwd=cwd)
    assert said.returncode == 0, said.stderr
    return said.stdout


def test_a_network_learns_where_a_hand_is_touched(tmp_path):
    pytest.importorskip("torch")
    dermatome.Skin.from_arrays(lattice(24, 24)[0], outside=(0, 0, 1)).write(tmp_path / "palm.glb")
    guess, network = run("learning.py", "palm.glb", 24, 9, cwd=tmp_path).splitlines()
    (mean, force), (found, strength) = ([float(word) for word in line.replace(",", "").split() if "." in word] for line in (guess, network))
    assert found < mean and strength < force


HAND = """
<mujoco><option timestep="0.001"/><worldbody>
  <body name="palm" pos="0 0 0.1"><geom type="box" size="0.04 0.04 0.01"/>
    <body name="thumb" pos="0.045 0 0.02" euler="0 -40 0"><joint axis="0 1 0" stiffness="1" damping="0.1"/><geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01"/></body>
    <body name="finger" pos="-0.045 0 0.02" euler="0 220 0"><joint axis="0 1 0" stiffness="1" damping="0.1"/><geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.01"/></body>
  </body>
  <body name="egg" pos="0 0 0.14"><freejoint/><geom type="ellipsoid" size="0.02 0.02 0.025" mass="0.05"/></body>
</worldbody></mujoco>
"""


def test_a_simulated_hand_feels_what_lies_in_it(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "hand.xml").write_text(HAND)
    words = run("simulated_hand.py", "hand.xml", "palm,thumb,finger", 0.003, 300, cwd=tmp_path).replace(",", "").split()
    taxels, deepest, felt, lost = int(words[0]), float(words[3]), int(words[5]), int(words[8])
    assert taxels > 1000 and 0.01 < deepest < 5 and felt > 100 and lost == 0


def test_a_bag_becomes_forces_contacts_images_and_a_video(tmp_path):
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    pytest.importorskip("imageio")
    positions, rng = lattice(16, 12)[0], np.random.default_rng(0)
    rows = [f"{k + 100},{1e3 * x},{1e3 * y},0" for k, (x, y, _) in enumerate(positions)]
    (tmp_path / "taxels.csv").write_text("\n".join(["id,x,y,z", *rows]))
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg("std_msgs/Header header\nuint16[] counts\nuint32[] cells", "my_msgs/msg/Hand"))
    kind, head, time = (store.types[f"{name}"] for name in ("my_msgs/msg/Hand", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    order, force = rng.permutation(192), np.zeros((50, 192))
    force[30:, [70, 71, 86, 87]] = 0.5
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        to = writer.add_connection("/hand", kind.__msgtype__, typestore=store)
        for k, row in enumerate(force):
            counts = np.round(2000 + rng.normal(0, 2, 192) + 350 * row).astype(np.uint16)
            stamp = head(stamp=time(sec=k // 25, nanosec=k % 25 * 40_000_000), frame_id="hand")
            message = kind(header=stamp, counts=counts[order], cells=(order + 100).astype(np.uint32))
            writer.write(to, k * 40_000_000, store.serialize_cdr(message, kind.__msgtype__))
    said = run("ros_bag.py", "taxels.csv", "bag", "/hand", cwd=tmp_path).splitlines()
    assert said[0] == "<Readings: 50 frames, 1 channel (force, N), 192 taxels, 1.96 s>"
    onsets = [line for line in said if "contact" in line]
    assert len(onsets) == 1 and onsets[0].startswith("1.20 s: contact 0") and abs(float(onsets[0].split()[-2]) - 2) < 0.1
    assert (tmp_path / "touch.gif").stat().st_size > 10_000
    again = dermatome.ros.read(tmp_path / "images", "/skin/points", dermatome.build(dermatome.Skin.read(tmp_path / "taxels.csv", unit="mm")))
    assert abs(np.nansum(again.values[-1]) - 2) < 0.1 and (tmp_path / "fields").is_dir()
