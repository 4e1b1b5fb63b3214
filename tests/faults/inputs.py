"""Small inputs, and the commands that are put to the test on them."""

import shutil
from pathlib import Path

import yaml

from meshslam.categories import load_category
from meshslam.simulation import EXACT, StreetConfig, make_street, write_recording
from tests.faults.harness import Case
from tests.perception.networks import colour_network

STREET = StreetConfig(frames=5, width_px=320, height_px=100, focal_px=190.0, cars_each_side=1, speed_m_s=15.0)


def make_inputs(folder):
    """A recording without images, settings for `simulate`, a mesh, a network."""
    drive = write_recording(make_street(load_category("car"), 1, STREET), folder / "drive", EXACT)
    shutil.rmtree(drive / "images")
    small = {"frames": 2, "width_px": 160, "height_px": 60, "focal_px": 95.0, "cars_each_side": 1, "moving_cars": 0}
    (folder / "small.yaml").write_text(yaml.safe_dump({"street": small}))
    for name, part in (("map", "objects"), ("localize", "localization"), ("slam", "objects")):
        (folder / f"{name}.yaml").write_text(f"expert: {{{part}: {{edge_margin_px: 8}}}}\n")
    colour_network(folder / "net.onnx")
    return drive


def cases_of(folder, zygote, memory=None):
    """Every command with nothing before it, and over an older result."""
    drive = make_inputs(folder)
    true = drive / "objects.json"
    mesh = sorted((drive / "meshes").glob("*.ply"))[0]
    found = []
    for name, more in (("map", []), ("localize", ["--map", true]), ("slam", [])):
        out = folder / f"{name}.run"
        command = [name, drive, *more, "--out", out]
        found.append(Case(name, command, out))
        old = _kept(zygote, [*command, "--config", folder / f"{name}.yaml"], out, memory)
        found.append(Case(f"{name} --overwrite", [*command, "--overwrite"], out, old))
    street = folder / "street"
    draw = ["simulate", street, "--config", folder / "small.yaml", "--hidden-poses"]
    found.append(Case("simulate", draw, street))
    old = _kept(zygote, ["simulate", street, "--config", folder / "small.yaml", "--seed", 3], street, memory)
    (old / "mine.txt").write_text("mine")
    found.append(Case("simulate --overwrite", [*draw, "--overwrite"], street, old))
    file = folder / "thing.npz"
    build = ["category", "build", "thing", mesh, "--out", file]
    found.append(Case("category build", build, file))
    old = _kept(zygote, [*build, "--scale", "2"], file, memory)
    found.append(Case("category build over a file", build, file, old))
    store = folder / "models.store"
    variable = {"MESHSLAM_MODELS": str(store)}
    found.append(Case("models add", ["models", "add", folder / "net.onnx"], store, environment=variable))
    return found


def _kept(zygote, command, target, memory):
    """The result of an older command, moved away."""
    code, _ = zygote.run(command, memory=memory)
    assert code == 0, zygote.said
    kept = target.with_name(f"{target.stem}_old{target.suffix}")
    return Path(shutil.move(target, kept))
