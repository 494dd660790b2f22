"""The one place where a line's errors become the drivers' errors, with the device's name and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.errors import DeviceBusyError, DeviceTimeoutError, NotConnectedError, ProtocolError, UnsupportedError
from drivers.stages.line import BadAnswerError, LineLostError, LineTakenError, NoAnswerError, RefusedError


@contextmanager
def told(device: str, doing: str, on_loss: Callable[[], None]) -> Iterator[None]:
    """Raise what goes wrong inside as an error of `drivers.errors`; ``on_loss`` is called when the line is gone."""
    try:
        yield
    except LineTakenError as err:
        on_loss()
        raise DeviceBusyError(device, f"{doing}: {err}", "close the other program, then connect again") from err
    except LineLostError as err:
        on_loss()
        hint = "check its power, its cable and its port, then connect again"
        raise NotConnectedError(device, f"{doing}: {err}", hint) from err
    except NoAnswerError as err:
        raise DeviceTimeoutError(device, f"{doing}: {err}", "check its power and its cable") from err
    except BadAnswerError as err:
        raise ProtocolError(device, f"{doing}: {err}", "check the cable, the port and its settings") from err
    except RefusedError as err:
        raise UnsupportedError(device, f"{doing}: {err}", "compare its options with the device") from err
