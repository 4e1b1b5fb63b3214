#!/usr/bin/env bash
# Rerun 0.41.0: the viewer leaves out an AnnotationContext that is logged on a timeline, when it opens the file.
#
# A mask (SegmentationImage) has class 1 where it shows something, and 0 elsewhere. Its context says that class 1 is
# green and class 0 is transparent. Two files differ in nothing but how the context is logged:
#   static    log("image", context, static=True): the mask is green, as it should be
#   timeline  log("image", context) at each frame: the mask is blue and everything else is tinted red, the colours that
#             the viewer chooses where it knows no context; nothing is said
# The docs do not ask for a static context, and the file holds it: rerun.chunk.RrdReader gives a row of it for each frame.
# The pictures are those of the headless viewer. It needs a Vulkan adapter; Mesa's software one will do
# (Debian: mesa-vulkan-drivers). The script fails if any of this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "rerun-sdk==0.41.0" "pillow==13.0.0"
cat > "$work/see.py" <<'PY'
import os
import socket
import sys
import time
from pathlib import Path

import numpy as np
import rerun as rr
import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

work = Path(sys.argv[1])
os.environ.setdefault("XDG_RUNTIME_DIR", str(work))
PROGRAM = str(Path(rerun_cli.__file__).with_name("rerun"))
FRAMES = 4


def write(path, *, static):
    rr.set_strict_mode(True)
    stream = rr.RecordingStream("finding")
    stream.save(path)
    mask = np.zeros((60, 80), np.uint8)
    mask[10:40, 10:60] = 1
    context = rr.AnnotationContext(
        [rr.AnnotationInfo(0, "nothing", (0, 0, 0, 0)), rr.AnnotationInfo(1, "car", (0, 255, 0, 255))]
    )
    for frame in range(FRAMES):
        stream.set_time("frame", sequence=frame)
        stream.log("image", rr.Image(np.full((60, 80, 3), 200, np.uint8)))
        stream.log("image", context, static=static)
        stream.log("image/mask", rr.SegmentationImage(mask))
    stream.disconnect()


def seen(path, picture):
    """How many pixels of the viewer's window are green, blue and reddish."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    viewer = ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, executable_path=PROGRAM)
    try:
        viewer.open([str(path)])
        time.sleep(2)
        viewer.set_location(viewer.get_state().recordings[0].location)
        time.sleep(2)
        viewer.set_time("frame", sequence=2, play_state="paused")
        time.sleep(4)
        viewer.save_screenshot(str(picture))
    finally:
        viewer.quit()
    r, g, b = np.asarray(Image.open(picture).convert("RGB")).astype(int).transpose(2, 0, 1)
    height, width = r.shape
    inside = (slice(height // 10, height * 7 // 10), slice(width // 8, width * 5 // 6))  # less the panels
    r, g, b = r[inside], g[inside], b[inside]
    green, blue = (g > r + 40) & (g > b + 40), (b > r + 20) & (b > g + 15)
    red = (r > g + 20) & (r > b + 20) & (r > 150)
    return [int(kind.sum()) for kind in (green, blue, red)]


found = {}
for name in ("static", "timeline"):
    write(work / f"{name}.rrd", static=name == "static")
    found[name] = seen(work / f"{name}.rrd", work / f"{name}.png")
    print(f"{name}: {found[name][0]} pixels green, {found[name][1]} blue, {found[name][2]} reddish")
assert found["static"][0] > 10_000 and max(found["static"][1:]) < 1_000, "the static context is not followed"
assert found["timeline"][0] < 1_000 < 10_000 < min(found["timeline"][1:]), "the context on a timeline is followed now"
PY
"$work/venv/bin/python" "$work/see.py" "$work" 2> "$work/log" || { cat "$work/log" >&2; exit 1; }
# Output of rerun-sdk 0.41.0, Python 3.11, Mesa 22.3.6 llvmpipe (the counts depend on the window's size):
# static: 243334 pixels green, 0 blue, 0 reddish
# timeline: 0 pixels green, 243334 blue, 416330 reddish
