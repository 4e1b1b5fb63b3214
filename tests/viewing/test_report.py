import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.maps import Map
from meshslam.viewing import TrueObject, write_report

VOID = {"meta", "link", "input", "img", "br", "hr"}
NAMESPACES = ("http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink")


class Page(HTMLParser):
    """Collects elements, and fails on ends that do not match their starts."""

    def __init__(self, content):
        super().__init__(convert_charrefs=True)
        self.open, self.elements, self.texts = [], [], []
        self.feed(content)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> ends nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self.open[-1] if self.open else "", data))

    def text(self):
        return " ".join(t for where, t in self.texts if where not in ("script", "style"))

    def numbered(self, css_class):
        return [int(a["data-id"]) for _, a in self.elements if a.get("class") == css_class]


@pytest.fixture
def page(context):
    return write_report(context)


def test_everything_is_inside(page):
    for namespace in NAMESPACES:
        page = page.replace(namespace, "")
    assert not re.search(r"https?:|//[a-z0-9-]+\.[a-z]|@import|url\((?!data:)", page)
    for tag, attributes in Page(page).elements:
        assert tag not in ("link", "iframe", "base")
        for name in ("src", "href", "srcset", "xlink:href"):
            assert attributes.get(name, "data:").startswith("data:")


def test_is_well_formed_and_names_every_object_once_a_list(page, cars):
    parsed, ids = Page(page), [thing.id for thing in cars.objects]
    assert parsed.open == []
    assert parsed.numbered("chip") == 2 * ids  # the table, the bars of mask IoU
    assert parsed.numbered("thumb") == ids
    scene = next(t for where, t in parsed.texts if where == "script" and t.startswith("{"))
    assert [thing["id"] for thing in json.loads(scene)["scene"]["objects"]] == ids


def test_text_is_never_markup(page):
    assert "a &lt;street&gt; &amp; more" in page
    assert "<street>" not in page
    assert "<fast>" not in page


def test_shows_figures_and_what_is_left_out(page):
    text = re.sub(r"\s+", " ", Page(page).text())
    assert "after shape 0.875" in text
    assert "total 12.5 s" in text
    assert "odd new figure 1.250 m" in text
    assert "path error, RMSE \u2013 m" in text
    assert "moves its views agree with 3.6 m/s" in text


def test_shows_what_the_run_told_its_user(context, page):
    assert "<h2>Notes" not in page
    told = write_report(replace(context, notes=("3 steps corrected",)))
    assert re.search(r"<h2>Notes</h2>\s*<ul><li>3 steps corrected</li></ul>", told)


def test_the_same_run_gives_the_same_page(context, page):
    assert write_report(replace(context)) == page


def test_without_images_stages_or_objects(context):
    bare = replace(context, read_image=None, stages=None, left_out=(), metrics={})
    assert "class=image>" in write_report(context)
    assert "class=image>" not in write_report(bare)
    assert "<h2>Left out" not in write_report(bare)
    empty = replace(bare, map=Map(()), detections=replace(bare.detections, detections=()))
    assert Page(write_report(empty)).open == []
    nothing = replace(empty, frame_ids=(), world_from_camera=(), times_s=np.zeros(0))
    assert Page(write_report(nothing)).open == []


def test_every_frame_is_in_the_page(context):
    assert write_report(context).count("class=image>") == len(context.frame_ids)
    assert write_report(replace(context, frames_in_report=4)).count("class=image>") == 4


def test_truth_is_shown_beside_the_estimate(context, make_car):
    near, far = make_car(50, 12.1, 3.0), make_car(51, 60.0, 0.0)
    shape = [(t.world_from_object, t.vertices, t.faces) for t in (near, far)]
    true = (TrueObject(50, *shape[0], 3, 0.1, 0.5, 0.9), TrueObject(51, *shape[1]))
    errors = np.column_stack([np.linspace(0, 1, 11), np.full(11, np.nan)])
    page = write_report(replace(context, true_objects=true, path_errors={"estimate": errors}))
    data = json.loads(next(t for where, t in Page(page).texts if where == "script" and t.startswith("{")))
    assert [wire["estimate"] for wire in data["scene"]["truth"]] == [3, None]
    assert data["scene"]["objects"][0]["error"] == {"centre": 0.1, "yaw": 0.5, "voxel_iou": 0.9}
    assert data["series"]["errors"][0]["position"][-1] == 1.0
    assert data["series"]["errors"][0]["rotation"] == [None] * 11


def test_needs_a_pose_a_frame(context):
    with pytest.raises(GeometryError, match="one pose a frame"):
        replace(context, frame_ids=context.frame_ids[:-1])


def test_what_drives_has_a_row_and_its_way_in_the_data(context, make_moving):
    moving = make_moving(40, 15.0, 1.0)
    page = write_report(replace(context, map=Map(context.map.objects, (moving,))))
    [row] = re.findall(r"<table class=\"moving\">.*?</table>", page, re.DOTALL)
    assert "5.0&ndash;5.0" in row
    assert "2&ndash;7" in row
    data = json.loads(re.search(r'id="run">(.*?)</script>', page, re.DOTALL).group(1))
    [entry] = data["moving"]
    assert entry["frames"] == [2, 3, 4, 5, 6, 7]
    poses = np.frombuffer(base64.b64decode(entry["poses"]), np.float32).reshape(-1, 12)
    origin = np.array(data["scene"]["origin"])
    np.testing.assert_allclose(poses[:, 3::4] + origin, moving.path.positions_in_world, atol=1e-4)
    assert entry["id"] not in {thing["id"] for thing in data["scene"]["objects"]}
    assert 'class="moving"' not in write_report(context)
