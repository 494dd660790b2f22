"""Events: numbered, replayed, and never waited for."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from bscd.daemon.events import EventLog, first_id


@given(st.integers(1, 20), st.integers(0, 40), st.integers(-5, 50))
def test_replay_gives_what_came_after_and_says_what_is_gone(keep, count, after):
    log = EventLog(keep, first=100)
    for number in range(count):
        log.publish("warning", {"number": number})
    asked = 100 + after
    events, gone = log.since(asked)
    kept = list(range(max(100, 100 + count - keep), 100 + count))
    assert [event.id for event in events] == [one for one in kept if one > asked]
    first = kept[0] if kept else 100
    assert gone == (asked < first - 1 or asked >= 100 + count)
    with log.subscribe(after=asked) as listener:
        assert [listener.get(0.0).id for _ in events] == [event.id for event in events]
        assert listener.get(0.0) is None
        assert listener.lost == int(gone)


def test_a_slow_listener_loses_its_own_oldest_and_is_told():
    log = EventLog()
    with log.subscribe(depth=3) as slow, log.subscribe() as fast:
        for number in range(10):
            log.publish("job", {"number": number})
        assert [slow.get(0.0).data["number"] for _ in range(3)] == [7, 8, 9]
        assert slow.lost == 7
        assert [fast.get(0.0).data["number"] for _ in range(10)] == list(range(10))
        assert fast.lost == 0


def test_what_is_kept_is_bounded_in_bytes():
    log = EventLog(keep_bytes=10_000, first=0)
    for number in range(100):
        log.publish("live", {"number": number, "map": [1.0] * 200})  # 1 kB
    events, gone = log.since(-1)
    assert gone
    assert 5 < len(events) < 10
    assert [event.data["number"] for event in events] == list(range(100 - len(events), 100))
    assert sum(len(event.text) for event in events) <= 10_000


def test_who_has_left_is_not_told():
    log = EventLog()
    with log.subscribe() as listener:
        pass
    log.publish("state", {})
    assert listener.get(0.0) is None


def test_ids_of_many_threads_grow_by_one():
    log = EventLog(keep=10_000)
    threads = [threading.Thread(target=lambda: [log.publish("job", {}) for _ in range(500)]) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ids = [event.id for event in log.since(0)[0]]
    assert ids == list(range(ids[0], ids[0] + 4000))


def test_ids_of_a_later_process_are_greater():
    earlier = EventLog()
    last = [earlier.publish("job", {}) for _ in range(1000)][-1]
    assert last.id < first_id() + 1000
    later = EventLog()
    assert later.since(last.id)[1] or later.last_id >= last.id
