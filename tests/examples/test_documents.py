"""The code that README and docs show runs; the commands, files and targets that they name exist."""

import ast
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import meshslam
from meshslam.categories import load_category
from meshslam.cli.app import app
from meshslam.geometry import Camera, Pose, render
from meshslam.maps import PlyMesh, format_ply
from meshslam.perception import ColourSegmenter
from meshslam.simulation import StreetConfig, driven_again, make_street, write_recording

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    *(ROOT / "docs" / name for name in ("live.md", "covariances.md", "autodiff.md")),
    *sorted((ROOT / "docs" / "python").glob("*.md")),
]
TEXTS = [ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "RELEASES.md", "STYLE.md")]
TEXTS += sorted((ROOT / "docs").rglob("*.md"))
CODE = ("python", "tests", "crates", "scripts", "benchmarks", "examples", "docs")
NOT_OURS = ("score_run.py", "make_case.py")  # they judge the package from outside
SKIPPED = re.compile(r"<!-- not run: .+ -->\n```python\n")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def blocks(page, language):
    """The text of each fenced block of a language."""
    return [text for found, text in FENCE.findall(page.read_text(encoding="utf-8")) if found == language]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the pages name: two drives, a run, a network's file, masks with poses, a mesh file."""
    place, car = tmp_path_factory.mktemp("documents"), load_category("car")
    config = StreetConfig(
        frames=10, width_px=480, height_px=150, focal_px=285.0, cars_each_side=2, moving_cars=0, mode="contrast"
    )
    street = make_street(car, 1, config)
    write_recording(street, place / "drive")
    write_recording(driven_again(street, config), place / "drive2", known_poses=False)
    made = meshslam.map_drive(place / "drive")
    made.map.save(place / "run")
    made.trajectory.save(place / "run" / "trajectory.tum")
    (place / "yolov5n-seg.onnx").touch()  # stands for a network: see `segmenter_by_colour`

    camera = Camera(640, 480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turns = [Pose.from_yaw(turn, np.zeros(3)) for turn in (0.3, 1.4, 2.6, 3.5)]
    poses = [Pose(turn.rotation @ ahead, turn.transform(np.array([-9.0, 0.0, 0.0]))) for turn in turns]
    masks = [render(camera, [(pose.inverse(), car.vertices, car.faces)]).mask for pose in poses]
    np.save(place / "masks.npy", masks)
    np.save(place / "world_from_camera.npy", [pose.matrix for pose in poses])
    (place / "chair.ply").write_bytes(format_ply(PlyMesh(car.vertices / 4, car.faces)))
    return place


@pytest.fixture
def segmenter_by_colour(monkeypatch):
    """The drawn cars are found by their colours, whatever network a page names: pages need no recordings."""
    for room in ("meshslam.runs.perception", "meshslam.perception.frame_perception", "meshslam.live.slam"):
        monkeypatch.setattr(f"{room}.load_segmenter", lambda *_, **__: ColourSegmenter())


def shapes_said(code):
    """Line, expression and shapes of each plain expression whose comment begins with shapes such as `(642, 3)`."""
    lines = code.splitlines()
    for node in ast.parse(code).body:
        comment = lines[node.lineno - 1].partition("  # ")[2]
        said = re.findall(r"\((\d+(?:, \d+)*),?\)", comment)
        if isinstance(node, ast.Expr) and said:
            yield node, [tuple(int(n) for n in shape.split(", ")) for shape in said]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
@pytest.mark.usefixtures("segmenter_by_colour")
def test_code_of_a_page_runs_and_shapes_are_as_it_says(page, folder, tmp_path, monkeypatch):
    text = SKIPPED.sub("```text\n", page.read_text(encoding="utf-8"))
    code = "\n".join(found for language, found in FENCE.findall(text) if language == "python")
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "run").unlink()
    shutil.copytree(folder / "run", tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(code, page.name, "exec"), names)
    for node, shapes in shapes_said(code):
        values = eval(compile(ast.Expression(node.value), page.name, "eval"), names)
        values = values if isinstance(values, tuple) else (values,)
        found = [np.shape(v) for v in values]
        assert found[: len(shapes)] == shapes[: len(found)], ast.unparse(node)


def test_few_blocks_are_not_run():
    assert sum(len(SKIPPED.findall(page.read_text(encoding="utf-8"))) for page in PAGES) <= 1


def commands():
    """Every line that runs meshslam in a shell block of README and docs."""
    for page in TEXTS:
        for language, text in FENCE.findall(page.read_text(encoding="utf-8")):
            for line in text.splitlines() if language in ("", "sh") else ():
                words = shlex.split(line.replace("…", "").partition("--ros-args")[0], comments=True)
                if words and Path(words[0]).name == "meshslam":
                    yield page.name, words[1:]


def test_commands_and_their_options_exist():
    found = list(commands())
    assert len(found) > 10
    for page, words in found:
        command = get_command(app)
        for word in words:
            if hasattr(command, "commands"):
                assert word in command.commands, f"{page}: meshslam {' '.join(words)}: no command {word}"
                command = command.commands[word]
            elif word.startswith("--"):
                options = {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
                assert word.partition("=")[0] in options, f"{page}: meshslam {' '.join(words)}: no option {word}"


def test_targets_of_make_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for page in TEXTS:
        for name in re.findall(r"`make ([a-z-]+)`|^make ([a-z-]+)", page.read_text(encoding="utf-8"), re.MULTILINE):
            assert "".join(name) in targets, f"{page.name}: make {''.join(name)}"


def test_files_of_the_code_that_pages_name_exist():
    code = [p for place in CODE for p in (ROOT / place).rglob("*") if p.suffix in (".py", ".rs")]
    for page in TEXTS:
        for name in re.findall(r"`([\w/]+\.(?:py|rs))[:`]", page.read_text(encoding="utf-8")):
            found = any(p.as_posix().endswith(f"/{name}") for p in code)
            assert found or name in NOT_OURS, f"{page.relative_to(ROOT)}: {name}"


def test_links_between_files_of_the_repository_lead_somewhere():
    for page in TEXTS:
        for target in re.findall(r"\]\(([^)#]+)(?:#[\w-]*)?\)", page.read_text(encoding="utf-8")):
            made = page.parent.name == "reference"  # pages of rooms are made while the site is built, which checks them
            if "://" not in target and not made:
                assert (page.parent / target).exists(), f"{page.relative_to(ROOT)}: {target}"
