"""`meshslam category`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

category_app = typer.Typer(help="Categories of objects: list them, build the shipped ones anew.", no_args_is_help=True)


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


@category_app.command("build-car")
def build_car_(
    out: Annotated[Path, typer.Option(help="File to write (.npz).")],
    seed: Annotated[int, typer.Option(help="Seed of the family's draws.")] = 0,
) -> None:
    """Build the category `car` from its procedural family: the same seed gives the same bytes.

    Example: meshslam category build-car --out car.npz
    """
    from meshslam.categories import save_category
    from meshslam.categories.build import build_car

    save_category(build_car(seed=seed), out)
    print(f"{out}: written")
