"""Objects that drive in a map: their files, their frames, and that they are apart from what stands."""

import json

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.maps import Map, MovingObject, MovingPath, TiledMap


@pytest.fixture
def make_moving(make_object, rng):
    def make(number=21, count=6):
        poses = tuple(Pose.from_yaw(0.1 * i, np.array([1e3 + i, 2.0, 0.8])) for i in range(count))
        factors = rng.normal(size=(count, 6, 6))
        path = MovingPath(
            0.5 + 0.1 * np.arange(count),
            tuple(range(3, 3 + count)),
            poses,
            1e-3 * factors @ factors.transpose(0, 2, 1),
            rng.normal(size=(count, 3)),
            rng.normal(8.0, 1.0, count),
            rng.uniform(0.1, 0.5, count),
            rng.normal(0.0, 0.1, count),
            rng.uniform(0.01, 0.05, count),
        )
        body = make_object(number, world_from_object=poses[2])
        return MovingObject(body, float(path.times_s[2]), path)

    return make


def points_at(one, time_s):
    return one.path.at(time_s).transform(one.vertices)


def test_what_drives_is_saved_and_loaded_apart_from_what_stands(tmp_path, a_map, make_moving):
    made = Map(a_map.objects, (make_moving(30), make_moving(21)))
    made.save(tmp_path)
    loaded = Map.load(tmp_path)
    assert list(loaded) == list(a_map)
    assert [one.id for one in loaded.moving] == [21, 30]
    for a, b in zip(loaded.moving, made.moving, strict=True):
        assert a.body_time_s == b.body_time_s
        assert a.path.frame_ids == b.path.frame_ids
        for time_s in (0.5, 0.55, 0.83, 1.0):
            np.testing.assert_allclose(a.vertices_at(time_s), b.vertices_at(time_s), atol=1e-6)
        np.testing.assert_allclose(a.path.covariances, b.path.covariances, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(a.path.velocity_in_world, b.path.velocity_in_world, atol=1e-6)
        np.testing.assert_allclose(a.path.speed_sigmas_m_s, b.path.speed_sigmas_m_s, atol=1e-6)
    entry = json.loads((tmp_path / "map.json").read_text())["moving"][0]
    assert entry["moving"] is True
    assert {"mesh", "path", "trajectory"} <= set(entry)
    assert sorted(p.name for p in (tmp_path / "moving").iterdir()) == sorted(
        f"{number}.{ending}" for number in (21, 30) for ending in ("csv", "ply", "tum")
    )


def test_a_map_without_them_is_written_as_before_and_their_files_go(tmp_path, a_map, make_moving):
    a_map.save(tmp_path / "before")
    Map(a_map.objects, (make_moving(),)).save(tmp_path / "after")
    a_map.save(tmp_path / "after")
    assert (tmp_path / "before" / "map.json").read_bytes() == (tmp_path / "after" / "map.json").read_bytes()
    assert "moving" not in json.loads((tmp_path / "after" / "map.json").read_text())
    assert not list((tmp_path / "after" / "moving").iterdir())


def test_the_same_map_gives_the_same_bytes(tmp_path, a_map, make_moving):
    made = Map(a_map.objects, (make_moving(),))
    for name in ("a", "b"):
        made.save(tmp_path / name)
    for name in ("map.json", "moving/21.csv", "moving/21.tum", "moving/21.ply"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_another_origin_moves_nothing(make_moving):
    """The mesh that a map centres stays where it was at all times, and so does what is known of a point of it."""
    given, origin = make_moving(), np.array([0.3, -0.2, 0.1])
    moved = given.path.of_origin(origin)
    for i in range(len(moved)):
        before, after = given.path.world_from_object[i], moved.world_from_object[i]
        np.testing.assert_allclose(after.transform(np.ones(3) - origin), before.transform(np.ones(3)), atol=1e-9)
        # the information of a step of the pose is the same, whichever origin it is written about
        step = np.array([0.01, 0.02, -0.01, 0.003, -0.002, 0.004])
        about = Pose(np.eye(3), origin).inverse().adjoint() @ step
        np.testing.assert_allclose(
            step @ np.linalg.solve(given.path.covariances[i], step),
            about @ np.linalg.solve(moved.covariances[i], about),
        )
    [in_map] = Map((), (given,)).moving
    np.testing.assert_allclose(points_at(in_map, 0.8), points_at(given, 0.8), atol=1e-6)
    assert np.abs(in_map.vertices.max(0) + in_map.vertices.min(0)).max() < 1e-6


def test_a_point_further_out_swings_faster(make_moving):
    path = make_moving().path
    swung = path.of_origin(np.array([2.0, 0.0, 0.0])).velocity_in_world - path.velocity_in_world
    left = np.array([pose.rotation[:, 1] for pose in path.world_from_object])
    np.testing.assert_allclose(swung, 2.0 * path.turn_rates_rad_s[:, None] * left, atol=1e-12)


def test_between_rows_it_turns_evenly(make_moving):
    path = make_moving().path
    middle = path.at(0.55)
    assert middle.yaw_rad == pytest.approx(0.05)
    assert np.linalg.norm(middle.translation - path.world_from_object[0].translation) == pytest.approx(0.5, abs=0.01)
    with pytest.raises(MapError, match=r"0\.500 to 1\.000 s"):
        path.at(1.2)


def test_ids_differ_from_those_of_what_stands(a_map, make_moving):
    with pytest.raises(MapError, match="different ids"):
        Map(a_map.objects, (make_moving(3),))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda e, _: e.pop("path"), "path: key is missing"),
        (lambda e, _: e.update(path="../x.csv"), "outside the map's folder"),
        (lambda e, _: e.update(timestamp="soon"), "timestamp"),
        (lambda _, folder: (folder / "moving/21.csv").write_text("timestamp,frame\n"), "its header lacks tx"),
        (lambda _, folder: (folder / "moving/21.csv").unlink(), "cannot be read"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, a_map, make_moving, change, said):
    Map(a_map.objects, (make_moving(),)).save(tmp_path)
    document = json.loads((tmp_path / "map.json").read_text())
    change(document["moving"][0], tmp_path)
    (tmp_path / "map.json").write_text(json.dumps(document))
    with pytest.raises(MapError, match=said):
        Map.load(tmp_path)


def test_a_path_of_wrong_numbers_is_named_with_its_line(tmp_path, make_moving):
    table = make_moving().path.to_csv().decode().splitlines()
    table[2] = table[2].replace(table[2].split(",")[3], "nan", 1)
    (tmp_path / "x.csv").write_text("\n".join(table))
    with pytest.raises(MapError, match="line 3: ty: expected a finite number"):
        MovingPath.load(tmp_path / "x.csv")


def test_tiles_hold_what_stands_alone(tmp_path, a_map, make_moving):
    TiledMap.create(tmp_path / "city").put(Map(a_map.objects, (make_moving(),)).values())
    assert TiledMap.open(tmp_path / "city").loaded().moving == ()
