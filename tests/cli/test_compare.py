"""`compare`: runs side by side."""

import shutil

from tests.cli.conftest import done, error_of, meshslam


def test_two_runs_are_compared(source_run, source, tmp_path):
    other = tmp_path / "other"
    done("map", source, "--out", other, "--solver", "gradient")
    said = done("compare", source_run, other, "--out", tmp_path / "page" / "both.html").stdout
    assert "mask_iou_shape" in said
    assert "* " in said
    assert "cars: A to B" in said
    page = (tmp_path / "page" / "both.html").read_text()
    assert "objects.solver" in page
    assert page.count("<img data-run=") == 12
    measured = done("compare", source_run, other, "--truth", source, "--out", tmp_path / "more.html").stdout
    assert "a3dp_abs_mean" in measured


def test_mistakes_are_told(source_run, tmp_path):
    page = tmp_path / "page.html"
    assert "needs two or more" in error_of(meshslam("compare", source_run, "--out", page))
    assert "no such run directory" in error_of(meshslam("compare", source_run, tmp_path / "nowhere", "--out", page))
    broken = shutil.copytree(source_run, tmp_path / "broken")
    (broken / "metrics.json").write_text("{")
    assert "broken/metrics.json" in error_of(meshslam("compare", source_run, broken, "--out", page))
    assert not page.exists()
