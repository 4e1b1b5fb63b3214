"""The programs that need a framework; PyTorch's runs in `make test-torch`."""

import pytest

from tests.examples.test_documents import ROOT, blocks
from tests.examples.test_examples import figure, run


def test_the_code_of_the_page_runs_in_pytorch():
    """Blocks in JAX run with those of all pages."""
    pytest.importorskip("torch", reason="the extra `torch` is not installed: make test-torch")
    import numpy as np

    from meshslam.categories import load_category
    from meshslam.geometry import Camera, Pose, render

    car, camera = load_category("car"), Camera(320, 160, 300.0, 300.0, 159.5, 79.5)
    ahead = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    poses = [Pose(ahead, np.array([0.8, 0.6, 9.0 + k])) for k in range(3)]
    masks = np.stack([render(camera, [(pose, 1.05 * car.vertices, car.faces)]).mask for pose in poses])
    names = {"np": np, "car": car, "camera": camera, "camera_from_object": poses, "masks": masks}
    (code,) = blocks(ROOT / "docs" / "autodiff.md", "py")
    exec(compile(code, "autodiff.md", "exec"), names)
    assert names["vertices"].grad.shape == (642, 3)
    assert names["losses"].shape == (3,)


def test_fit_a_sphere_finds_the_car():
    pytest.importorskip("torch", reason="the extra `torch` is not installed: make test-torch")
    shown = run("fit_a_sphere")
    assert figure(shown, "mask IoU") > 0.97
    assert figure(shown, "voxel IoU with the true mesh") > 0.9


def test_pose_from_a_mask_finds_the_heading_among_twelve():
    pytest.importorskip("jax", reason="the extra `jax` is not installed")
    shown = run("pose_from_a_mask")
    assert figure(shown, "IoU") > 0.98
    assert figure(shown, "m and") < 1.0
    assert float(shown.split(": ")[1].split(" m")[0]) < 0.03


def test_programs_take_files_of_ones_own(tmp_path):
    import cv2
    import numpy as np

    from meshslam.categories import load_category
    from meshslam.geometry import Camera, Pose, render
    from meshslam.maps import PlyMesh, Trajectory, format_ply
    from meshslam.sequences import camera_yaml

    camera, truck = Camera(160, 120, 150.0, 150.0, 79.5, 59.5), load_category("truck")
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turns = (Pose.from_yaw(turn, np.zeros(3)) for turn in (0.4, 1.5, 2.7, 3.6))
    poses = [turn @ Pose(ahead, np.array([-14.0, 0.0, 0.0])) for turn in turns]
    (tmp_path / "masks").mkdir()
    for k, pose in enumerate(poses):
        mask = render(camera, [(pose.inverse(), truck.vertices, truck.faces)]).mask
        cv2.imwrite(str(tmp_path / "masks" / f"{k}.png"), 255 * mask)
    (tmp_path / "camera.yaml").write_text(camera_yaml(camera, None, None, None))
    Trajectory(np.arange(4.0), tuple(poses)).save(tmp_path / "poses.tum")
    (tmp_path / "truck.ply").write_bytes(format_ply(PlyMesh(truck.vertices, truck.faces)))
    try:
        import jax  # noqa: F401 # the extra is there
    except ImportError:
        pytest.skip("the extra `jax` is not installed")
    shown = run("pose_from_a_mask", tmp_path / "truck.ply", tmp_path / "masks" / "0.png", tmp_path / "camera.yaml")
    assert figure(shown, "IoU") > 0.95
    try:
        import torch  # noqa: F401 # the extra is there
    except ImportError:
        return  # tested by make test-torch
    assert figure(run("fit_a_sphere", tmp_path), "mask IoU") > 0.93
