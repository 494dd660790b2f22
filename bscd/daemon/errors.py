"""What the daemon refuses, and why; the API turns each into a status code and problem+json."""

from __future__ import annotations

from collections.abc import Sequence

from bscd.errors import BscdError


class IllegalRequestError(BscdError):
    """The rig's or the job's state does not allow it; ``state`` is that state, ``allowed`` what it does allow."""

    def __init__(self, message: str, state: str, allowed: Sequence[str]) -> None:
        self.state = state
        self.allowed = tuple(allowed)
        told = ", ".join(allowed) or "nothing"
        super().__init__(f"{message}: the state is {state}, allowed now: {told}")


class UnknownNameError(BscdError):
    """There is no job, run, calibration, camera or question of that name."""


class InterlockError(BscdError):
    """A recipe was refused before it began, nothing moved; ``problems`` are sentences, one for each reason."""

    def __init__(self, what: str, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(f"{what} refused, nothing moved: {'; '.join(problems)}")


class NotInControlError(BscdError):
    """Somebody else has the rig's control lease, or nobody has and the request needs it."""


class EmergencyStoppedError(BscdError):
    """The e-stop is latched: nothing moves and no pressure is set until an operator resets it."""


class AbortedError(BscdError):
    """A job was ended at once because somebody asked; the message holds the reason they gave."""
