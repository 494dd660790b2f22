"""What other programs see: the default plot, the base classes, NeXpy's own reader and validator."""

import logging

import h5py
import nexusformat.nexus as nx
import numpy as np
import pytest

from bscd.acquisition import RunWriter
from tests.acquisition.run_records import PRESSURE, SETTINGS, frames


@pytest.fixture
def path(tmp_path):
    with RunWriter(tmp_path / "run.h5", **SETTINGS, pressure=PRESSURE) as run:
        for record in frames(8):
            run.append(record)
    return tmp_path / "run.h5"


def test_following_default_signal_and_axes_ends_at_the_primary_images(path):
    """The rule by which silx, h5web and NeXpy find the plot (NeXus manual, "Find the plottable data")."""
    images = np.stack([record.data for record in frames(8) if record.camera == "primary"])
    with h5py.File(path) as file:
        node = file
        while "default" in node.attrs:
            node = node[node.attrs["default"]]
        assert node.attrs["NX_class"] == "NXdata"
        signal = node[node.attrs["signal"]]
        np.testing.assert_array_equal(signal[:], images)
        assert signal.attrs["interpretation"] == "image"
        axes = list(node.attrs["axes"])
        assert len(axes) == signal.ndim
        np.testing.assert_array_equal(node[axes[0]][:], [0, 2, 4, 6])
        assert axes[1:] == [".", "."]
        assert node.get(node.attrs["signal"], getlink=True).path == "/entry/instrument/primary/data"


def test_nexpy_reads_the_same_plot(path):
    root = nx.nxload(path)
    data = root.plottable_data
    assert data.nxsignal.shape == (4, 8, 12)
    assert [len(axis) for axis in data.nxaxes] == [4, 8, 12]


def test_every_group_is_a_base_class_and_the_validator_finds_no_error(path, caplog):
    """NeXpy's validator knows the NXDL base classes; fields of our own are only warned of."""
    root = nx.nxload(path)
    logger = logging.getLogger("NXValidate")
    logger.addHandler(caplog.handler)
    try:
        with caplog.at_level(logging.WARNING):
            root.entry.check(level="warning")
    finally:
        logger.removeHandler(caplog.handler)
    said = caplog.text
    assert "Total number of errors: 0" in said
    assert "not a valid base class" not in said
    lines = [line for line in said.splitlines() if "not defined in" in line]
    assert lines, "the validator looked at nothing"


@pytest.mark.parametrize(
    ("group", "nx_class"),
    [
        ("entry", "NXentry"),
        ("entry/instrument", "NXinstrument"),
        ("entry/instrument/primary", "NXdetector"),
        ("entry/instrument/auxiliary", "NXdetector"),
        ("entry/instrument/jack", "NXpositioner"),
        ("entry/instrument/pressure", "NXsensor"),
        ("entry/instrument/pressure/value_log", "NXlog"),
        ("entry/configuration", "NXnote"),
        ("entry/recipe", "NXnote"),
    ],
)
def test_groups_are_the_base_classes_of_the_design(path, group, nx_class):
    with h5py.File(path) as file:
        assert file[group].attrs["NX_class"] == nx_class


def test_a_frame_is_a_chunk_and_nothing_is_filtered(path):
    with h5py.File(path) as file:
        data = file["entry/instrument/primary/data"]
        assert data.chunks == (1, 8, 12)
        assert data.maxshape == (None, 8, 12)
        assert data.id.get_num_chunks() == 4
