"""`bscd serve`: the daemon that owns the rig, with its API, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import structlog
import typer

from bscd.errors import BscdError, InputError
from drivers.errors import DeviceError

if TYPE_CHECKING:
    from bscd.api.server import Served
    from bscd.daemon.daemon import Daemon

DEFAULT_CONFIG = Path(__file__).resolve().parents[2] / "config/twin.toml"

#: A thread that waits for the interpreter gets it so soon: requests are answered while others compute.
_SWITCH_S = 0.0005

_LOG = structlog.get_logger(__name__)


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command(name="serve")
    def serve_rig(
        config: Annotated[Path, typer.Option(help="The rig; the built-in twin without it.")] = DEFAULT_CONFIG,
        data: Annotated[
            Path | None, typer.Option(help="Data folder; default: [daemon] data_folder, beside the configuration.")
        ] = None,
        port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port; default: [daemon] port.")] = None,
        emulate: Annotated[
            bool, typer.Option(help="Put the twin behind its wire protocols and drive it with the real drivers.")
        ] = False,
        connect: Annotated[
            bool, typer.Option(help="Connect the rig at once; nothing moves, the pressure is vented.")
        ] = True,
        attended: Annotated[
            bool | None, typer.Option(help="Whether an operator confirms; default: unless the rig is the twin.")
        ] = None,
        json_logs: Annotated[
            bool | None, typer.Option(help="Logs as JSON lines; default: unless it is a terminal.")
        ] = None,
    ) -> None:
        """Serve the rig: jobs by REST, events, live pictures, the e-stop. After a start nothing moves by itself.

        Example: bscd serve --config rig.toml
        """
        from bscd.api.server import require_safe, serve  # loads half a second long: bscd --help need not wait for it
        from bscd.daemon.daemon import open_daemon
        from bscd.daemon.logs import configure_logs

        configure_logs(json=json_logs)
        sys.setswitchinterval(_SWITCH_S)
        given = {"data_folder": None if data is None else str(data.absolute()), "port": port}
        changes = {name: value for name, value in given.items() if value is not None}
        with open_daemon(config, emulate=emulate, attended=attended, **changes) as daemon:
            require_safe(daemon)
            connecting = threading.Thread(target=_connect, args=(daemon,), name="connecting", daemon=True)

            def ready(served: Served) -> None:
                typer.echo(f"{served.url}: {daemon.config.rig.name}, data in {daemon.files.root}")
                typer.echo(f"{served.estop_url}: the e-stop's own address")
                if connect:
                    connecting.start()

            serve(daemon, ready)
            if connecting.ident is not None:
                connecting.join(30.0)


def _connect(daemon: Daemon) -> None:
    try:
        daemon.connect("bscd serve")
    except (BscdError, DeviceError, InputError) as error:
        _LOG.warning("the rig is not connected", error=str(error))
