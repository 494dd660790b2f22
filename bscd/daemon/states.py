"""The rig's states and the only ways between them; the documentation's diagram is made of `TRANSITIONS`."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from statemachine import State, StateMachine
from statemachine.exceptions import TransitionNotAllowed

from bscd.daemon.documents import RigState
from bscd.daemon.errors import IllegalRequestError

_R = RigState

#: Event -> (from, to). "stop" and "estop" lead on from wherever something could move.
TRANSITIONS: Mapping[str, tuple[tuple[RigState, ...], RigState]] = {
    "connect": ((_R.OFFLINE, _R.FAULT), _R.CONNECTING),
    "connected": ((_R.CONNECTING,), _R.IDLE),
    "start": ((_R.IDLE,), _R.RUNNING),
    "pause": ((_R.RUNNING,), _R.PAUSING),
    "reached": ((_R.PAUSING,), _R.PAUSED),
    "resume": ((_R.PAUSING, _R.PAUSED), _R.RUNNING),
    "stop": ((_R.RUNNING, _R.PAUSING, _R.PAUSED), _R.STOPPING),
    "finish": ((_R.RUNNING, _R.PAUSING, _R.PAUSED, _R.STOPPING), _R.IDLE),
    "fail": ((_R.CONNECTING, _R.IDLE, _R.RUNNING, _R.PAUSING, _R.PAUSED, _R.STOPPING), _R.FAULT),
    "disconnect": ((_R.IDLE, _R.FAULT), _R.OFFLINE),
    "estop": (tuple(RigState), _R.ESTOPPED),
    "reset": ((_R.ESTOPPED,), _R.CONNECTING),
}

#: What a person may ask for; the engine sends the others.
ASKED = ("connect", "disconnect", "start", "pause", "resume", "stop", "estop", "reset")


def _machine() -> type[StateMachine]:
    states = {one: State(one.value, value=one.value, initial=one is _R.OFFLINE) for one in RigState}
    events = {}
    for event, (sources, target) in TRANSITIONS.items():
        ways = [
            states[source].to.itself() if source is target else states[source].to(states[target]) for source in sources
        ]
        for way in ways[1:]:
            ways[0] |= way
        events[event] = ways[0]
    named = {one.name.lower(): state for one, state in states.items()}
    return type("RigMachine", (StateMachine,), {**named, **events})


_Machine = _machine()


class RigStates:
    """The rig's state, from any thread; ``on_change(before, after, reason)`` is called once a change, in order."""

    def __init__(self, on_change: Callable[[RigState, RigState, str], None] = lambda *_: None) -> None:
        self._lock = threading.RLock()
        self._machine = _Machine()
        self._on_change = on_change
        self._state, self._reason = RigState.OFFLINE, ""

    @property
    def state(self) -> RigState:
        """Now."""
        return self._state

    @property
    def reason(self) -> str:
        """Why it is so, where somebody or something gave a reason."""
        return self._reason

    @property
    def allowed(self) -> tuple[str, ...]:
        """What may be asked for now."""
        return allowed_in(self._state)

    def send(self, event: str, reason: str = "") -> RigState:
        """Go on by an event. Raises `IllegalRequestError` when the state does not allow it; nothing changes then."""
        with self._lock:
            before = self._state
            try:
                self._machine.send(event)
            except TransitionNotAllowed as error:
                raise IllegalRequestError(f"{event} is not possible now", before.value, self.allowed) from error
            self._state, self._reason = RigState(self._machine.current_state_value), reason
            self._on_change(before, self._state, reason)
            return self._state

    def send_if_allowed(self, event: str, reason: str = "") -> bool:
        """`send`, where the state allows it; whether it did."""
        with self._lock:
            if self._state not in TRANSITIONS[event][0]:
                return False
            self.send(event, reason)
            return True


def allowed_in(state: RigState) -> tuple[str, ...]:
    """What may be asked for in a state, as `TRANSITIONS` has it."""
    return tuple(event for event in ASKED if state in TRANSITIONS[event][0])


def diagram() -> str:
    """The table as a Mermaid state diagram; docs/daemon.md holds it."""
    lines = ["stateDiagram-v2", "    [*] --> offline"]
    for event, (sources, target) in TRANSITIONS.items():
        if event != "estop":
            lines += [f"    {_id(source)} --> {_id(target)}: {event}" for source in sources]
    lines += ['    state "any state" as any', "    any --> estopped: estop", '    state "e-stopped" as estopped']
    return "\n".join(lines) + "\n"


def _id(state: RigState) -> str:
    return state.value.replace("-", "")
