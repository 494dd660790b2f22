"""Workers for correlation: processes of this computer, or a Dask cluster; results do not depend on which."""

from bscd.dic.pool.cluster import DaskPool
from bscd.dic.pool.interface import LentImage, Pool, PoolClosedError, WorkerLostError
from bscd.dic.pool.local import LocalPool
from bscd.dic.pool.program import end_program, start_program
from bscd.dic.pool.shared import MemoryFullError, OwnImage, SharedImage

__all__ = [
    "DaskPool",
    "LentImage",
    "LocalPool",
    "MemoryFullError",
    "OwnImage",
    "Pool",
    "PoolClosedError",
    "SharedImage",
    "WorkerLostError",
    "end_program",
    "start_program",
]
