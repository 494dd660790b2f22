"""The virtual clock's appointments, which the cameras' streams are built on."""

import threading

from drivers.clock import HostClock, VirtualClock


def test_appointments_are_kept_in_order_and_at_their_time():
    clock = VirtualClock(10.0)
    seen = []
    for time_s in (12.0, 11.0, 11.0, 15.0, 9.0):
        clock.call_at(time_s, lambda time_s=time_s: seen.append((time_s, clock.now_s())))
    clock.sleep(4.0)
    assert seen == [(9.0, 10.0), (11.0, 11.0), (11.0, 11.0), (12.0, 12.0)]
    assert clock.now_s() == 14.0
    clock.sleep(1.0)
    assert seen[-1] == (15.0, 15.0)


def test_an_appointment_can_make_another_and_can_wait():
    clock = VirtualClock()
    seen = []

    def tick():
        seen.append(clock.now_s())
        if len(seen) < 5:
            clock.call_at(clock.now_s() + 1.0, tick)
        if len(seen) == 2:
            clock.sleep(0.5)

    clock.call_at(1.0, tick)
    clock.sleep(3.2)
    assert seen == [1.0, 2.0, 3.0]
    assert clock.now_s() == 3.2


def test_a_cancelled_appointment_is_not_kept():
    clock = VirtualClock()
    seen = []
    appointment = clock.call_at(1.0, lambda: seen.append("cancelled"))
    clock.call_at(2.0, lambda: seen.append("kept"))
    appointment.cancel()
    clock.sleep(3.0)
    appointment.cancel()
    assert seen == ["kept"]


def test_no_wait_is_no_time():
    clock = VirtualClock()
    clock.sleep(0.0)
    clock.sleep(-1.0)
    assert clock.now_s() == 0.0


def test_threads_that_wait_at_once_never_see_time_go_back():
    clock = VirtualClock()
    falls = []

    def run():
        last_s = clock.now_s()
        for _ in range(500):
            clock.sleep(0.01)
            now_s = clock.now_s()
            if now_s < last_s + 0.01 - 1e-9:
                falls.append(now_s)
            last_s = now_s

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=30)
    assert falls == []


def test_the_hosts_clock_calls_from_another_thread_and_can_be_called_off():
    clock = HostClock()
    called = threading.Event()
    callers = []
    never = clock.call_at(clock.now_s() + 60.0, lambda: callers.append("never"))

    def call():
        callers.append(threading.current_thread())
        called.set()

    clock.call_at(clock.now_s() - 1.0, call)
    assert called.wait(timeout=10)
    never.cancel()
    assert len(callers) == 1
    assert callers[0] is not threading.current_thread()
