"""Reach into an HDF5 file by path and kind, so that a file of another shape is a `KeyError` that names the path."""

from __future__ import annotations

import h5py


def group_at(parent: h5py.Group, path: str) -> h5py.Group:
    """The group at a path; `KeyError` when there is none."""
    node = parent[path]
    if not isinstance(node, h5py.Group):
        raise KeyError(f"{path} is no group")
    return node


def dataset_at(parent: h5py.Group, path: str) -> h5py.Dataset:
    """The dataset at a path; `KeyError` when there is none."""
    node = parent[path]
    if not isinstance(node, h5py.Dataset):
        raise KeyError(f"{path} is no dataset")
    return node


def text_at(parent: h5py.Group, path: str) -> str:
    """A text dataset's content, whether of fixed or variable size."""
    value = dataset_at(parent, path)[()]
    if not isinstance(value, bytes):
        raise KeyError(f"{path} is no text")
    return value.decode("utf-8", "replace")
