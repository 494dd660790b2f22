"""Jacks turned by hand: the axis contract with a patient operator in virtual time, and what else people do."""

import math
import threading

import pytest

from drivers.clock import HostClock, VirtualClock
from drivers.errors import (
    DeviceError,
    DeviceTimeoutError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import Range
from drivers.jacks.manual import ManualJacks, ManualJacksOptions
from drivers.operator import Question, QuestionState
from drivers.registry import DriverContext
from tests.drivers.contract.axis_contract import AxisContract
from tests.drivers.contract.outcome import Outcome

SPEED_MM_S = 1.0


class Turner:
    """An operator who turns the jacks evenly, leaves off when the question is withdrawn, and reads the scales right."""

    def __init__(self, clock: VirtualClock, height_mm: float = 70.0) -> None:
        self.clock = clock
        self.height_mm = height_mm
        self.questions: list[Question] = []
        self.told: list[str] = []
        self.misread_mm: list[float] = []
        self.away = False
        self._turning: tuple[Question, float] | None = None

    def ask(self, question: Question) -> None:
        self._leave_off()
        self.questions.append(question)
        if self.away:
            return
        if question.proposal is None:
            question.answer(self.height_mm)
            return
        self._turning = question, self.clock.now_s()
        needed_s = abs(question.proposal - self.height_mm) / SPEED_MM_S
        self.clock.call_at(self.clock.now_s() + needed_s, lambda: self._confirm(question))

    def tell(self, device: str, text: str) -> None:
        self.told.append(text)

    def _confirm(self, question: Question) -> None:
        if question.state is QuestionState.OPEN and question.proposal is not None:
            self._turning = None
            self.height_mm = question.proposal + (self.misread_mm.pop() if self.misread_mm else 0.0)
            question.answer(self.height_mm)

    def _leave_off(self) -> None:
        if self._turning is not None:
            question, since_s = self._turning
            turned_mm = SPEED_MM_S * (self.clock.now_s() - since_s)
            assert question.proposal is not None
            way_mm = question.proposal - self.height_mm
            self.height_mm = round(self.height_mm + math.copysign(min(turned_mm, abs(way_mm)), way_mm), 1)
            self._turning = None


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def turner(clock):
    return Turner(clock)


@pytest.fixture
def jacks(clock, turner):
    jacks = ManualJacks(ManualJacksOptions(answer_timeout_s=120.0), DriverContext("jack", clock, operator=turner))
    jacks.connect()
    yield jacks
    jacks.close()


class TestManualJacks(AxisContract):
    @pytest.fixture
    def axis(self, clock, turner):
        return ManualJacks(ManualJacksOptions(), DriverContext("jack", clock, operator=turner))

    @pytest.fixture
    def places(self):
        return (70.0, 84.0, 5.0)

    def test_is_seen_moving(self, ready, clock, places):
        """As the contract has it, and nobody knows the height meanwhile."""
        ready.move_to(places[0])
        outcome = Outcome(clock, ready.move_duration_s(places[1]) / 2.0, ready.status)
        ready.move_to(places[1])
        status = outcome.get()
        assert status.moving and not status.homed
        assert status.target == places[1]
        assert math.isnan(status.position)

    def test_closing_stops_it(self, ready, clock, places):
        """As the contract has it, and the height has to be told again."""
        ready.move_to(places[0])
        outcome = Outcome(clock, ready.move_duration_s(places[1]) / 2.0, ready.close)
        with pytest.raises(DeviceError) as raised:
            ready.move_to(places[1])
        outcome.get()
        assert isinstance(raised.value, MoveStoppedError)
        ready.connect()
        status = ready.status()
        assert (status.moving, status.homed) == (False, False)
        with pytest.raises(NotHomedError):
            ready.move_to(places[1])
        ready.home()
        assert min(places[:2]) < ready.status().position < max(places[:2])


def test_the_operator_is_told_what_to_do(jacks, turner):
    jacks.home()
    jacks.move_to(30.0)
    where, turn = turner.questions
    assert where.text == "jack: what height do both jacks show together, in mm? Do not turn them."
    assert (where.proposal, where.limits, where.unit) == (None, Range(0.0, 84.0), "mm")
    assert turn.text == (
        "jack: turn the lower jack to 15 mm and the upper jack to 15 mm, 30 mm together; "
        "then tell the height that they show"
    )
    assert turn.proposal == 30.0


@pytest.mark.parametrize(
    ("share", "height", "lower", "upper"),
    [(1.0, 50.0, "42", "8"), (0.0, 50.0, "8", "42"), (0.5, 33.33, "16.6", "16.7")],
)
def test_a_height_is_split_as_configured(clock, turner, share, height, lower, upper):
    jacks = ManualJacks(ManualJacksOptions(lower_share=share), DriverContext("jack", clock, operator=turner))
    jacks.connect()
    jacks.home()
    jacks.move_to(height)
    assert f"the lower jack to {lower} mm and the upper jack to {upper} mm" in turner.questions[-1].text


def test_the_confirmed_height_is_the_position(jacks, turner):
    jacks.home()
    turner.misread_mm = [0.1]
    jacks.move_to(30.0)
    assert jacks.status().position == pytest.approx(30.1)
    assert jacks.status().target == 30.0


def test_a_height_too_far_from_what_was_asked_is_asked_for_again(jacks, turner):
    jacks.home()
    turner.misread_mm = [0.0, -1.5]
    jacks.move_to(30.0)
    assert jacks.status().position == 30.0
    assert turner.questions[-1].text == "jack: 28.5 mm is not 30 mm; turn on and tell the height again"


def test_nobody_answers(jacks, turner, clock):
    jacks.home()
    turner.away = True
    began_s = clock.now_s()
    with pytest.raises(DeviceTimeoutError, match=r"moving to 30 mm: no height confirmed within 160 s; tell the height"):
        jacks.move_to(30.0)
    assert clock.now_s() - began_s == pytest.approx(160.0, abs=0.1)
    assert turner.questions[-1].state is QuestionState.WITHDRAWN
    assert not jacks.status().homed
    with pytest.raises(NotHomedError, match="tell the height"):
        jacks.move_to(30.0)
    turner.away = False
    jacks.home()
    jacks.move_to(30.0)


def test_stopped_and_nobody_says_where(jacks, turner, clock):
    jacks.home()

    def stop_and_leave():
        turner.away = True
        jacks.stop()

    clock.call_at(clock.now_s() + 5.0, stop_and_leave)
    with pytest.raises(MoveStoppedError):
        jacks.move_to(30.0)
    assert turner.questions[-1].text.startswith("jack: STOP, turn no further.")
    assert math.isnan(jacks.status().position)
    assert not jacks.status().homed


def test_asking_for_the_height_can_be_stopped(jacks, turner, clock):
    turner.away = True
    clock.call_at(clock.now_s() + 5.0, jacks.stop)
    with pytest.raises(MoveStoppedError, match="asking for the height"):
        jacks.home()
    assert not jacks.status().homed


def test_outside_the_limits_nobody_is_asked(jacks, turner):
    jacks.home()
    for position in (-0.1, 84.1, math.nan):
        with pytest.raises(OutOfLimitsError, match="choose a height from 0 to 84 mm"):
            jacks.move_to(position)
    assert len(turner.questions) == 1


def test_needs_somebody_to_ask(clock):
    jacks = ManualJacks(ManualJacksOptions(), DriverContext("jack", clock))
    with pytest.raises(NotConnectedError, match="there is no operator to ask"):
        jacks.connect()


def test_a_stop_is_heard_in_real_time():
    """An operator at lunch, and the host's clock."""
    clock = HostClock()
    asked = threading.Event()

    class AtLunch:
        def ask(self, question: Question) -> None:
            if question.proposal is None and not asked.is_set():
                question.answer(10.0)
            asked.set()

        def tell(self, device: str, text: str) -> None: ...

    jacks = ManualJacks(ManualJacksOptions(), DriverContext("jack", clock, operator=AtLunch()))
    jacks.connect()
    jacks.home()
    twice = [Outcome(clock, 0.2, jacks.stop), Outcome(clock, 0.6, jacks.stop)]
    began_s = clock.now_s()
    with pytest.raises(MoveStoppedError):
        jacks.move_to(30.0)
    assert clock.now_s() - began_s < 5.0
    for outcome in twice:
        outcome.get()
    jacks.close()


@pytest.mark.parametrize("wrong", [-0.1, 84.1, math.nan, math.inf])
def test_an_answer_that_can_not_be_is_refused_and_asked_on(wrong):
    question = Question("jack", "what height?", "mm", Range(0.0, 84.0))
    with pytest.raises(ValueError, match=r"jack: .* mm can not be; it must be from 0 to 84 mm"):
        question.answer(wrong)
    assert question.state is QuestionState.OPEN
    question.answer(84.0)
    assert (question.state, question.value) == (QuestionState.ANSWERED, 84.0)
    with pytest.raises(ValueError, match="answered already"):
        question.answer(3.0)
    question.withdraw()
    assert question.value == 84.0
