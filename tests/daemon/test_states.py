"""The table of states, walked by hypothesis against itself and read as documentation."""

import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bscd.daemon.documents import RigState
from bscd.daemon.errors import IllegalRequestError
from bscd.daemon.states import ASKED, TRANSITIONS, RigStates, allowed_in, diagram

DOCS = Path(__file__).resolve().parents[2] / "docs/daemon.md"

#: Written down by hand, from what each state means: the table must say the same.
ALLOWED = {
    RigState.OFFLINE: {"connect", "estop"},
    RigState.CONNECTING: {"estop"},
    RigState.IDLE: {"disconnect", "start", "estop"},
    RigState.RUNNING: {"pause", "stop", "estop"},
    RigState.PAUSING: {"resume", "stop", "estop"},
    RigState.PAUSED: {"resume", "stop", "estop"},
    RigState.STOPPING: {"estop"},
    RigState.FAULT: {"connect", "disconnect", "estop"},
    RigState.ESTOPPED: {"estop", "reset"},
}


@pytest.mark.parametrize("state", RigState, ids=str)
def test_what_a_person_may_ask_for(state):
    assert set(allowed_in(state)) == ALLOWED[state]


@given(st.lists(st.sampled_from(sorted(TRANSITIONS)), max_size=40))
def test_no_event_leads_where_the_table_does_not(events):
    changes = []
    states = RigStates(lambda before, after, _: changes.append((before, after)))
    for event in events:
        before, (sources, target) = states.state, TRANSITIONS[event]
        count = len(changes)
        if before in sources:
            assert states.send(event, "why") is target
            assert (states.state, states.reason) == (target, "why")
            assert changes[count:] == [(before, target)]
        else:
            assert not states.send_if_allowed(event)
            with pytest.raises(IllegalRequestError) as refused:
                states.send(event)
            assert refused.value.state == before.value
            assert refused.value.allowed == allowed_in(before)
            assert states.state is before
            assert len(changes) == count


def test_nothing_leaves_the_e_stop_but_a_reset():
    assert [event for event, (sources, _) in TRANSITIONS.items() if RigState.ESTOPPED in sources] == ["estop", "reset"]


def test_the_e_stop_works_in_every_state():
    assert set(TRANSITIONS["estop"][0]) == set(RigState)


def test_of_many_threads_one_starts():
    states = RigStates()
    states.send("connect")
    states.send("connected")
    begun = []
    threads = [threading.Thread(target=lambda: begun.append(states.send_if_allowed("start"))) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(begun) == [False] * 15 + [True]


def test_the_documentation_shows_the_table():
    assert diagram() in DOCS.read_text(encoding="utf-8")
    assert set(ASKED) <= set(TRANSITIONS)
