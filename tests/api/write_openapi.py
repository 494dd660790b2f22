"""Write docs/openapi.json anew: python -m tests.api.write_openapi."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from bscd.api.app import create_app
from tests.api.test_schema import COMMITTED
from tests.daemon.small import small_daemon

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, small_daemon(Path(folder), connected=False, sensor_px=320) as opened:
        COMMITTED.write_text(json.dumps(create_app(opened).openapi(), indent=1) + "\n", encoding="utf-8")
