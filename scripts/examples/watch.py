#!/usr/bin/env python3
"""Watch a rig with asyncio: a line for each job that ends, and a picture of the primary camera beside it.

Usage: scripts/examples/watch.py [--jobs 1] [--folder .] [--url http://127.0.0.1:8080]
"""

from __future__ import annotations

import argparse
import asyncio
from contextlib import suppress
from pathlib import Path

import bscd
from bscd.daemon.errors import UnknownNameError


async def watch(url: str, jobs: int, folder: Path) -> None:
    """Follow whatever is on the bench, so many times."""
    async with bscd.AsyncClient(url) as rig:
        seen: set[str] = set()
        while len(seen) < jobs:
            now = (await rig.status()).job
            if now is None or now.id in seen:
                await asyncio.sleep(0.1)
                continue
            async for job in rig.follow(now.id):
                if job.status.ended:
                    print(f"{job.id}: {job.recipe.recipe} {job.status.value} {job.reason}".rstrip(), flush=True)
            seen.add(now.id)
            with suppress(UnknownNameError):  # it may have taken no picture yet
                (folder / f"{now.id}.jpg").write_bytes(await rig.snapshot())


def main() -> None:
    """Read the arguments and watch."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="how many")
    parser.add_argument("--folder", type=Path, default=Path("."), help="where pictures go")
    parser.add_argument("--url", default="http://127.0.0.1:8080")
    given = parser.parse_args()
    asyncio.run(watch(given.url, given.jobs, given.folder))


if __name__ == "__main__":
    main()
