"""Damaged files: every reader reads them or says in one short line what is wrong; the seed gives the same damage."""

import os
import random
import re
import warnings

import numpy as np
import pytest
import yaml

from meshslam.categories import icosphere, load_category, save_category
from meshslam.errors import MeshslamError
from meshslam.geometry import Pose
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.runs import read_config
from meshslam.sequences import check_sequence, open_sequence, read_extrinsics, read_path

MUTATIONS = int(os.environ.get("MESHSLAM_MUTATIONS", "250"))  # of each reader; `make fuzz` takes more, and other seeds
SEED = int(os.environ.get("MESHSLAM_FUZZ_SEED", "0"))
LONGEST = 300  # characters of a message behind the file's path
WORDS = [
    *("", "nan", "inf", "-inf", "1e400", "1e308", "-1e308", "1e150", "1e-320", "0", "-1", "0x10", "1_000", "null", "~"),
    *("true", "[", "]", "{", "}", '"', "- ", ": ", "[[[[", "[1,2]", "a: b", "&a", "*a", "!!python/object", "\x00", "é"),
    *("2011-09-26", "2011-99-99", "9" * 5000, "9" * 200000, "1" + "0" * 400),
]


def damaged(rng, data):
    """Another byte, a cut end, a lost or repeated stretch, or another word."""
    kind, at = rng.randrange(6), rng.randrange(len(data))
    if kind == 0:
        return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
    if kind == 1:
        return data[:at]
    if kind == 2:
        return data[:at] + data[at + rng.randrange(1, 200) :]
    if kind == 3:
        return data[:at] + data[at : at + 40] * rng.randrange(2, 5) + data[at + 40 :]
    text = data.decode("latin1")
    start, end = rng.choice([word.span() for word in re.finditer(r"[-+.\w]+|[\[\]{}:,]", text)])
    return (text[:start] + rng.choice(WORDS) + text[end:]).encode("latin1", "replace")


@pytest.fixture
def withstands():
    """Damage files in turn, and read; every error is one of ours, in one short line, and nothing warns."""

    def tried(files, read):
        rng, whole, refused = random.Random(SEED), {file: file.read_bytes() for file in files}, 0
        for k in range(MUTATIONS):
            file = rng.choice(files)
            file.write_bytes(damaged(rng, whole[file]))
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    read()
            except MeshslamError as error:
                refused += 1
                said = re.sub(r"\S*/", "", str(error))
                assert "\n" not in said, (k, file, said)
                assert len(said) <= LONGEST, (k, file, said)
            file.write_bytes(whole[file])
        read()
        assert refused > MUTATIONS // 10

    return tried


def test_a_sequence_folder(folder, withstands):
    names = ("camera.yaml", "times.txt", "poses.tum", "imu.csv", "initial_state.yaml")
    withstands([folder / name for name in names], lambda: open_sequence(folder))


def test_kitti_odometry(odometry, withstands):
    files = [odometry / "calib.txt", odometry / "times.txt", odometry.parent / "poses" / "07.txt"]
    withstands(files, lambda: open_sequence(odometry))


def test_kitti_raw(raw, withstands):
    files = [*raw.parent.glob("calib_*.txt"), *raw.rglob("timestamps.txt"), *sorted(raw.rglob("oxts/data/*.txt"))[:2]]
    assert len(files) >= 6
    withstands(files, lambda: open_sequence(raw))


def test_images(folder, withstands):
    withstands([folder / "images" / "000001.png"], lambda: open_sequence(folder).read_image(1))


def test_check_never_raises(folder):
    rng = random.Random(SEED)
    files = [folder / name for name in ("camera.yaml", "times.txt", "poses.tum", "imu.csv")]
    for _ in range(MUTATIONS // 5):
        file = rng.choice(files)
        whole = file.read_bytes()
        file.write_bytes(damaged(rng, whole))
        check_sequence(folder)
        file.write_bytes(whole)


def test_extrinsics_and_configuration(tmp_path, withstands):
    rig, config = tmp_path / "rig.yaml", tmp_path / "config.yaml"
    camera = {"T_cam_imu": np.eye(4).tolist(), "timeshift_cam_imu": 0.01, "intrinsics": [400.0, 400.0, 320.0, 240.0]}
    rig.write_text(yaml.safe_dump({"cam0": camera}))
    withstands([rig], lambda: read_extrinsics(rig))
    config.write_text("mapping: {min_views: 3, max_distance_m: 40.0}\nexpert: {objects: {edge_margin_px: 8}}\n")
    withstands([config], lambda: read_config(config, "map"))


def test_paths(tmp_path, withstands):
    file = tmp_path / "poses.tum"
    file.write_text("".join(f"{0.1 * i} {i} 0 0 0 0 0 1\n" for i in range(9)))
    withstands([file], lambda: read_path(file))
    withstands([file], lambda: Trajectory.load(file))


def test_maps_and_categories(tmp_path, withstands):
    ball = icosphere(1)
    things = tuple(
        MapObject(
            i,
            "car",
            Pose.from_yaw(0.3 * i, np.array([i, 2.0, 0.5])),
            ball.vertices,
            ball.faces,
            keypoints={"a": np.ones(3)},
        )
        for i in (1, 2)
    )
    Map(things).save(tmp_path)
    withstands([tmp_path / "map.json", *(tmp_path / "objects").glob("*.ply")], lambda: Map.load(tmp_path))
    save_category(load_category("bus"), tmp_path / "bus.npz")
    withstands([tmp_path / "bus.npz"], lambda: load_category(str(tmp_path / "bus.npz")))
