"""Share the rows of an image among threads: kernels release the GIL, so no numba threading layer is needed."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

#: Below this many items one thread is quicker than starting several.
SMALL = 4096


def run_in_bands(count: int, work: Callable[[int, int], None], *, small: int = SMALL) -> None:
    """Call ``work(first, last)`` over ``range(count)`` cut into bands, one or more a core, and wait for all.

    ``work`` must release the GIL and write to its own rows only. Numba's workqueue layer aborts the process when
    two threads enter it; bands of our own may run beside any other kernel.
    """
    cores = os.cpu_count() or 1
    if count <= small or cores == 1:
        work(0, count)
        return
    parts = 4 * cores
    bounds = [count * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(cores, thread_name_prefix="twin-band") as pool:
        for future in [pool.submit(work, first, last) for first, last in pairwise(bounds)]:
            future.result()
