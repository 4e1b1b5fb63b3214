"""`meshslam category`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

category_app = typer.Typer(
    help="Categories of objects: list them, look at them, build them from meshes.", no_args_is_help=True
)
Axes = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
Planes = Literal["auto", "x", "y"]


@category_app.command("list")
def list_() -> None:
    """List the categories that are shipped.

    Example: meshslam category list
    """
    from meshslam.categories import category_names, load_category

    for name in category_names():
        category = load_category(name)
        length, width, height = category.dimensions
        size = f"{length:.2f} x {width:.2f} x {height:.2f} m"
        print(f"{name}: {len(category.vertices)} vertices, {len(category.modes)} modes, {size}")


@category_app.command("build")
def build_(
    name: Annotated[str, typer.Argument(help="What detections call the class.")],
    meshes: Annotated[
        list[Path] | None, typer.Argument(help="Mesh files; none: a shipped category anew, from its family.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File to write; NAME.npz if not given.")] = None,
    keypoints: Annotated[
        Path | None, typer.Option(help='JSON: {"mesh file\'s stem": {"key point": [x, y, z]}}.')
    ] = None,
    forward: Annotated[
        Axes, typer.Option(help="The files' axis that points ahead; x, and of glTF the longer one.")
    ] = "auto",
    up: Annotated[Axes, typer.Option(help="The files' axis that points up; z, and y of glTF.")] = "auto",
    scale: Annotated[float, typer.Option(help="The files' unit in metres.")] = 1.0,
    symmetry: Annotated[
        Planes, typer.Option(help="Normal of the vertical plane of symmetry, after forward and up; auto: find it.")
    ] = "auto",
    modes: Annotated[int, typer.Option(min=0, help="Principal modes, at most.")] = 20,
    size_sigma: Annotated[
        float | None, typer.Option(help="Relative sigma of sizes: 0.05 below 5 meshes, else 0.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of a family's draws.")] = 0,
) -> None:
    """Build a category from closed or open meshes: repaired, turned upright, wrapped, with modes.

    One mesh and no key points is enough. Without meshes, car, truck or bus is built from its procedural family. The
    same input gives the same bytes.

    Example: meshslam category build tram tram1.obj tram2.stl --out tram.npz
    """
    from meshslam.categories import save_category

    out = out or Path(f"{name}.npz")
    if out.suffix != ".npz":
        raise typer.BadParameter(f"{out}: a category file ends in .npz", param_hint="--out")
    if not meshes:
        from meshslam.categories import build_family

        category = build_family(name, seed=seed)
    else:
        from meshslam.categories import MeshOptions, category_from_meshes

        options = MeshOptions(forward, up, scale, symmetry, modes, size_sigma)
        category, notes = category_from_meshes(name, meshes, keypoints, options)
        for note in notes:
            print(f"note: {note}")
    save_category(category, out)
    length, width, height = category.dimensions
    print(f"{out}: {len(category.modes)} modes, {length:.2f} x {width:.2f} x {height:.2f} m")


@category_app.command("show")
def show(
    name: Annotated[str, typer.Argument(help="A shipped category, or a category file.")],
    out: Annotated[Path | None, typer.Option(help="Picture (.png) or page (.html); NAME.html if not given.")] = None,
) -> None:
    """Draw a category's mean and modes.

    Example: meshslam category show car --out car.png
    """
    from meshslam.categories import load_category
    from meshslam.errors import CategoryError
    from meshslam.files import remove_leftovers_of, write_atomically
    from meshslam.viewing import category_page, category_png

    category = load_category(name)
    out = out or Path(f"{category.name}.html")
    if out.suffix not in (".png", ".html"):
        raise typer.BadParameter(f"{out}: .png or .html", param_hint="--out")
    picture = out.suffix == ".png"
    content = category_png(category) if picture else category_page(category).encode()
    remove_leftovers_of(out)
    write_atomically(out, content, CategoryError)
    print(f"{out}: open it to see the mean and {len(category.modes)} modes")
