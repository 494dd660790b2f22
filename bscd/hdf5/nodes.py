"""Reach into an HDF5 file by path and kind, so that a file of another shape is a `KeyError` that names the path."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray


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


def readable_rows(dataset: h5py.Dataset) -> NDArray[Any]:
    """The rows of a column up to the first chunk that can not be read."""
    try:
        return dataset[:]
    except (OSError, RuntimeError):
        chunk, found = (dataset.chunks or (1,))[0], [np.empty(0, dataset.dtype)]
    for start in range(0, len(dataset), chunk):
        try:
            found.append(dataset[start : start + chunk])
        except (OSError, RuntimeError):
            break
    return np.concatenate(found)
