"""What other programs see: the default plot, the base classes, NeXpy's own reader and validator."""

import logging

import h5py
import nexusformat.nexus as nx
import numpy as np
import pytest

from tests.results.measured import frames, write


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "results.h5", 5)


def test_following_default_signal_and_axes_ends_at_the_largest_displacement(path):
    """The rule by which silx, h5web and NeXpy find the plot (NeXus manual, "Find the plottable data")."""
    moved = [np.linalg.norm(frame.displacement_mm[frame.valid], axis=1) for frame in frames(5)]
    with h5py.File(path) as file:
        node = file
        while "default" in node.attrs:
            node = node[node.attrs["default"]]
        assert node.name == "/entry/data"
        assert node.attrs["NX_class"] == "NXdata"
        signal = node[node.attrs["signal"]]
        np.testing.assert_allclose(signal[:], [d.max() if len(d) else np.nan for d in moved])
        assert signal.attrs["units"] == "mm"
        axes = list(node.attrs["axes"])
        assert len(axes) == signal.ndim
        np.testing.assert_array_equal(node[axes[0]][:], [3, 4, 5, 6, 7])


def test_nexpy_reads_the_same_plot(path):
    data = nx.nxload(path).plottable_data
    assert data.nxsignal.nxname == "displacement_max_mm"
    assert [len(axis) for axis in data.nxaxes] == [5]


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


@pytest.mark.parametrize(
    ("group", "nx_class"),
    [
        ("entry", "NXentry"),
        ("entry/data", "NXdata"),
        ("entry/process", "NXprocess"),
        ("entry/process/parameters", "NXparameters"),
        ("entry/measurement", "NXcollection"),
        ("entry/recording", "NXcollection"),
    ],
)
def test_groups_are_base_classes(path, group, nx_class):
    with h5py.File(path) as file:
        assert file[group].attrs["NX_class"] == nx_class
