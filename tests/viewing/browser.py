"""Pages in a real browser, by Playwright and the machine's own Chromium."""

import os
import shutil

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DRIVER = "GL Driver Message"  # of a GPU that is software: it is slow
ARGUMENTS = ("--no-sandbox", "--enable-unsafe-swiftshader")  # WebGL without a GPU


def missing(reason):
    """Skip the test; a failure where everything must be there."""
    if os.environ.get("MESHSLAM_REQUIRE_DATA") == "1":
        pytest.fail(reason)
    pytest.skip(reason)


def found_browser():
    """Chromium's path."""
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    return missing("no Chromium on the path: apt-get install chromium")


def launched(playwright, *more):
    """A browser without a window."""
    return playwright.chromium.launch(executable_path=found_browser(), args=[*ARGUMENTS, *more])


def opened(browser, path, *, width=1400, height=900, **options):
    """A page from disk, once it is drawn; what it asks for elsewhere and what it complains of are in its `faults`."""
    page = browser.new_context(viewport={"width": width, "height": height}, **options).new_page()
    faults = page.faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on(
        "console", lambda m: faults.append(m.text) if m.type in ("error", "warning") and DRIVER not in m.text else None
    )
    page.on(
        "request",
        lambda r: faults.append(r.url) if not r.url.startswith(("data:", "blob:", f"file://{path}")) else None,
    )
    page.goto(f"file://{path}")
    page.wait_for_selector("html[data-ready]", state="attached")
    return page
