"""The report in a real browser."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from meshslam.geometry import Pose
from meshslam.viewing import FleetRow, TrueObject, fleet_page, overview_page, write_report
from tests.viewing.browser import launched, missing, opened

NARROW_PX = 390
CONTRAST, CROPPED = (Path(__file__).with_name(f"{name}.js").read_text() for name in ("contrast", "cropped"))


@pytest.fixture(scope="module")
def playwright():
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed: make setup")
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(playwright):
    started = launched(playwright)
    yield started
    started.close()


@pytest.fixture
def full(context, make_car):
    """A run with all that a report can show."""
    image = cv2.GaussianBlur(context.read_image(0), (0, 0), 7)
    true = [
        make_car(50 + i, *thing.world_from_object.translation[:2] + 0.1) for i, thing in enumerate(context.map.objects)
    ]
    doubtful = make_car(20, 30.0, -2.0, views=1, mask_iou=0.6)
    count = len(context.frame_ids)
    shape = ((t.world_from_object, t.vertices, t.faces) for t in true)
    errors = np.column_stack([np.linspace(0, 0.3, count), np.linspace(0, 0.4, count)])
    aside = Pose(np.eye(3), np.array([0.0, 0.4, 0.0]))
    return replace(
        context,
        map=type(context.map)((*context.map.objects, doubtful)),
        read_image=lambda index: np.roll(image, 9 * index, axis=1),
        covariances=np.tile(np.diag([0.05, 0.05, 0.05, 0.002, 0.002, 0.002]) ** 2, (count, 1, 1)),
        other_paths={
            "IMU alone": tuple(aside @ p for p in context.world_from_camera),
            "truth": context.world_from_camera,
        },
        true_objects=tuple(
            TrueObject(t.id, *s, thing.id, 0.14, 0.5, 0.9)
            for t, s, thing in zip(true, shape, context.map.objects, strict=True)
        ),
        path_errors={"estimate": errors, "IMU alone": 3 * errors},
        metrics={
            **context.metrics,
            "seconds_mapping": 3.0,
            "ate_iteration_00_rmse_m": 0.5,
            "ate_iteration_01_rmse_m": 0.3,
        },
    )


@pytest.fixture
def report(full, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(write_report(full))
    return file


@pytest.fixture
def page(browser, report):
    page = opened(browser, report)
    yield page
    page.wait_for_timeout(100)
    page.context.close()
    assert page.faults == []


def frame_of(page):
    return int(re.search(r"frame (\d+)", page.locator("#now").inner_text()).group(1))


def chosen(page):
    """What every place says is selected."""
    return {
        "panel": page.locator("#car-title").inner_text(),
        "table": page.locator("table.objects tr.chosen .chip").all_inner_texts(),
        "bars": page.locator(".ious li.chosen .chip").all_inner_texts(),
        "map": [e.get_attribute("data-id") for e in page.locator(".plan .car.chosen").all()],
        "scene": page.locator("#names .chosen").all_inner_texts(),
        "player": page.locator("#selected").inner_text().split("\n")[0].strip(" ✕"),
    }


def settles(page, expected):
    """Wait until every place says what is expected: pictures are drawn with the browser's next ones."""
    for _ in range(60):
        if chosen(page) == expected:
            return
        page.wait_for_timeout(50)
    assert chosen(page) == expected


def all_say(number):
    one = [str(number)]
    return {"panel": f"car {number}", "table": one, "bars": one, "map": one, "scene": one, "player": f"car {number}"}


def where(page):
    """Where each view is in time."""
    page.wait_for_selector(f"#frame[data-frame='{frame_of(page)}']")
    return (
        frame_of(page),
        page.locator("#frame").get_attribute("data-frame"),
        page.locator(".plan .here").get_attribute("transform"),
        page.locator(".chart .cursor").first.get_attribute("x1"),
        page.locator("#slider").input_value(),
    )


def test_the_slider_moves_every_view(page):
    before = where(page)
    page.locator("#slider").fill("6")
    after = where(page)
    assert after[0] == 6
    assert after[1] == after[4] == "6"
    assert all(a != b for a, b in zip(before, after, strict=True))


def test_keys_move_every_view(page):
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert where(page)[1] == "2"
    page.keyboard.press("ArrowLeft")
    assert frame_of(page) == 1
    page.keyboard.press("End")
    assert frame_of(page) == 10
    page.keyboard.press("Home")
    assert frame_of(page) == 0
    page.locator("#slider").focus()
    page.keyboard.press("ArrowRight")
    assert where(page)[1] == "1"


def test_playing_moves_on_and_ends(page):
    page.locator("#speed").select_option("5")
    page.locator("#play").click()
    page.wait_for_selector("#frame[data-frame='10']", timeout=8000)
    page.wait_for_selector("#play[aria-label=play]")
    page.locator("#speed").select_option("0.5")
    page.locator("#play").focus()
    page.keyboard.press("Space")  # again, from the first
    page.wait_for_selector("#play[aria-label=pause]")
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=play]")


def test_an_object_that_is_chosen_anywhere_is_chosen_everywhere(page):
    page.locator("table.objects .chip", has_text="7").click()
    settles(page, all_say(7))
    page.locator(".ious .chip", has_text="12").click()
    settles(page, all_say(12))
    page.locator(".plan .car[data-id='3'] polygon").click()
    settles(page, all_say(3))
    page.locator("#in-frame .chip", has_text="7").click()
    settles(page, all_say(7))
    page.keyboard.press("Escape")
    assert chosen(page)["table"] == []
    page.keyboard.press("j")
    settles(page, all_say(3))
    page.keyboard.press("k")
    settles(page, all_say(20))


def test_an_object_is_chosen_in_its_frame(page, full):
    detection = next(d for d in full.found_at(0) if d.track_id == 7)
    rows, columns = np.nonzero(detection.mask())
    middle = len(rows) // 2
    box = page.locator("#frame").bounding_box()
    scale = box["width"] / full.camera.width
    page.locator("#frame").click(position={"x": scale * (columns[middle] + 0.5), "y": scale * (rows[middle] + 0.5)})
    settles(page, all_say(7))


def test_the_3d_view_flies_to_the_object_where_it_can_be_clicked(page):
    page.locator("table.objects .chip", has_text="7").click()
    page.wait_for_timeout(1200)
    page.keyboard.press("Escape")
    page.locator("#view").scroll_into_view_if_needed()
    box = page.locator("#view").bounding_box()
    page.locator("#view").click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    settles(page, all_say(7))
    page.locator("#names button", has_text="7").first.click()
    settles(page, all_say(7))


def test_the_chosen_object_is_shown_with_its_views_and_doubts(page):
    page.locator("table.objects .chip", has_text="7").click()
    views = page.locator("#car .views button")
    assert views.count() > 3
    assert page.locator("#car .compared canvas").count() == 2
    assert "centre to truth" in page.locator("#car .facts").inner_text()
    page.wait_for_timeout(300)
    assert drawn_colours(page, "#car .views canvas") > 20
    views.nth(2).click()
    assert where(page)[1] == views.nth(2).get_attribute("data-frame")
    page.locator("table.objects .chip", has_text="20").click()
    assert "one view shows it" in page.locator("#car .doubt").inner_text()


def drawn_colours(page, selector):
    """How many colours a canvas shows."""
    return page.locator(selector).first.evaluate(
        """canvas => {
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          return new Set(new Uint32Array(data.buffer)).size;
        }"""
    )


def test_every_colouring_has_its_key(page):
    page.wait_for_timeout(200)
    seen = set()
    for name, words in (
        ("sigma", "of a vertex"),
        ("seen", "prior"),
        ("error", "centre to the true one"),
        ("id", ""),
    ):
        page.locator(f"#colouring button[value={name}]").click()
        page.wait_for_timeout(150)
        assert words in page.locator("#scene-legend").inner_text()
        seen.add(page.locator(".plan .car[data-id='3'] polygon").get_attribute("fill"))
    assert len(seen) == 4


def test_charts_lead_to_their_frame_and_have_bands(page):
    charts = page.locator(".chart svg")
    assert charts.count() == 5  # error and sigma of position and rotation, iterations
    assert page.locator(".chart .band").count() == 2
    charts.first.scroll_into_view_if_needed()
    box = charts.first.bounding_box()
    charts.first.click(position={"x": box["width"] - 9, "y": 60})
    assert frame_of(page) == 10


def test_thin_paths_lie_over_the_estimate(page):
    widths = [float(e.get_attribute("stroke-width")) for e in page.locator(".plan .path").all()]
    assert widths == sorted(widths, reverse=True)
    assert widths[0] > 2 * widths[-1]
    words = page.locator("#map-legend").inner_text()
    for name in ("estimated path", "true path", "IMU alone", "start", "end", "footprint", "position", "doubtful"):
        assert name in words


def test_left_out_tracks_say_why(page):
    assert "moves" in page.locator("#left-out").inner_text()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_can_be_read(browser, report, scheme):
    page = opened(browser, report, color_scheme=scheme)
    page.locator("table.objects .chip", has_text="20").click()
    page.wait_for_timeout(200)
    assert page.evaluate(CONTRAST) == []
    page.context.close()


def test_dark_mode_follows_the_system(page):
    light = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(200)
    assert page.evaluate("() => getComputedStyle(document.body).backgroundColor") != light


@pytest.mark.parametrize("images", [True, False])
def test_on_a_phone_nothing_is_beside_the_page(browser, full, tmp_path, images):
    file = tmp_path / "report.html"
    file.write_text(write_report(full if images else replace(full, read_image=None)))
    page = opened(browser, file, width=NARROW_PX, height=844, has_touch=True, is_mobile=True)
    page.locator("table.objects .chip", has_text="7").tap()
    page.wait_for_timeout(200)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= NARROW_PX
    assert page.evaluate(CROPPED) == []
    assert chosen(page)["panel"] == "car 7"
    assert page.faults == []
    page.context.close()


@pytest.mark.parametrize("width", [NARROW_PX, 1400])
def test_the_page_over_several_runs_fits(browser, full, tmp_path, width):
    figures = {
        name: {"recall": 1.0, "ate_rmse_m": 0.01, "voxel_iou_category_model": 0.7}
        for name in ("map", "localize", "slam")
    }
    pages = {name: f"{name}/report.html" for name in figures}
    plan = ("from above", replace(full, other_paths={"first drive": full.world_from_camera}))
    file = tmp_path / "report.html"
    file.write_text(overview_page("demo", "why", figures, pages, plan=plan))
    page = opened(browser, file, width=width, height=844)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    assert page.evaluate(CROPPED) == []
    assert page.evaluate(CONTRAST) == []
    assert "first drive" in page.locator("#map-legend").inner_text()
    assert page.locator(".plan .car").count() == len(full.map)
    assert page.faults == []
    page.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [NARROW_PX, 1400])
def test_the_page_of_a_fleet_fits_and_can_be_read(browser, tmp_path, width, scheme):
    long, folder = "2011_09_26_drive_0048_" + 30 * "x", "/data/" + 90 * "d"
    bad = FleetRow(
        long, "failed", 60 * "a reason ", "map", folder, None, None, None, 3.0, None, 3, "one/12345678", ("a note",)
    )
    good = FleetRow(
        "good", "done", "", "slam", folder, "runs/good/report.html", 7.0, 600.0, 61.5, 1234.0, 1, "two/12345678"
    )
    there = replace(good, name="there", how="unchanged")
    file = tmp_path / "fleet.html"
    file.write_text(fleet_page("may", [bad, replace(bad, how="not run"), good, there], ("summary.csv",)))
    page = browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme).new_page()
    page.goto(f"file://{file}")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    assert page.evaluate(CROPPED) == []
    assert page.evaluate(CONTRAST) == []
    assert page.locator("table.fleet a").all_inner_texts() == ["good", "there"]
    page.context.close()


def test_on_paper_there_are_no_buttons_and_nothing_is_cut(page):
    page.emulate_media(media="print", color_scheme="dark")
    assert page.locator("#player").is_hidden()
    assert page.evaluate("() => getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 1400
    assert page.pdf(format="A4").startswith(b"%PDF")


def test_without_webgl_all_else_works(playwright, report):
    browser = launched(playwright, "--disable-3d-apis")
    page = opened(browser, report)
    assert page.locator("#no-webgl").is_visible()
    page.keyboard.press("ArrowRight")
    page.locator("table.objects .chip", has_text="7").click()
    assert where(page)[1] == "1"
    settles(page, all_say(7) | {"scene": []})
    browser.close()


def test_a_run_without_objects_or_frames_opens(browser, full, tmp_path):
    for count in (0, 1):
        nothing = replace(
            full,
            map=type(full.map)(()),
            true_objects=(),
            detections=replace(full.detections, detections=()),
            frame_ids=full.frame_ids[:count],
            world_from_camera=full.world_from_camera[:count],
            times_s=full.times_s[:count],
            covariances=None,
            path_errors={},
            other_paths={},
        )
        file = tmp_path / f"{count}.html"
        file.write_text(write_report(nothing))
        page = opened(browser, file)
        page.wait_for_timeout(100)
        assert page.faults == []
        page.context.close()


def test_what_drives_is_drawn_where_it_is_in_each_frame(browser, full, make_moving, tmp_path):
    moving = make_moving(40, 15.0, 1.0, first=2, count=6)
    file = tmp_path / "driving.html"
    file.write_text(write_report(replace(full, map=type(full.map)(full.map.objects, (moving,)))))
    page = opened(browser, file)
    assert page.locator(".plan .way").count() == 1
    places = []
    for frame in range(len(full.frame_ids)):
        page.locator("#slider").fill(str(frame))
        page.wait_for_selector(f"#frame[data-frame='{frame}']")
        shown = page.locator(".plan .driving [data-moving='40'] polygon")
        assert shown.count() == (1 if frame in moving.path.frame_ids else 0)
        if shown.count():
            places.append(shown.get_attribute("points"))
    assert len(set(places)) == len(moving.path)
    assert "5.0" in page.locator("table.moving").inner_text()
    page.context.close()
    assert page.faults == []
