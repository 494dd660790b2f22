"""The data folder: names lead nowhere else, and nothing is overwritten."""

import numpy as np
import pytest

from bscd.acquisition import FrameRecord, RunWriter
from bscd.daemon.errors import UnknownNameError
from bscd.daemon.files import KINDS, DataFolder
from bscd.errors import InputError
from tests.procedures.measuring.twin_runs import CAMERA

BAD = ["", ".", "..", "../x", "a/b", "a\\b", "/etc/passwd", "a\0b", "~", "-x", "x" * 121, "x.h5", "ä", "a b", "%2e%2e"]


@pytest.fixture
def folder(tmp_path):
    return DataFolder(tmp_path / "data")


def record(path):
    with RunWriter(path, title="a run", cameras={"primary": CAMERA}) as run:
        run.append(FrameRecord("primary", "sphere", np.zeros((1024, 1280), np.uint8), 0))


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("kind", KINDS)
def test_a_name_that_is_none_leads_nowhere(folder, kind, name):
    (folder.root.parent / "x.h5").touch()
    with pytest.raises(UnknownNameError):
        folder.path(kind, name)
    with pytest.raises(InputError):
        folder.new(kind, name)
    assert not folder.has(kind, name)


def test_a_link_out_of_the_folder_is_not_followed(folder, tmp_path):
    (tmp_path / "secret.h5").touch()
    (folder.folder("run") / "link.h5").symlink_to(tmp_path / "secret.h5")
    with pytest.raises(UnknownNameError):
        folder.path("run", "link")


def test_a_report_gives_only_its_own_files(folder):
    place = folder.new("report", "one")
    place.mkdir()
    (place / "report.html").write_text("x")
    (place / "w.png").write_text("x")
    assert folder.report_file("one", "w.png") == (place / "w.png").resolve()
    for name in ("../../journal.sqlite", "..", "nothing.png", "/etc/passwd"):
        with pytest.raises(UnknownNameError):
            folder.report_file("one", name)


def test_a_catalogue_tells_headers_and_what_can_not_be_read(folder):
    record(folder.new("run", "good"))
    (folder.folder("run") / "bad.h5").write_text("no HDF5")
    by_name = {one.name: one for one in folder.list("run")}
    assert by_name["good"].about["title"] == "a run"
    assert by_name["good"].about["frames"] == 1
    assert by_name["good"].problem == ""
    assert "not an HDF5 file" in by_name["bad"].problem
    assert folder.about("run", "good") == by_name["good"]


def test_nothing_is_overwritten(folder):
    record(folder.new("run", "good"))
    with pytest.raises(InputError, match="exists already; nothing is overwritten"):
        folder.new("run", "good")


def test_a_folder_that_can_not_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="the data folder can not be made"):
        DataFolder(tmp_path / "file" / "data")
