"""Keys, tokens and control of the rig."""

import json
import stat

import pytest

from bscd.daemon.errors import NotInControlError
from bscd.daemon.keys import KeyStore, OneShotTokens
from bscd.daemon.lease import ControlLease
from bscd.errors import InputError


@pytest.fixture
def store(tmp_path):
    return KeyStore(tmp_path / "keys.json")


def test_a_key_is_found_by_itself_alone(store):
    assert store.empty
    key = store.add("anna", "operator")
    other = store.add("bert", "viewer")
    assert key != other
    found = store.find(key)
    assert (found.name, found.role) == ("anna", "operator")
    assert [found.may(role) for role in ("viewer", "operator", "admin")] == [True, True, False]
    for wrong in ("", "x", key[:-1], key[:-1] + ("A" if key[-1] != "A" else "B"), key + "A", key.upper()):
        assert store.find(wrong) is None
    assert [one.name for one in store.list()] == ["anna", "bert"]


def test_the_file_holds_no_key_and_is_its_owners_alone(store):
    key = store.add("anna", "admin")
    assert stat.S_IMODE(store.path.stat().st_mode) == 0o600
    text = store.path.read_text()
    assert key not in text
    assert key.split("_")[2] not in text
    assert list(store.path.parent.iterdir()) == [store.path]


def test_a_revoked_key_opens_nothing_also_elsewhere(store):
    key = store.add("anna", "admin")
    running = KeyStore(store.path)
    assert running.find(key) is not None
    store.revoke("anna")
    assert running.find(key) is None
    assert running.empty
    with pytest.raises(InputError, match="anna: has no key"):
        store.revoke("anna")


@pytest.mark.parametrize(
    ("name", "role", "told"),
    [
        ("anna", "viewer", "has a key already"),
        ("../x", "viewer", "is no name for a key"),
        ("", "viewer", "is no name"),
        ("bert", "king", "is no role; choose viewer, operator, admin"),
    ],
)
def test_what_can_not_be_is_told(store, name, role, told):
    store.add("anna", "viewer")
    with pytest.raises(InputError, match=told):
        store.add(name, role)
    assert len(store.list()) == 1


@pytest.mark.parametrize("text", ["", "{", "[]", '{"keys": [{"name": "x"}]}', json.dumps({"keys": 3})])
def test_a_file_that_is_none_opens_nothing(store, text):
    store.path.write_text(text)
    with pytest.raises(InputError, match="is no file of keys"):
        store.find("bscd_" + "0" * 8 + "_" + "x" * 43)


def test_a_token_opens_once_and_soon(store):
    store.add("anna", "viewer")
    (holder,) = store.list()
    now = [0.0]
    tokens = OneShotTokens(30.0, clock=lambda: now[0], most=3)
    token = tokens.issue(holder)
    assert tokens.redeem("other") is None
    assert tokens.redeem(token) == holder
    assert tokens.redeem(token) is None
    late = tokens.issue(holder)
    now[0] = 31.0
    assert tokens.redeem(late) is None
    kept = [tokens.issue(holder) for _ in range(5)]
    assert [tokens.redeem(one) is not None for one in kept] == [False, False, True, True, True]


def test_one_at_a_time_is_in_control():
    now = [0.0]
    lease = ControlLease(60.0, clock=lambda: now[0])
    assert lease.document() is None
    assert lease.take("anna").holder == "anna"
    with pytest.raises(NotInControlError, match="anna is in control until"):
        lease.require("bert")
    now[0] = 50.0
    lease.require("anna")  # what she does renews it
    now[0] = 100.0
    with pytest.raises(NotInControlError):
        lease.take("bert")
    assert lease.take("bert", force=True).holder == "bert"
    lease.release("anna")  # it is not hers
    assert lease.document().holder == "bert"
    now[0] = 161.0
    assert lease.document() is None
    assert lease.require("anna").holder == "anna"
    lease.release("anna")
    assert lease.document() is None
