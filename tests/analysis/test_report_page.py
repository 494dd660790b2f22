"""The written report: whole in itself, everything there, no number that the data does not have."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from bscd.analysis.report import write_report
from bscd.analysis.validation import ErrorFigure
from tests.analysis.exact_report import report_data

FIGURES = {
    "error_map_pos0",
    "distortion_maps",
    "error_volume",
    "error_depth_thirds",
    "residuals",
    "sigma_calibration",
}
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Checks nesting, collects ids, references and the text of table cells and of everything."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.references, self.tables, self.words = [], [], [], {}, []
        self.table = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag not in VOID:
            self.open.append(tag)
        self._note(tag, given)

    def handle_startendtag(self, tag, attributes):
        self._note(tag, dict(attributes))

    def _note(self, tag, given):
        if "id" in given:
            self.ids.append(given["id"])
        for name, value in given.items():
            if name in ("src", "href", "xlink:href", "action", "data", "poster"):
                self.references.append(value)
            self.references += re.findall(r"url\(([^)]*)\)", value or "")
        if tag == "table":
            self.table = self.tables.setdefault(given["id"], [])
        elif tag == "tr" and self.table is not None:
            self.table.append([])
        elif tag in ("td", "th") and self.table is not None:
            self.table[-1].append("")

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag
        if tag == "table":
            self.table = None

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)
        if self.table and self.table[-1] and self.open[-1] in ("td", "th"):
            self.table[-1][-1] += data.replace("\u00a0", " ").replace("\u2212", "-")


@pytest.fixture(scope="module")
def data():
    return report_data()


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "made"
    assert write_report(data, folder) == folder / "report.html"
    return folder


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def pair(cell):
    mean, std = cell.split(" ± ")
    return float(mean), float(std), 0.5000001 * 10.0 ** -len(mean.split(".")[1])


def assert_same(cell, figure):
    mean, std, rounding = pair(cell)
    assert abs(mean - figure.mean_mm) <= rounding
    assert abs(std - figure.std_mm) <= rounding


def test_it_is_well_formed_and_ids_are_unique(page):
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))


def test_it_refers_to_nothing_outside_itself(text, page):
    assert not re.search(r"https?:", text)
    assert "<script" not in text
    assert "@import" not in text
    for reference in page.references:
        assert reference.startswith(("#", "data:image/")), reference
    ids = set(page.ids)
    assert {r[1:] for r in page.references if r.startswith("#")} <= ids


def test_it_is_small_enough_to_mail(folder):
    assert (folder / "report.html").stat().st_size < 6e6


def test_every_figure_is_in_the_page_and_beside_it(folder, text, page):
    assert {f"figure-{name}" for name in FIGURES} <= set(page.ids)
    assert text.count("<svg") == len(FIGURES)
    for name in FIGURES:
        image = cv2.imread(str(folder / "figures" / f"{name}.png"))
        assert image is not None
        assert min(image.shape[:2]) > 300
        assert image.std() > 5.0  # not empty


def test_not_a_number_is_never_printed(page):
    assert not re.search(r"\b(nan|inf|none)\b", " ".join(page.words), re.IGNORECASE)


def test_the_figures_are_those_of_the_data(data, page):
    head, *rows = page.tables["table-figures"]
    assert head[1] == "this rig (mm)"
    truth = [np.linalg.norm(v.corrected_mm - v.truth_mm, axis=1)[v.inside] for v in (data.pos0, data.volume)]
    expected = [
        data.standard_stereo,
        *(
            ErrorFigure.of(np.linalg.norm(points - v.expected_mm, axis=1)[v.inside])
            for v in (data.pos0, data.volume)
            for points in (v.uncorrected_mm, v.corrected_mm)
        ),
    ]
    for row, figure in zip(rows, expected, strict=False):
        assert_same(row[1], figure)
        assert int(row[2]) == figure.count
    assert [row[3] for row in rows[:3]] == ["0.021 ± 0.032", "0.17 ± 0.10", "0.09 ± 0.05"]
    assert_same(rows[5][1], ErrorFigure.of(truth[0]))
    assert_same(rows[7][1], ErrorFigure.of(truth[1]))
    assert {row[4] for row in rows[:5]} == {""}
    assert {row[4] for row in rows[5:]} == {"twin"}


def test_all_variants_are_there_and_the_used_one_is_marked(data, page, text):
    rows = page.tables["table-variants"][1:]
    assert len(rows) == 4
    for row, variant in zip(rows, data.variants.values(), strict=True):
        assert_same(row[2], variant.figure())
    table = text[text.index('id="table-variants"') :]
    marked = re.search(r'<tr class="marked">(.*?)</tr>', table, re.DOTALL)[1]
    assert "projection" in marked
    assert "smooth" in marked


def test_the_calibrations_own_figures_are_listed_with_units(data, page):
    cells = {row[0]: row[1] for row in page.tables["table-calibration-residuals"][1:]}
    named = cells["Distortion maps, rms per axis"]
    assert named.endswith(" px")
    assert float(named.split()[0]) == pytest.approx(data.calibration.figures["map_residual_rms_px"], rel=0.006)
    assert cells["Control points"] == f"{len(data.calibration.control.index)}"


def test_the_worst_dots_are_sorted(data, page):
    errors = [float(row[3]) for row in page.tables["table-worst"][1:]]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] == pytest.approx(np.nanmax(data.volume.error_mm()), rel=0.006)


def test_warnings_configuration_and_origins_are_shown_as_they_are(data, page):
    words = " ".join(page.words)
    assert data.warnings[0] in words
    assert data.config_text.strip() in words
    for run in data.runs:
        assert [run.name, run.uuid, run.checksum] in page.tables["table-runs"]
    assert data.calibration.checksum in words


def test_a_real_rig_knows_no_truth_and_says_nothing_of_it(data, tmp_path):
    def blind(validation):
        return replace(validation, truth_mm=None, floor_mm=None)

    real = replace(
        data,
        pos0=blind(data.pos0),
        volume=blind(data.volume),
        reference_views=(),
        examples={},
        warnings=(),
        summary={"volume": {"corrected": float("nan")}},
    )
    text = write_report(real, tmp_path).read_text()
    page = Page(text)
    assert "twin" not in " ".join(page.words)
    assert "No warnings." in page.words
    assert len(page.tables["table-figures"]) == 6
    shown = re.search(r'<details id="summary">.*?<pre>(.*?)</pre>', text, re.DOTALL)[1]
    assert json.loads(shown.replace("&#34;", '"')) == {"volume": {"corrected": None}}


def test_a_second_acquisition_outside_the_hull_is_still_reported(data, tmp_path):
    def outside(validation):
        nothing = np.full_like(validation.corrected_mm, np.nan)
        return replace(
            validation,
            inside=np.zeros_like(validation.inside),
            corrected_mm=nothing,
            sigma_mm=nothing,
            epipolar_px=nothing[:, 0],
        )

    lost = replace(
        data,
        pos0=outside(data.pos0),
        volume=outside(data.volume),
        variants={key: outside(v) for key, v in data.variants.items()},
    )
    page = Page(write_report(lost, tmp_path).read_text())
    assert page.tables["table-figures"][5][1] == "not known"
    assert not re.search(r"\bnan\b", " ".join(page.words), re.IGNORECASE)
