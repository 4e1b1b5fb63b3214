#!/usr/bin/env bash
# datumaro 1.13.12 writes COCO files whose annotation ids repeat, and pycocotools then loses annotations.
#
# A datumaro annotation has an id. Labels that were read from per-image sources (one file an image) are numbered within
# each image, so ids such as 1 come again in the next image. The COCO export keeps them: three images with one mask each
# give a file with three annotations, all of id 1. COCO's ids are meant to be unique over the file, and pycocotools
# 2.0.11 indexes by them: of the three annotations COCO(file).anns holds one, and for the other images loadAnns returns
# the last image's annotation. Neither library says a word. Without ids (id=0) datumaro numbers them itself, rightly.
# The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "datumaro==1.13.12" "pycocotools==2.0.11"
cat > "$work/see.py" <<'PY'
import contextlib
import io
import json
import sys
import warnings
from importlib.metadata import version
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")  # of imports
from datumaro import Dataset, DatasetItem
from datumaro.components.annotation import Mask
from datumaro.components.media import Image
from pycocotools.coco import COCO


def exported(folder, id_):
    shape = np.zeros((20, 30), bool)
    shape[2:8, 3:9] = True
    blank = np.zeros((20, 30, 3), np.uint8)
    items = [
        DatasetItem(
            id=f"frame{n}",
            subset="train",
            media=Image.from_numpy(blank),
            annotations=[Mask(np.roll(shape, 5 * n, axis=1), label=0, id=id_, group=id_)],
        )
        for n in range(3)
    ]
    Dataset.from_iterable(items, categories=["car"]).export(str(folder), "coco_instances")
    return next(Path(folder).rglob("instances*.json"))


folder = Path(sys.argv[1])
own = exported(folder / "own", 1)
rows = json.loads(own.read_text())["annotations"]
with contextlib.redirect_stdout(io.StringIO()):
    coco = COCO(str(own))
    given = COCO(str(exported(folder / "none", 0)))
found = {
    "annotations in the file (id, image)": [(row["id"], row["image_id"]) for row in rows],
    "annotations that pycocotools has": len(coco.anns),
    "image of the annotation loaded for image 1": coco.loadAnns(coco.getAnnIds(imgIds=[1]))[0]["image_id"],
    "annotations without ids that pycocotools has": len(given.anns),
}
print("datumaro", version("datumaro"), "pycocotools", version("pycocotools"))
for what, value in found.items():
    print(f"{what}: {value}")
expected = [[(1, 1), (1, 2), (1, 3)], 1, 3, 3]
sys.exit(0 if list(found.values()) == expected else 1)
PY
"$work/venv/bin/python" "$work/see.py" "$work"
