"""Shared memory that runs out is told before it is written to: writing would end the process."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

from bscd.dic.pool import MemoryFullError, SharedImage

FILLING = """
import numpy as np
from bscd.dic.pool import MemoryFullError, SharedImage
image, held = np.ones((1000, 1000), np.uint8), []
try:
    while len(held) < 100:
        held.append(SharedImage.holding(image))
except MemoryFullError as error:
    print(len(held), error)
for one in held:
    one.release()
print(SharedImage.holding(image).read().sum())
"""


def test_a_full_one_is_told_and_can_be_used_when_there_is_room_again():
    mounted = "mount -t tmpfs -o size=10m tmpfs /dev/shm"
    if subprocess.run(["unshare", "-rm", "sh", "-c", mounted], capture_output=True).returncode:
        pytest.skip("the system lets nobody mount a small /dev/shm")
    told = subprocess.run(
        ["unshare", "-rm", "sh", "-c", f'{mounted} && exec "$@"', "sh", sys.executable, "-c", FILLING],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert told.returncode == 0, told.stderr
    full, again = told.stdout.splitlines()
    assert 3 <= int(full.split()[0]) <= 6  # some room is left to others
    assert "has no room for an image of 1.0 MB; remove what is left there" in full
    assert again == "1000000"


def test_room_can_be_left_to_others():
    image = np.zeros((64, 64), np.uint8)
    with pytest.raises(MemoryFullError, match="has no room for an image"):
        SharedImage.holding(image, leave_bytes=shutil.disk_usage("/dev/shm").free)
    shared = SharedImage.holding(image, leave_bytes=shutil.disk_usage("/dev/shm").free // 2)
    shared.release()


def test_an_image_is_what_was_put_in():
    image = np.arange(24, dtype=np.uint16).reshape(4, 6)
    shared = SharedImage.holding(image)
    try:
        assert shared.nbytes == 48
        assert (shared.read() == image).all()
    finally:
        shared.release()
