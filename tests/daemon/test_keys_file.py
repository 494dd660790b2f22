"""A file of keys that can not be read opens nothing, but what it held before can still be asked for."""

import os
import stat

import pytest

from bscd.daemon.keys import LOCAL, KeyStore, operator_name
from bscd.errors import InputError


@pytest.fixture
def store(tmp_path):
    return KeyStore(tmp_path / "keys.json")


@pytest.mark.parametrize("text", ["{broken", "[" * 100_000, '{"keys": [{"name": "x"}]}'])
def test_the_keys_that_were_read_last(store, text):
    key = store.add("anna", "viewer")
    store.path.write_text(text)
    with pytest.raises(InputError, match="is no file of keys"):
        store.find(key)
    assert store.find(key, last_read=True).name == "anna"
    assert store.find("bscd_" + "0" * 8 + "_" + "x" * 43, last_read=True) is None
    assert KeyStore(store.path).find(key, last_read=True) is None


def test_a_revoked_key_is_none_that_was_read_last(store):
    key = store.add("anna", "viewer")
    store.add("bert", "viewer")
    store.revoke("anna")
    store.path.write_text("{broken")
    assert store.find(key, last_read=True) is None


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_folder_that_may_not_be_read_is_not_one_without_keys(tmp_path):
    folder = tmp_path / "data"
    store = KeyStore(folder / "keys.json")
    store.add("anna", "viewer")
    folder.chmod(0)
    try:
        with pytest.raises(InputError, match="can not be read"):
            _ = store.empty
    finally:
        folder.chmod(stat.S_IRWXU)


def test_a_path_that_is_none_is_not_one_without_keys(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can not be read"):
        _ = KeyStore(tmp_path / "file" / "keys.json").empty


def test_no_key_is_called_as_who_needs_none(store):
    with pytest.raises(InputError, match="is no name for a key"):
        store.add(LOCAL, "viewer")


@pytest.mark.parametrize("name", ["", " anna", "DOM\\alice", "<b>", "x" * 81, "a\n"])
def test_what_is_no_operators_name(name):
    assert operator_name(name) is None
    assert operator_name("Anna B.") == "Anna B."
