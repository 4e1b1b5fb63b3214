import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from meshslam.errors import GeometryError
from meshslam.maps import Map
from meshslam.viewing import ReportContext, write_report
from meshslam.viewing.filmstrip import choose_frames

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
    assert parsed.numbered("chip") == ids
    assert parsed.numbered("car") == ids
    scene = next(t for where, t in parsed.texts if where == "script" and t.startswith("{"))
    assert [thing["id"] for thing in json.loads(scene)["objects"]] == ids


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


def test_the_same_run_gives_the_same_page(context, page):
    assert write_report(replace(context)) == page


def test_without_images_stages_or_objects(context, cars):
    bare = replace(context, read_image=None, stages=None, left_out=(), metrics={})
    assert "data:image/jpeg" in write_report(bare)  # thumbnails
    assert "Category mean" not in write_report(bare)
    empty = replace(bare, map=Map(()), detections=replace(bare.detections, detections=()))
    assert Page(write_report(empty)).open == []
    nothing = replace(empty, frame_ids=(), world_from_camera=())
    assert Page(write_report(nothing)).open == []


def test_needs_a_pose_a_frame(context):
    with pytest.raises(GeometryError, match="one pose a frame"):
        replace(context, frame_ids=context.frame_ids[:-1])


@pytest.mark.parametrize("count", [1, 2, 5, 8, 40])
def test_chosen_frames_are_spread_and_show_most(context, count):
    chosen = choose_frames(context, count)
    parts = np.array_split(np.arange(len(context.frame_ids)), min(count, len(context.frame_ids)))
    assert len(chosen) == len(parts)
    for index, part in zip(chosen, parts, strict=True):
        assert index in part
        assert _shown(context, index) == max(_shown(context, i) for i in part)


def test_reads_only_the_frames_it_shows(context):
    read = []
    write_report(replace(context, read_image=lambda i: read.append(i) or context.read_image(i), stages=None))
    assert sorted(read) == choose_frames(context)


def _shown(context: ReportContext, index: int) -> float:
    ids = {thing.id for thing in context.map.objects}
    return sum(d.bbox[2] * d.bbox[3] for d in context.found_at(index) if d.track_id in ids)
