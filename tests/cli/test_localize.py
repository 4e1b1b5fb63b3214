import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from meshslam.geometry import Pose
from meshslam.maps import Map, TiledMap, TrajectoryEstimate
from meshslam.sequences import camera_yaml, open_sequence
from tests.cli.conftest import done, error_of, meshslam
from tests.fixtures.imu_street import IMU_FROM_CAMERA, samples_of


@pytest.fixture(scope="module")
def drive(source, tmp_path_factory):
    """The street without poses but with an IMU beside it; its path is straight enough for a spline."""
    from shutil import copytree

    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline

    from meshslam.geometry import Pose

    folder = copytree(source, tmp_path_factory.mktemp("drive") / "street")
    sequence = open_sequence(folder)
    times, poses = sequence.times_s, sequence.world_from_camera
    placed = [pose @ IMU_FROM_CAMERA.inverse() for pose in poses]
    turns = RotationSpline(times, Rotation.from_matrix([p.rotation for p in placed]))
    places = CubicSpline(times, [p.translation for p in placed])
    at = np.arange(times[0], times[-1] + 0.005, 0.01)
    imu = samples_of(lambda t: Pose(turns(t).as_matrix(), places(t)), at)
    rows = np.column_stack([imu.times_s, imu.angular_rate_rad_s, imu.specific_force_m_s2])
    text = "\n".join(",".join(f"{x:.9f}" for x in row) for row in rows)
    (folder / "imu.csv").write_text(f"timestamp,wx,wy,wz,ax,ay,az\n{text}\n")
    camera = camera_yaml(sequence.camera, None, IMU_FROM_CAMERA, sequence.height_above_ground_m)
    (folder / "camera.yaml").write_text(camera)
    velocity = CubicSpline(times, [p.translation for p in poses])(times[0], 1)
    start = {
        "timestamp": float(times[0]),
        "world_from_camera": poses[0].matrix.tolist(),
        "velocity_in_world": velocity.tolist(),
    }
    (folder / "initial_state.yaml").write_text(json.dumps(start))
    (folder / "poses.tum").rename(folder / "groundtruth.tum")
    return folder


def test_localize_writes_a_run(drive, tmp_path):
    run = tmp_path / "run"
    figures = json.loads(done("localize", drive, "--map", drive / "objects.json", "--out", run, "--json").stdout)
    assert figures["ate_rmse_m"] < 0.1
    assert len((run / "trajectory.tum").read_text().splitlines()) == 6
    for name in ("detections.json", "metrics.json", "config.yaml", "report.html", "camera.yaml", "path.png"):
        assert (run / name).is_file()
    assert not (run / "map.json").exists()
    assert "IMU alone" in (run / "report.html").read_text()
    estimate = TrajectoryEstimate.load(run / "trajectory.csv")
    assert estimate.trajectory.to_tum() == (run / "trajectory.tum").read_bytes()
    assert np.linalg.eigvalsh(estimate.covariances).min() > 0
    assert set(estimate.sources) <= {"images", "imu"}
    assert (np.array(estimate.sources) == "imu").tolist() == estimate.extrapolated.tolist()
    assert figures["position_sigma_mean_m"] == pytest.approx(estimate.position_sigmas_m.mean(), abs=1e-5)
    assert figures["rotation_sigma_mean_deg"] == pytest.approx(
        np.degrees(estimate.rotation_sigmas_rad).mean(), abs=1e-5
    )
    again = tmp_path / "again"
    done("localize", drive, "--map", drive / "objects.json", "--out", again)
    for name in ("trajectory.tum", "trajectory.csv"):
        assert (again / name).read_bytes() == (run / name).read_bytes()


def test_localizing_in_a_map_in_tiles_gives_the_same_path_and_reads_what_is_near(drive, tmp_path):
    scene = Map.load(drive / "objects.json")
    far = [replace(t, id=1000 + i, world_from_object=FAR @ t.world_from_object) for i, t in enumerate(scene.objects)]
    city = TiledMap.create(tmp_path / "city")
    city.put([*scene.objects, *far])
    for key, entry in city.index.entries.items():
        if key[0] > 40:  # tiles that are never read may be anything
            (tmp_path / "city" / "tiles" / entry.meshes).write_bytes(b"no tile")
    run, plain = tmp_path / "run", tmp_path / "plain"
    figures = json.loads(done("localize", drive, "--map", tmp_path / "city", "--out", run, "--json").stdout)
    small = TiledMap.create(tmp_path / "small")
    small.put(scene.objects)
    done("localize", drive, "--map", tmp_path / "small", "--out", plain)
    assert figures["objects_in_map"] == 2 * len(scene)
    assert (run / "trajectory.tum").read_bytes() == (plain / "trajectory.tum").read_bytes()
    assert "1000" not in (run / "report.html").read_text().split("<h2>Objects</h2>")[1].split("</section>")[0]
    before = (run / "metrics.json").stat().st_mtime_ns
    done("localize", drive, "--map", tmp_path / "city", "--out", run)  # again: nothing is done
    assert (run / "metrics.json").stat().st_mtime_ns == before
    city.remove([next(iter(scene))])
    assert "map" in error_of(meshslam("localize", drive, "--map", tmp_path / "city", "--out", run))


FAR = Pose(np.eye(3), np.array([5000.0, 0.0, 0.0]))


def test_truth_never_reaches_the_path(drive, tmp_path):
    from shutil import copytree

    scene = tmp_path / "known"
    Map.load(drive / "objects.json").save(scene)
    bare = copytree(drive, tmp_path / "bare")
    for name in ("objects.json", "association.json", "groundtruth.tum"):
        (bare / name).unlink()
    done("localize", bare, "--map", scene, "--out", tmp_path / "a")
    done("localize", drive, "--map", scene, "--out", tmp_path / "b")
    assert (tmp_path / "a" / "trajectory.tum").read_bytes() == (tmp_path / "b" / "trajectory.tum").read_bytes()


def test_mistakes_are_said_in_one_line(drive, street, tmp_path):
    out = tmp_path / "run"
    assert "no map is named" in error_of(meshslam("localize", drive, "--out", out))
    assert "no such map" in error_of(meshslam("localize", drive, "--map", tmp_path / "none", "--out", out))
    other = tmp_path / "map.json"
    other.write_text(json.dumps({"format": "meshslam-map", "version": 2, "objects": []}))
    assert "version 2" in error_of(meshslam("localize", drive, "--map", other, "--out", out))
    (street / "imu.csv").unlink()
    camera = yaml.safe_load((street / "camera.yaml").read_text())
    del camera["imu_from_camera"]
    (street / "camera.yaml").write_text(yaml.safe_dump(camera))
    assert "no IMU" in error_of(meshslam("localize", street, "--map", drive / "objects.json", "--out", out))
    found = meshslam("localize", street, "--map", drive / "objects.json", "--imu", drive / "imu.csv", "--out", out)
    assert "without extrinsics" in error_of(found)


def _changed(drive, folder, edit):
    from shutil import copytree

    copytree(drive, folder)
    header, *rows = (folder / "imu.csv").read_text().splitlines()
    (folder / "imu.csv").write_text("\n".join([header, *edit(rows)]) + "\n")
    return folder


def test_an_imu_that_cannot_serve_is_refused_in_clear_words(drive, tmp_path):
    out, known = tmp_path / "run", drive / "objects.json"

    def later(rows):
        return [f"{float(row.split(',')[0]) + 500:.9f},{row.split(',', 1)[1]}" for row in rows]

    other_clock = _changed(drive, tmp_path / "clock", later)
    slow = _changed(drive, tmp_path / "slow", lambda rows: rows[::5])
    assert "another clock?" in error_of(meshslam("slam", other_clock, "--out", out))
    message = error_of(meshslam("localize", slow, "--map", known, "--out", out))
    assert "Hz, at least 50 Hz are needed" in message
    assert str(slow) in message


def test_what_a_path_suffers_from_is_noted(drive, tmp_path):
    gap = _changed(drive, tmp_path / "gap", lambda rows: rows[:10] + rows[30:])
    found = json.loads((gap / "detections.json").read_text())
    (gap / "detections.json").write_text(json.dumps({**found, "annotations": []}))
    run = meshslam("localize", gap, "--map", drive / "objects.json", "--out", tmp_path / "run")
    assert run.returncode == 3  # nothing was used
    said = run.stderr
    assert "no IMU samples from 0.09 s to 0.30 s" in said
    assert "no object is detected in any frame" in said


def test_slam_by_odometry_and_by_the_papers_solver(source, drive, tmp_path):
    """Its poses as odometry; then IMU and gradient descent, the error after each iteration recorded."""
    reckoned = json.loads(done("slam", source, "--poses", "odometry", "--out", tmp_path / "a", "--json").stdout)
    estimate = TrajectoryEstimate.load(tmp_path / "a" / "trajectory.csv")
    assert len(estimate) == 6
    assert estimate.biases is None
    assert set(estimate.sources) <= {"images", "odometry"}
    assert reckoned["scale_by_odometry"] == 1.0
    assert reckoned["scale_by_imu"] == 0.0
    few = tmp_path / "few.yaml"
    few.write_text("expert: {slam: {gradient_iterations: 2}, objects: {gradient: {shape_iterations: 5}}}\n")
    command = ("slam", drive, "--solver", "gradient", "--config", few, "--out", tmp_path / "b", "--json")
    finished = done(*command)
    assert not (tmp_path / "b" / "trajectory.csv").exists()
    assert "trajectory.csv: not written: the solver gradient gives no uncertainty" in finished.stderr
    figures = json.loads(finished.stdout)
    recorded = sorted(key for key in figures if key.startswith("ate_iteration_"))
    assert len(recorded) == figures["iterations"] + 1
    assert figures[recorded[0]] == figures["ate_initial_rmse_m"]
    assert figures[recorded[-1]] == pytest.approx(figures["ate_rmse_m"], rel=1e-6)  # that is of the rounded file
    message = error_of(meshslam("slam", drive, "--poses", "all", "--out", tmp_path / "c"))
    assert "expected none or odometry" in message
