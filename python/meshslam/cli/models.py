"""`meshslam models`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from meshslam.cli.options import Adapter

models_app = typer.Typer(help="Segmentation networks that runs find by name.", no_args_is_help=True)


@models_app.command("add")
def add(
    file: Annotated[Path, typer.Argument(help="ONNX export of YOLO-seg, RF-DETR-seg, Mask R-CNN or another.")],
    name: Annotated[str | None, typer.Option(help="Name in the store; the file's without it.")] = None,
    adapter: Adapter = None,
    licence: Annotated[str | None, typer.Option(help="Licence of the weights, where the file does not say.")] = None,
) -> None:
    """Put a network into the store.

    Example: meshslam models add yolov5n-seg.onnx
    """
    from meshslam.perception import add_model, load_segmenter

    found = load_segmenter(file, adapter=adapter)  # what fits no layout is refused here, not in a run
    model = add_model(file, name, licence, adapter)
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    print(f"{model.name}: {model.path}, {model.size / 1e6:.1f} MB, sha256 {model.sha256}")
    print(f"licence: {model.licence}")


@models_app.command("list")
def list_() -> None:
    """List the networks in the store, with checksum and licence.

    Example: meshslam models list
    """
    from meshslam.perception import ADVICE, store_folder, stored_models

    models = stored_models()
    for model in models:
        print(f"{model.name}: {model.size / 1e6:.1f} MB, sha256 {model.sha256[:16]}, licence: {model.licence}")
    if not models:
        print(f"there is no segmentation network in {store_folder()}: {ADVICE}")
