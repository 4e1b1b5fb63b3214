"""trajectory.csv: whoever reads it finds finite, positive semidefinite covariances under names that explain them."""

import csv
import io

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose, exp_so3
from meshslam.maps import Trajectory, TrajectoryEstimate
from meshslam.maps.trajectory_estimate import writable

UPPER = [(i, j) for i in range(6) for j in range(i, 6)]


def covariances(rng, count):
    """Of many sizes and shapes: round, flat, of rank one to six, certain."""
    out = np.zeros((count, 6, 6))
    for i in range(1, count):
        rank = 1 + i % 6
        root = rng.normal(size=(6, rank)) * (10.0 ** rng.uniform(-6, 2, 6))[:, None]
        out[i] = root @ root.T
    return out


@pytest.fixture
def estimate(rng):
    count = 30
    poses = tuple(Pose(exp_so3(rng.normal(0, 1, 3)), rng.normal(0, 50, 3)) for _ in range(count))
    return TrajectoryEstimate(
        Trajectory(100.0 + 0.1 * np.arange(count), poses),
        tuple(range(3, 3 + count)),
        covariances(rng, count),
        rng.normal(0, 5, (count, 3)),
        rng.normal(0, 0.1, (count, 6)),
        tuple("images" if i % 3 else "imu" for i in range(count)),
        np.arange(count) % 3 == 0,
    )


def matrix_of(row):
    """A covariance from a row that maps names to numbers."""
    out = np.zeros((6, 6))
    for i, j in UPPER:
        out[i, j] = out[j, i] = float(row[f"c{i}{j}"])
    return out


def test_anybody_can_read_it_with_the_csv_module(estimate):
    rows = list(csv.DictReader(io.StringIO(estimate.to_csv().decode())))
    assert len(rows) == len(estimate)
    for i, row in enumerate(rows):
        found, expected = matrix_of(row), estimate.covariances[i]
        sigmas = np.sqrt(np.diag(expected))
        assert (np.abs(found - expected) <= 1e-5 * np.outer(sigmas, sigmas)).all()
        assert float(row["position_sigma_m"]) == pytest.approx(estimate.position_sigmas_m[i], rel=1e-5)
        assert np.radians(float(row["rotation_sigma_deg"])) == pytest.approx(estimate.rotation_sigmas_rad[i], rel=1e-5)
        assert row["source"] == estimate.sources[i]
        assert (row["extrapolated"] == "1") == bool(estimate.extrapolated[i])
        assert int(row["frame"]) == estimate.frame_ids[i]


def test_anybody_can_read_it_with_numpy(estimate):
    table = np.genfromtxt(io.BytesIO(estimate.to_csv()), delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["tx"] == pytest.approx(estimate.trajectory.positions_in_world[:, 0], abs=1e-9)
    assert table["vx"] == pytest.approx(estimate.velocity_in_world[:, 0], abs=1e-9)
    assert table["bgz"] == pytest.approx(estimate.biases[:, 5], abs=1e-9)
    assert list(table["source"]) == list(estimate.sources)


def test_anybody_can_read_it_with_pandas(estimate):
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(io.BytesIO(estimate.to_csv()))
    assert len(table) == len(estimate)
    assert not table.isna().any().any()
    assert matrix_of(table.iloc[5]) == pytest.approx(writable(estimate.covariances[5]), rel=1e-6)


def test_every_written_covariance_is_finite_and_positive_semidefinite(rng):
    """Whatever rounding does to it, the digits have a Cholesky factor where no variance is nothing."""
    for covariance in covariances(rng, 300)[1:]:
        broken = covariance * (1 + rng.normal(0, 1e-12, (6, 6)))
        found = np.array([[float(f"{value:.6e}") for value in row] for row in writable(broken)])
        assert np.isfinite(found).all()
        assert (found == found.T).all()
        np.linalg.cholesky(found)


def test_the_digits_do_not_hold_rounding(rng):
    """What differs in its last bits is written with the same bytes."""
    root = rng.normal(size=(6, 6)) * np.array([0.3, 0.2, 0.5, 0.01, 0.02, 0.003])[:, None]
    covariance = root @ root.T
    covariance[0, 4] = covariance[4, 0] = 1e-17
    apart = covariance.copy()
    apart[0, 4] = apart[4, 0] = -3e-17
    assert np.array_equal(writable(apart), writable(covariance))


def test_variances_of_less_than_a_poses_last_digit_are_none(rng):
    root = rng.normal(size=(6, 6)) * np.array([1e-10, 1e-10, 1e-10, 1e-3, 1e-3, 1e-3])[:, None]
    found = writable(root @ root.T)
    assert (found[:3] == 0).all()
    assert (found[:, :3] == 0).all()
    assert found[3:, 3:] == pytest.approx((root @ root.T)[3:, 3:], rel=1e-4)


def test_it_comes_back_as_it_was_saved(estimate, tmp_path):
    estimate.save(tmp_path / "trajectory.csv")
    found = TrajectoryEstimate.load(tmp_path / "trajectory.csv")
    for covariance, expected in zip(found.covariances, estimate.covariances, strict=True):
        assert covariance == pytest.approx(writable(expected), rel=1e-6)
    assert found.trajectory.to_tum() == estimate.trajectory.to_tum()
    assert found.velocity_in_world == pytest.approx(estimate.velocity_in_world, abs=1e-9)
    assert found.biases == pytest.approx(estimate.biases, abs=1e-9)
    assert found.frame_ids == estimate.frame_ids
    assert found.sources == estimate.sources
    assert (found.extrapolated == estimate.extrapolated).all()


def test_poses_are_those_of_the_tum_file(estimate):
    rows = list(csv.DictReader(io.StringIO(estimate.to_csv().decode())))
    names = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
    lines = "".join(" ".join(row[name] for name in names) + "\n" for row in rows)
    assert lines.encode() == estimate.trajectory.to_tum()


def test_in_the_world_it_is_that_of_positions_and_of_turns_from_the_left(rng):
    pose = Pose(exp_so3(rng.normal(size=3)), rng.normal(size=3))
    root = 1e-3 * rng.normal(size=(6, 6))
    one = TrajectoryEstimate(
        Trajectory(np.zeros(1), (pose,)),
        (0,),
        (root @ root.T)[None],
        np.zeros((1, 3)),
        None,
        ("imu",),
        np.ones(1, bool),
    )
    drawn = [pose.retract(root @ rng.normal(size=6)) for _ in range(20000)]
    turned = np.array([d.rotation @ pose.rotation.T for d in drawn])
    left = np.stack(
        [turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]], 1
    )
    moved = np.hstack([[d.translation - pose.translation for d in drawn], 0.5 * left])
    found, expected = one.covariances_in_world[0], moved.T @ moved / len(moved)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(found - expected) < 0.05 * scale).all()


def test_without_an_imu_there_are_no_biases(estimate, tmp_path):
    bare = TrajectoryEstimate(**(vars(estimate) | {"biases": None}))
    assert "bax" not in bare.to_csv().decode().splitlines()[0]
    bare.save(tmp_path / "trajectory.csv")
    assert TrajectoryEstimate.load(tmp_path / "trajectory.csv").biases is None


def test_what_is_not_finite_is_refused(estimate):
    wrong = estimate.covariances.copy()
    wrong[4, 1, 1] = np.nan
    with pytest.raises(MapError, match="NaN or infinity"):
        TrajectoryEstimate(**(vars(estimate) | {"covariances": wrong})).to_csv()


def test_numbers_of_rows_that_differ_are_refused(estimate):
    with pytest.raises(MapError, match="one row a pose"):
        TrajectoryEstimate(**(vars(estimate) | {"sources": ("imu",)}))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("c00", "c0"), "header lacks c00"),
        (
            lambda text: text.replace("100.200000000,5,", "100.200000000,none,"),
            "line 4: frame: expected a finite number",
        ),
        (lambda text: text.rsplit(",", 10)[0], "line 31: "),
        (lambda text: "", "header lacks timestamp"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(estimate, tmp_path, change, said):
    path = tmp_path / "trajectory.csv"
    path.write_text(change(estimate.to_csv().decode()))
    with pytest.raises(MapError, match=said) as error:
        TrajectoryEstimate.load(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
