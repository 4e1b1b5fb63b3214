import json
import re
import shutil
import signal
import sys
import tempfile

import pytest

from meshslam.cli import app as cli_app
from meshslam.errors import MapError
from meshslam.maps import Map, read_figures
from tests.cli.conftest import error_of, meshslam
from tests.perception.networks import other_network


def replaced(name, pattern, text):
    def change(folder):
        file = folder / name
        new, count = re.subn(pattern, text, file.read_text(), count=1, flags=re.MULTILINE)
        assert count == 1
        file.write_text(new)

    return change


def line(name, number, text):
    def change(folder):
        rows = (folder / name).read_text().splitlines()
        rows[number - 1] = text
        (folder / name).write_text("\n".join(rows) + "\n")

    return change


def first_lines(name, count):
    def change(folder):
        (folder / name).write_text("".join((folder / name).read_text().splitlines(keepends=True)[:count]))

    return change


def another_clock(folder):
    file = folder / "poses.tum"
    rows = [line.split(maxsplit=1) for line in file.read_text().splitlines()]
    file.write_text("".join(f"{float(time_s) + 1e6:.9f} {pose}\n" for time_s, pose in rows))


def document(edit):
    def change(folder):
        content = json.loads((folder / "detections.json").read_text())
        edit(content)
        (folder / "detections.json").write_text(json.dumps(content))

    return change


def annotation(**fields):
    return document(lambda content: content["annotations"][3].update(fields))


def image(content):
    def change(folder):
        file = folder / "images" / "000003.png"
        file.write_bytes(content(file.read_bytes()))

    return change


def no_images(folder):
    shutil.rmtree(folder / "images")
    (folder / "images").mkdir()


NAN = float("nan")
BROKEN = {
    "truncated image": (image(lambda b: b[:2000]), "000003.png", "truncated"),
    "unreadable image": (image(lambda b: b"no image"), "000003.png", "neither a PNG nor"),
    "empty image file": (image(lambda b: b""), "000003.png", "empty"),
    "missing image": (lambda folder: (folder / "images" / "000003.png").unlink(), "images", "5 images"),
    "no intrinsics": (replaced("camera.yaml", r"^intrinsics:.*\n", ""), "camera.yaml", "intrinsics"),
    "no resolution": (replaced("camera.yaml", r"^resolution:.*\n", ""), "camera.yaml", "resolution"),
    "no calibration": (lambda folder: (folder / "camera.yaml").unlink(), "camera.yaml", "no such file"),
    "NaN in calibration": (replaced("camera.yaml", r"190\.0", ".nan"), "camera.yaml", "intrinsics"),
    "times that go back": (line("times.txt", 4, "0.05"), "times.txt", "line 4"),
    "NaN in times": (line("times.txt", 4, "nan"), "times.txt", "line 4"),
    "poses of another clock": (another_clock, "poses.tum", "another clock"),
    "NaN in poses": (line("poses.tum", 4, "0.3 nan 0 0 0 0 0 1"), "poses.tum", "line 4"),
    "no poses": (lambda folder: (folder / "poses.tum").unlink(), "street", "poses"),
    "unknown category": (annotation(category_id=9), "detections.json", "category_id"),
    "mask of another size": (
        annotation(segmentation={"size": [10, 10], "counts": [100]}),
        "detections.json",
        "segmentation",
    ),
    "NaN in a box": (annotation(bbox=[NAN, 1, 2, 3]), "detections.json", "bbox"),
    "NaN in a score": (annotation(score=NAN), "detections.json", "score"),
    "NaN in key points": (annotation(keypoints=[NAN, 20.0, 2] * 12), "detections.json", "keypoints"),
    "detection in no image": (annotation(image_id=77), "detections.json", "image_id"),
    "image of no frame": (
        document(lambda c: c["images"].append({"id": 77, "file_name": "a.png", "width": 320, "height": 100})),
        "detections.json",
        "images id 77",
    ),
    "image of another size": (
        document(
            lambda c: (
                c.update(annotations=[a for a in c["annotations"] if a["image_id"]]),
                c["images"][0].update(width=9),
            )
        ),
        "detections.json",
        "9x100",
    ),
    "cut JSON": (lambda folder: (folder / "detections.json").write_text('{"images": ['), "detections.json", "JSON"),
    "empty sequence": (no_images, "images", "empty"),
    "no times": (lambda folder: (folder / "times.txt").write_text(""), "times.txt", "empty"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_is_named_with_its_file_and_key(street, tmp_path, name):
    change, file, key = BROKEN[name]
    change(street)
    error = error_of(meshslam("map", street, "--out", tmp_path / "run"))
    assert file in error
    assert key in error
    assert not (tmp_path / "run" / "map.json").exists()
    assert not list(tmp_path.rglob("*.meshslam-part"))


def test_what_does_not_exist_is_named(source, tmp_path):
    run = tmp_path / "run"
    assert "no such folder" in error_of(meshslam("map", tmp_path / "nowhere", "--out", run))
    assert "named" in error_of(meshslam("map", "--out", run))
    for option in ("--detections", "--segmenter", "--config"):
        assert str(tmp_path / "none") in error_of(meshslam("map", source, "--out", run, option, tmp_path / "none"))
    assert "kitti-raw" in error_of(meshslam("map", source, "--out", run, "--layout", "nonsense"))
    assert "hungarian" in error_of(meshslam("map", source, "--out", run, "--tracker", "nonsense"))
    assert "car" in error_of(meshslam("map", source, "--out", run, "--category", "boat"))


WRONG_SETTINGS = {
    "out of range": ("map", "mapping: {min_views: -3}", "mapping.min_views: expected a whole number of at least 1"),
    "text for a number": (
        "map",
        "mapping: {max_distance_m: far}",
        "mapping.max_distance_m: expected a number above 0 (m)",
    ),
    "a list for a number": ("map", "mapping: {min_views: [3, 4]}", "found [3, 4]"),
    "a typing error": ("map", "mapping: {min_vews: 3}", "did you mean mapping.min_views?"),
    "a name of 0.1": ("map", "mapping: {noise: {border_kernel: 2}}", "expert: {objects: {noise: {border_kernel: 2}}}"),
    "of another command": ("map", "slam: {lag_s: 3}", "map does not use slam.lag_s (slam does): remove it"),
    "of another command's own": ("slam", "localization: {solver: gradient}", "slam.solver: give that one"),
    "an expert one in public": ("map", "mapping: {passes: 1}", "write expert: {mapping: {passes: 1}}"),
    "a public one among experts": ("map", "expert: {mapping: {min_views: 3}}", "write mapping: {min_views: 3}"),
    "for detect": ("detect", "tracking: {tracker: paper}", "detect does not use tracking.tracker (map and slam do)"),
    "for localize": ("localize", "mapping: {min_views: 3}", "localize does not use mapping.min_views"),
    "for simulate": (
        "simulate",
        "street: {frames: 0}",
        "street.frames: expected a whole number of at least 1, found 0",
    ),
    "unknown to simulate": ("simulate", "street: {frame: 3}", "did you mean street.frames?"),
}


@pytest.mark.parametrize("name", WRONG_SETTINGS)
def test_a_wrong_setting_is_named_with_what_to_write(source, tmp_path, name):
    command, text, said = WRONG_SETTINGS[name]
    (tmp_path / "settings.yaml").write_text(text)
    places = [tmp_path / "run"] if command == "simulate" else [source, "--out", tmp_path / "run"]
    error = error_of(meshslam(command, *places, "--config", tmp_path / "settings.yaml"))
    assert error.startswith(f"error: {tmp_path / 'settings.yaml'}: ")
    assert said in error
    assert not (tmp_path / "run").exists()


def test_networks_that_are_none_are_named(source, tmp_path):
    odd = other_network(tmp_path / "odd.onnx", [(1, 5, 7)])
    (tmp_path / "text.onnx").write_text("no network")
    for command, out in (("map", "run"), ("detect", "found.json")):
        error = error_of(meshslam(command, source, "--segmenter", odd, "--out", tmp_path / out))
        assert "odd.onnx" in error
        assert "(1, 5, 7)" in error
        assert "without masks" in error
    assert "text.onnx" in error_of(
        meshslam("map", source, "--segmenter", tmp_path / "text.onnx", "--out", tmp_path / "run2")
    )


def test_nothing_says_where_objects_are(street, tmp_path):
    (street / "detections.json").unlink()
    assert "--segmenter" in error_of(meshslam("map", street, "--out", tmp_path / "run"))


def test_key_points_outside_the_image_are_left_out_and_said(street, tmp_path):
    annotation(keypoints=[5000.0, 20.0, 2] * 12)(street)
    result = meshslam("map", street, "--out", tmp_path / "run")
    assert result.returncode == 0
    assert "note: " in result.stderr
    assert "outside" in result.stderr
    assert len(Map.load(tmp_path / "run")) >= 3


def empty_frame(content):
    content["annotations"] = [a for a in content["annotations"] if a["image_id"] != 2]


def missing_entry(content):
    empty_frame(content)
    del content["images"][2]


def nothing(content):
    content.update(annotations=[], images=[])


@pytest.mark.parametrize(("edit", "fewest"), [(empty_frame, 3), (missing_entry, 3), (nothing, 0)])
def test_frames_without_detections_are_frames_all_the_same(street, tmp_path, edit, fewest):
    document(edit)(street)
    result = meshslam("map", street, "--out", tmp_path / "run", "--json")
    assert result.returncode == (0 if fewest else 3), result.stderr
    figures = json.loads(result.stdout)
    assert bool(fewest) or "0 objects mapped: 0 detections make no track" in result.stderr
    assert figures["frames"] == 6
    assert figures["objects_mapped"] >= fewest
    found = json.loads((tmp_path / "run" / "detections.json").read_text())
    assert [entry["id"] for entry in found["images"]] == list(range(6))
    assert len((tmp_path / "run" / "trajectory.tum").read_text().splitlines()) == 6


def test_one_frame_is_a_sequence(street, tmp_path):
    for i in range(1, 6):
        (street / "images" / f"{i:06d}.png").unlink()
    first_lines("times.txt", 1)(street)
    first_lines("poses.tum", 1)(street)
    document(
        lambda c: c.update(images=c["images"][:1], annotations=[a for a in c["annotations"] if a["image_id"] == 0])
    )(street)
    result = meshslam("map", street, "--out", tmp_path / "run", "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["objects_mapped"] >= 1


DAMAGED_FIGURES = ["", '{"frames": 6, ', "[]", '{"a": 1}', '{"frames": 1e999}', "\udcff", "[" * 100000]


@pytest.mark.parametrize("text", DAMAGED_FIGURES, ids=range(len(DAMAGED_FIGURES)))
def test_damaged_figures_of_a_run_that_is_there_are_named(source_run, tmp_path, text):
    run = tmp_path / "run"
    run.mkdir()
    (run / "metrics.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(MapError, match=r"metrics\.json: is damaged: --overwrite makes the run anew"):
        read_figures(run)
    assert read_figures(source_run)["frames"] == 6


def test_a_damaged_run_is_one_line(source, source_run, tmp_path):
    run = shutil.copytree(source_run, tmp_path / "run")
    (run / "metrics.json").write_text("{")
    assert "metrics.json: is damaged" in error_of(meshslam("map", source, "--out", run))


def test_links_in_a_circle_are_one_line(source, tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    assert "no such folder or file" in error_of(meshslam("map", loop, "--out", tmp_path / "run"))
    assert "loop" in error_of(meshslam("map", source, "--out", loop))
    assert "loop" in error_of(meshslam("map", source, "--out", tmp_path / "run", "--detections", loop))
    assert "loop" in error_of(meshslam("simulate", loop))


def test_ctrl_c_in_the_middle_of_an_import_is_ctrl_c(monkeypatch, capsys):
    def interrupted():
        try:
            raise cli_app._Interrupted
        except cli_app._Interrupted as error:
            raise ImportError("initialization failed") from error

    def ended(code):
        raise SystemExit(code)

    monkeypatch.setattr(cli_app, "app", interrupted)
    monkeypatch.setattr(cli_app.signal, "signal", lambda *_: None)
    monkeypatch.setattr(cli_app.os, "_exit", ended)
    with pytest.raises(SystemExit) as end:
        cli_app.main()
    assert end.value.code == 130
    assert capsys.readouterr().err.startswith("interrupted: ")


def test_ctrl_c_is_what_native_code_knows_and_ends_a_command_with_130(source, tmp_path, monkeypatch, capsys):
    handlers = {}

    def interrupted(*_arguments, **_settings):
        handlers[signal.SIGINT](signal.SIGINT, None)

    monkeypatch.setattr(cli_app.signal, "signal", handlers.__setitem__)
    monkeypatch.setattr(cli_app.os, "_exit", lambda code: sys.exit(code))
    monkeypatch.setattr(sys, "argv", ["meshslam", "check", str(source)])
    monkeypatch.setattr("meshslam.runs.check_recording", interrupted)
    with pytest.raises(SystemExit) as end:
        cli_app.main()
    assert end.value.code == 130
    assert capsys.readouterr().err == (
        "interrupted: what is written is whole; the same command again goes on from there\n"
    )
    with pytest.raises(KeyboardInterrupt):  # Ray's waiting turns any other into a SystemError, and goes on
        interrupted()


def test_a_fault_of_ours_is_one_line_and_a_file(tmp_path, monkeypatch, capsys):
    def faulty():
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(cli_app, "app", faulty)
    monkeypatch.setattr(cli_app.signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        cli_app.main()
    assert ended.value.code == 70
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "ZeroDivisionError: a b: this is a fault of meshslam" in said
    (kept,) = tmp_path.glob("meshslam-fault-*.txt")
    assert "in faulty" in kept.read_text()
