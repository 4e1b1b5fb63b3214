import cv2
import numpy as np
import pytest
import trimesh

from meshslam.errors import MapError
from meshslam.maps import ply
from meshslam.maps.ply import PlyMesh, format_ply, read_mesh


@pytest.fixture
def mesh(rng):
    ball = trimesh.creation.icosphere(subdivisions=3)
    count = len(ball.vertices)
    return PlyMesh(rng.normal(size=(count, 3)), np.array(ball.faces), rng.uniform(0, 1, count), rng.random(count) < 0.5)


def test_round_trip_and_the_same_bytes_again(tmp_path, mesh):
    path = tmp_path / "a.ply"
    path.write_bytes(format_ply(mesh))
    read = read_mesh(path)
    assert np.abs(read.vertices - mesh.vertices).max() < 1e-6
    assert np.array_equal(read.faces, mesh.faces)
    assert np.abs(read.sigma_m - mesh.sigma_m).max() < 1e-7
    assert np.array_equal(read.observed, mesh.observed)
    assert format_ply(read) == format_ply(mesh)


def test_trimesh_keeps_order_and_topology(tmp_path, mesh):
    path = tmp_path / "a.ply"
    path.write_bytes(format_ply(mesh))
    read = trimesh.load(path, process=False)
    assert (read.vertices.shape, read.faces.shape) == ((642, 3), (1280, 3))
    assert np.allclose(read.vertices, mesh.vertices)
    assert np.array_equal(read.faces, mesh.faces)


def test_opencv_reads_it(tmp_path, mesh):
    """OpenCV 5.0 gives no vertices, without a word, where coordinates are doubles."""
    path = tmp_path / "a.ply"
    path.write_bytes(format_ply(mesh))
    vertices, faces, *_ = cv2.loadMesh(str(path))
    assert np.allclose(np.asarray(vertices).reshape(-1, 3), mesh.vertices, atol=1e-6)
    assert len(faces) == len(mesh.faces)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl"])
def test_other_meshes_are_read_without_properties(tmp_path, suffix):
    trimesh.creation.box((1, 2, 3)).export(tmp_path / f"a.{suffix}")
    read = read_mesh(tmp_path / f"a.{suffix}")
    assert np.allclose(np.ptp(read.vertices, axis=0), [1, 2, 3])
    assert read.sigma_m is None
    assert read.observed is None


def test_ascii_with_properties_is_read(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float sigma_m\nproperty uchar observed\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n0 0 0 0.1 1\n1 0 0 0.2 0\n0 1 0 0.3 1\n3 0 1 2\n"
    )
    read = read_mesh(tmp_path / "a.ply")
    assert np.allclose(read.sigma_m, [0.1, 0.2, 0.3])
    assert read.observed.tolist() == [True, False, True]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_a_truncated_mesh_is_an_error(tmp_path, mesh, share):
    content = format_ply(mesh)
    (tmp_path / "a.ply").write_bytes(content[: int(share * len(content))])
    with pytest.raises(MapError, match=r"a\.ply: "):
        read_mesh(tmp_path / "a.ply")


def test_nan_and_wrong_corners_are_errors(tmp_path, mesh):
    vertices = mesh.vertices.copy()
    vertices[3, 1] = np.nan
    (tmp_path / "a.ply").write_bytes(format_ply(PlyMesh(vertices, mesh.faces)))
    with pytest.raises(MapError, match="holds NaN"):
        read_mesh(tmp_path / "a.ply")
    (tmp_path / "a.ply").write_bytes(format_ply(PlyMesh(mesh.vertices, mesh.faces + 600)))
    with pytest.raises(MapError, match=r"a\.ply: "):
        read_mesh(tmp_path / "a.ply")


def test_gltf_meshes_are_turned_z_up_and_what_is_not_read_right_is_refused(tmp_path):
    box = trimesh.creation.box((4.0, 1.5, 2.0))  # y up
    box.export(tmp_path / "car.glb")
    assert np.allclose(np.ptp(read_mesh(tmp_path / "car.glb").vertices, axis=0), [4.0, 2.0, 1.5])
    content = (tmp_path / "car.glb").read_bytes()
    (tmp_path / "car.glb").write_bytes(content.replace(b'"componentType":5126', b'"componentType":5122'))
    with pytest.raises(MapError, match="KHR_mesh_quantization"):
        read_mesh(tmp_path / "car.glb")


@pytest.mark.parametrize("with_sigma", [True, False])
def test_plain_files_are_read_as_trimesh_reads_them(tmp_path, mesh, with_sigma):
    bare = PlyMesh(mesh.vertices, mesh.faces)
    (tmp_path / "a.ply").write_bytes(format_ply(mesh if with_sigma else bare))
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "b.ply")
    for name in ("a.ply", "b.ply"):
        vertices, faces, data = ply._plain_ply(tmp_path / name)
        expected = ply._any_mesh(tmp_path / name)
        np.testing.assert_array_equal(vertices, expected[0])
        np.testing.assert_array_equal(faces, expected[1])
        for column in ("sigma_m", "observed"):
            ours, theirs = ply._column(data, column), ply._column(expected[2], column)
            assert (ours is None) == (theirs is None)
            assert ours is None or (ours == theirs).all()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"little_endian", b"big_endian"),
        (b"property float z", b"property float s"),
        (b"property float z", b"property list uchar float z"),
        (b"element face", b"element tristrips"),
        (b"uchar int vertex_indices", b"uchar short vertex_indices"),
        (b"end_header\n", b"end_header\r\n"),
        (b"element vertex 642", b"element vertex 641"),
        (b"\x03\x00", b"\x04\x00"),
    ],
)
def test_what_is_not_plain_is_left_to_trimesh(tmp_path, mesh, old, new):
    content = format_ply(PlyMesh(mesh.vertices, mesh.faces))
    assert old in content
    (tmp_path / "a.ply").write_bytes(content.replace(old, new, 1))
    assert ply._plain_ply(tmp_path / "a.ply") is None
