"""Signals and the vent, in this process: none cuts it short, and none is forgotten that nobody has heeded."""

import signal
import threading
from types import SimpleNamespace

import pytest

from bscd.procedures.recording import NotVentedError
from bscd.procedures.recording.ending import safe_ending
from bscd.procedures.recording.signals import ENDING_SIGNALS, EndedBySignal, HeldSignals
from drivers.errors import DeviceTimeoutError


@pytest.fixture(autouse=True)
def handlers():
    before = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    yield
    left = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    for number, handler in before.items():
        signal.signal(number, handler)
    assert left == before


class Signalled:
    """A rig whose vent is met by a signal, and what was done with it."""

    def __init__(self, *numbers, fails=False):
        self.done, self._numbers, self._fails = [], numbers, fails
        self.pressure = SimpleNamespace(vent=self.vent)
        self.primary = SimpleNamespace(stop=lambda: self.done.append("camera stopped"))

    def vent(self):
        for number in self._numbers:
            signal.raise_signal(number)
        if self._fails:
            raise DeviceTimeoutError("pressure", "venting: no answer", "look at it")
        self.done.append("vented")

    def stop_axes(self):
        self.done.append("axes stopped")


ALL_DONE = ["vented", "camera stopped", "axes stopped"]


def test_the_first_ends_the_block_and_the_second_waits():
    rig = Signalled(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), safe_ending(rig):
        signal.raise_signal(signal.SIGINT)
    assert rig.done == ALL_DONE


def test_one_that_nobody_has_heeded_comes_when_all_is_done():
    rig = Signalled(signal.SIGINT, signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), safe_ending(rig):
        pass
    assert rig.done == ALL_DONE


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_one_that_would_kill_ends_the_block(number):
    before = signal.signal(number, signal.SIG_DFL)
    rig = Signalled(number)
    with pytest.raises(EndedBySignal, match=f"ended by {signal.Signals(number).name}") as ended, safe_ending(rig):
        signal.raise_signal(number)
    assert ended.value.code == 128 + number
    assert rig.done == ALL_DONE
    signal.signal(number, before)


def test_each_reaches_its_handler_once_while_the_block_lasts():
    came = []
    before = signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    with safe_ending(Signalled(signal.SIGTERM)):
        for _ in range(3):
            signal.raise_signal(signal.SIGTERM)
        assert came == [signal.SIGTERM]
    assert came == [signal.SIGTERM]
    signal.signal(signal.SIGTERM, before)


def test_a_vent_that_failed_is_what_is_told():
    rig = Signalled(signal.SIGINT, fails=True)
    with pytest.raises(NotVentedError, match="open the valve by hand"), safe_ending(rig):
        pass
    assert rig.done == ALL_DONE[1:]


def test_ignored_ones_stay_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with HeldSignals():
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        signal.raise_signal(signal.SIGHUP)
    signal.signal(signal.SIGHUP, before)


def test_in_another_thread_nothing_changes():
    rig, seen = Signalled(), []

    def end():
        with safe_ending(rig):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=end)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]
    assert rig.done == ALL_DONE
