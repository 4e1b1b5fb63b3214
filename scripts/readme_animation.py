"""Draw the animation at the top of README: a street is simulated and mapped, and its report is played in Chromium.

.venv/bin/python scripts/readme_animation.py [OUT.webp]

Needs Chromium on the path. What one sees is the page as it is: its frame, and below it its 3-D view that follows.
"""

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "docs" / "assets" / "street.webp"
SEED, FRAMES, CARS = 8, 45, 8
WIDTH_PX, SCENE_PX, GAP_PX, RATE_HZ, QUALITY = 800, 320, 8, 10, 62
STYLE = (
    f"main {{ width: {WIDTH_PX}px !important; max-width: none !important; }} .pair {{ display: block !important; }}"
    f".stage {{ height: {SCENE_PX}px !important; aspect-ratio: auto !important; }}"
    f".stage canvas {{ height: {SCENE_PX}px !important; }}"
)


def mapped(folder: Path) -> Path:
    """The report of a street that was drawn and mapped."""
    command = [sys.executable, "-m", "meshslam"]
    drawn = ["simulate", folder / "street", "--seed", SEED, "--frames", FRAMES, "--cars", CARS]
    for words in (drawn, ["map", folder / "street", "--out", folder / "run"]):
        subprocess.run([*command, *map(str, words), "--quiet"], check=True)
    return folder / "run" / "report.html"


def picture(page: Page) -> Image.Image:
    """The frame above the 3-D view, as they are now."""
    parts = [Image.open(io.BytesIO(page.locator(name).screenshot())).convert("RGB") for name in ("#frame", ".stage")]
    whole = Image.new("RGB", (WIDTH_PX, sum(part.height for part in parts) + GAP_PX), "white")
    top = 0
    for part in parts:
        whole.paste(part.resize((WIDTH_PX, part.height)) if part.width != WIDTH_PX else part, (0, top))
        top += part.height + GAP_PX
    return whole


def played(report: Path) -> list[Image.Image]:
    """A picture a frame of the run."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport={"width": WIDTH_PX + 100, "height": 1400})
        page.goto(report.as_uri())
        page.wait_for_selector("html[data-ready]", state="attached")
        page.add_style_tag(content=STYLE)
        page.locator("#standpoint button[value=follow]").click()
        page.locator("#show-truth").uncheck()
        pictures = []
        for frame in range(int(page.locator("#slider").get_attribute("max") or 0) + 1):
            page.locator("#slider").evaluate(
                "(s, frame) => { s.value = frame; s.dispatchEvent(new Event('input', { bubbles: true })); }", frame
            )
            page.wait_for_timeout(700 if frame == 0 else 250)
            pictures.append(picture(page))
        browser.close()
    return pictures


def main() -> None:
    """Draw, and write."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else OUT
    with tempfile.TemporaryDirectory() as folder:
        first, *rest = played(mapped(Path(folder)))
    first.save(
        out,
        save_all=True,
        append_images=rest,
        duration=1000 // RATE_HZ,
        loop=0,
        quality=QUALITY,
        method=6,
        minimize_size=True,
    )
    sys.stdout.write(f"{out}: {len(rest) + 1} pictures, {out.stat().st_size / 1024:.0f} kB\n")


if __name__ == "__main__":
    main()
