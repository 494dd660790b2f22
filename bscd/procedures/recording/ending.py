"""How an inflation ends, whatever ended it: vented, the stream stopped, the axes at rest."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from bscd.errors import BscdError
from bscd.procedures.recording.signals import HeldSignals
from bscd.procedures.rig import Rig, gather_failures


class NotVentedError(BscdError):
    """The pressure could not be let out at the end; somebody has to open the valve by hand."""


@contextmanager
def safe_ending(rig: Rig) -> Iterator[None]:
    """Vent first, then stop stream and axes; each is done whatever the others do, and no signal cuts it short.

    Raises `NotVentedError` when the vent failed, with what ended the block before it; a stream that would not stop
    hides no other error. In the main thread a signal that would kill the program ends the block instead, and the
    program after it (`EndedBySignal`).
    """
    ended_by: BaseException | None = None
    with HeldSignals() as signals:
        try:
            yield
        except BaseException as error:
            ended_by = error
            raise
        finally:
            signals.hold()
            vent = {} if rig.pressure is None else {"pressure": rig.pressure.vent}
            unsafe = gather_failures(vent)
            rest = gather_failures({"primary": rig.primary.stop})
            rig.stop_axes()
            if unsafe:
                signals.forget()
                before = f"{ended_by}; and then: " if ended_by is not None else ""
                told = f"{before}the pressure could not be vented, open the valve by hand: {unsafe['pressure']}"
                raise NotVentedError(told) from ended_by
            if rest and ended_by is None:
                raise rest["primary"]
