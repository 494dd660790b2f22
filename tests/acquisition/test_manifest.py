import csv
import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bscd.acquisition.manifest import HEADER, parse_manifest

IMAGES = ["a.png", "b.png", "sub/c.tif"]
TITLE = ",".join(HEADER)


def problems(*lines, images=IMAGES, title=TITLE):
    return [str(problem) for problem in parse_manifest("\n".join([title, *lines]), images)[1]]


def test_a_row_becomes_what_the_design_says():
    text = f"{TITLE}\na.png,primary,bsc-face,-8,-16.002,0.01,,\nsub/c.tif,auxiliary,inflation,,,,13.25,1.5e0\n"
    rows, wrong = parse_manifest(text, IMAGES)
    assert wrong == []
    first, second = rows
    assert (first.line, first.file, first.camera, first.phase) == (2, "a.png", "primary", "bsc-face")
    assert (first.target_position, first.y_mm, first.rotation_deg) == (-8, -16.002, 0.01)
    assert math.isnan(first.pressure_kpa)
    assert math.isnan(first.time_s)
    assert (second.line, second.file, second.target_position) == (3, "sub/c.tif", None)
    assert (second.pressure_kpa, second.time_s) == (13.25, 1.5)
    assert math.isnan(second.y_mm)


@pytest.mark.parametrize(
    "text",
    [
        f"{TITLE}\r\na.png,primary,sphere,,,,,\r\n",
        f"\n{TITLE}\n\n  ,\na.png , primary,sphere,,,,,\n\n".replace("  ,\n", "\n"),
        "camera,phase,file,time_s,pressure_kpa,rotation_deg,y_mm,target_position\nprimary,sphere,./a.png,,,,,\n",
        f'"{TITLE.replace(",", chr(34) + "," + chr(34))}"\n"a.png","primary","sphere","","","","",""\n',
    ],
    ids=["Windows line ends", "blanks and spaces", "columns in another order", "everything quoted"],
)
def test_what_spreadsheets_write_is_read(text):
    rows, wrong = parse_manifest(text, IMAGES)
    assert wrong == []
    assert [(row.file, row.camera, row.phase) for row in rows] == [("a.png", "primary", "sphere")]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("a.png,primry,sphere,,,,,", "manifest.csv:2: camera 'primry' is not a camera; did you mean primary?"),
        ("a.png,x,sphere,,,,,", "manifest.csv:2: camera 'x' is not a camera; allowed: primary, auxiliary"),
        ("a.png,primary,bsc_face,1,,,,", "manifest.csv:2: phase 'bsc_face' is not a phase; did you mean bsc-face?"),
        ("a.png,primary,Sphere,,,,,", "manifest.csv:2: phase 'Sphere' is not a phase; did you mean sphere?"),
        ("a.jpg,primary,sphere,,,,,", "manifest.csv:2: file 'a.jpg' is not in the folder; did you mean a.png?"),
        ("zzzzzz,primary,sphere,,,,,", "manifest.csv:2: file 'zzzzzz' is not in the folder"),
        (",primary,sphere,,,,,", "manifest.csv:2: file '' is empty; name the image"),
        ("../a.png,primary,sphere,,,,,", "file '../a.png' lies outside the folder"),
        ("sub/../../a.png,primary,sphere,,,,,", "lies outside the folder"),
        ("/etc/a.png,primary,sphere,,,,,", "lies outside the folder"),
        ("C:\\a.png,primary,sphere,,,,,", "lies outside the folder"),
        ("a.png,primary,bsc-face,one,,,,", "target_position 'one' is not a number; allowed: a decimal number"),
        ("a.png,primary,bsc-face,0.5,,,,", "target_position '0.5' is not the k of a POS.k; allowed: whole numbers"),
        ("a.png,primary,bsc-face,1e9,,,,", "target_position '1e9' is not the k of a POS.k"),
        ("a.png,primary,bsc-face,,2.0,,,", "target_position '' is empty, but a bsc-face image needs the k"),
        ('a.png,primary,bsc-face,1,"2,0",,,', "y_mm '2,0' is not a number"),
        ("a.png,primary,bsc-face,1,2 mm,,,", "y_mm '2 mm' is not a number"),
        ("a.png,primary,bsc-face,1,,nan,,", "rotation_deg 'nan' is not a number"),
        ("a.png,primary,inflation,,,,inf,", "pressure_kpa 'inf' is not a number"),
        ("a.png,primary,inflation,,,,1_000,", "pressure_kpa '1_000' is not a number"),
        ("a.png,primary,inflation,,,,,1e999", "time_s '1e999' is not a number"),
        ("a.png,primary,inflation,,,,,0x10", "time_s '0x10' is not a number"),
        ("a.png,primary,inflation", "manifest.csv:2: 3 cells instead of 8"),
        ("a.png,primary,bsc-face,1,2,0,45,,,", "manifest.csv:2: 10 cells instead of 8; numbers need a decimal point"),
        ('"a.png,primary,inflation,,,,,', "manifest.csv:2: is not CSV"),
    ],
)
def test_a_bad_cell_is_one_line_with_place_column_value_and_what_is_allowed(row, told):
    (line,) = problems(row)
    assert told in line
    assert "\n" not in line


def test_all_problems_are_told_at_once_in_order():
    told = problems(
        "a.png,primary,sphere,,,,,",
        "b.png,primry,spere,,x,,,",
        "a.png,primary,sphere,,,,,",
        "sub/c.tif,primary,sphere,,,,,y",
    )
    assert [line.split(" ")[:2] for line in told] == [
        ["manifest.csv:3:", "phase"],
        ["manifest.csv:3:", "camera"],
        ["manifest.csv:3:", "y_mm"],
        ["manifest.csv:4:", "file"],
        ["manifest.csv:5:", "time_s"],
    ]
    assert "is already in line 2" in told[3]


def test_the_same_image_by_another_path_is_found_out():
    (line,) = problems("sub/c.tif,primary,sphere,,,,,", "sub\\..\\sub\\c.tif,primary,sphere,,,,,")
    assert "is already in line 2" in line


def test_lines_are_counted_through_quoted_line_ends():
    (line,) = problems('"a.png\n",primary,sphere,,,,,', "b.png,x,sphere,,,,,")
    assert line.startswith("manifest.csv:4: camera")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "it is empty; its first line must be file,camera,phase"),
        (TITLE, "it names no image"),
        (TITLE.replace(",", ";") + "\na.png;primary;sphere;;;;;", "not separated by commas"),
        (TITLE.replace("phase", "fase"), "no column 'fase' is known; did you mean phase?"),
        (TITLE.replace(",time_s", ""), "columns missing: time_s"),
        (TITLE + ",file", "column file stands twice"),
        ("a.png,primary,sphere,,,,,", "no column 'a.png' is known"),
        ('"' + "x" * 200_000 + '"', "is not CSV"),
    ],
)
def test_a_bad_header_is_told(text, told):
    rows, wrong = parse_manifest(text, IMAGES)
    assert rows == []
    assert told in str(wrong[0])
    assert all("\n" not in str(problem) for problem in wrong)


CELL = st.one_of(
    st.sampled_from(["a.png", "primary", "bsc-face", "sphere", "", "1", "-2.5", "nan", "../a.png", "~", "a\0b"]),
    st.text(max_size=12),
    st.floats().map(str),
)


@given(st.text(max_size=300))
def test_any_text_is_answered_without_a_traceback(text):
    rows, wrong = parse_manifest(text, IMAGES)
    assert wrong or rows


@given(st.text(max_size=200))
def test_any_text_below_the_header_is_answered_without_a_traceback(text):
    rows, wrong = parse_manifest(f"{TITLE}\n{text}", IMAGES)
    assert wrong or rows


@given(st.lists(st.lists(CELL, min_size=8, max_size=8), min_size=1, max_size=4))
def test_any_cells_are_answered_and_what_is_accepted_is_what_was_given(cells):
    written = io.StringIO()
    csv.writer(written).writerows([HEADER, *cells])
    rows, wrong = parse_manifest(written.getvalue(), IMAGES)
    assert all("\n" not in str(problem) for problem in wrong)
    if not wrong:
        kept = [row for row in cells if any(cell.strip() for cell in row)]
        assert [row.camera for row in rows] == [row[1].strip() for row in kept]
        for row, given_cells in zip(rows, kept, strict=True):
            assert row.file in IMAGES
            for value, cell in zip((row.y_mm, row.pressure_kpa), (given_cells[4], given_cells[6]), strict=True):
                assert value == float(cell) if cell.strip() else math.isnan(value)
