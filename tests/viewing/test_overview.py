from meshslam.viewing.overview import figure_rows, overview_page

RUNS = {"map": {"recall": 0.75, "mask_iou_shape": 0.9371, "unknown": 3.0}, "find <it>": {"ate_rmse_m": 0.021}}


def test_rows_are_the_figures_that_any_run_has_with_gaps_where_one_has_none():
    rows = dict(figure_rows(RUNS))
    assert rows["mask IoU, after shape"] == ["0.937", ""]
    assert rows["recall"] == ["0.750", ""]
    assert ["", "0.021"] in rows.values()
    assert len(rows) == 3


def test_the_page_links_every_report_and_holds_its_figures():
    pages = {"map": "map/report.html", "find <it>": "find/report.html"}
    page = overview_page("two & two", "why", RUNS, pages, [("seen <here>", "<svg class=plan></svg>")])
    assert "two &amp; two" in page
    assert "find &lt;it&gt;" in page
    assert all(f'href="{link}"' in page for link in pages.values())
    assert "<svg class=plan></svg><figcaption>seen &lt;here&gt;</figcaption>" in page
    assert "plan-data" in page
