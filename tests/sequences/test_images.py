import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import check_sequence, open_sequence
from meshslam.sequences.images import load_image
from tests.sequences.conftest import random_image


@pytest.fixture(params=[".png", ".jpg"])
def image_file(request, tmp_path, rng):
    path = tmp_path / f"000000{request.param}"
    cv2.imwrite(str(path), cv2.GaussianBlur(random_image(rng, (60, 80, 3)), (5, 5), 0))
    return path


def test_a_whole_image_is_read_as_opencv_does(image_file):
    assert (load_image(image_file, (80, 60)) == cv2.imread(str(image_file))).all()


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_truncated_image_is_an_error_wherever_it_ends(image_file, share):
    content = image_file.read_bytes()
    image_file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(SequenceError, match=image_file.name):
        load_image(image_file)


def test_a_flipped_bit_in_a_png_is_an_error(tmp_path, rng):
    path = tmp_path / "000000.png"
    cv2.imwrite(str(path), random_image(rng))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(bytes(content))
    with pytest.raises(SequenceError, match="PNG is damaged at byte"):
        load_image(path)


def test_an_image_of_another_size_names_both_sizes(image_file):
    with pytest.raises(SequenceError, match="image is 80x60, but the camera's resolution is 64x48"):
        load_image(image_file, (64, 48))


def test_other_files_are_no_images(tmp_path):
    path = tmp_path / "000000.png"
    path.write_text("hello")
    with pytest.raises(SequenceError, match="neither a PNG nor a JPEG"):
        load_image(path)
    with pytest.raises(SequenceError, match="no such image"):
        load_image(tmp_path / "000001.png")
    (tmp_path / "000002.png").mkdir()
    with pytest.raises(SequenceError, match=r"000002\.png: image cannot be read"):
        load_image(tmp_path / "000002.png")


def test_sixteen_bit_images_come_as_eight(tmp_path, rng):
    path = tmp_path / "000000.png"
    deep = rng.integers(0, 65536, (48, 64), dtype=np.uint16)
    cv2.imwrite(str(path), deep)
    assert np.abs(load_image(path)[..., 0].astype(float) - deep / 256).max() <= 1


def test_a_damaged_image_is_found_by_the_check_and_when_it_is_read(folder):
    path = folder / "images" / "000003.png"
    path.write_bytes(path.read_bytes()[:200])
    sequence = open_sequence(folder)
    sequence.read_image(2)
    with pytest.raises(SequenceError, match=r"000003\.png: PNG is truncated"):
        sequence.read_image(3)
    assert [problem.file for problem in check_sequence(folder)] == [path]


def test_an_image_that_vanished_is_an_error(folder):
    sequence = open_sequence(folder)
    sequence.image_paths[1].unlink()
    with pytest.raises(SequenceError, match=r"000001\.png: no such image"):
        sequence.read_image(1)
