"""What `import bscd` gives, and what it costs."""

import subprocess
import sys

import pytest

import bscd
import bscd.client
import bscd.offline
from bscd.version import __version__

CLIENTS = {"Client", "AsyncClient"}


@pytest.mark.parametrize("name", [name for name in bscd.__all__ if name != "__version__"])
def test_the_names_are_those_of_the_offline_package_and_the_client(name):
    assert getattr(bscd, name) is getattr(bscd.client if name in CLIENTS else bscd.offline, name)
    assert name in dir(bscd)


def test_other_names_are_no_attributes():
    assert bscd.__version__ == __version__
    with pytest.raises(AttributeError, match="module 'bscd' has no attribute 'meassure'"):
        bscd.meassure  # noqa: B018 - the access is what is tested


def test_importing_it_loads_no_library():
    script = (
        "import bscd, sys; print([n for n in ('numpy', 'scipy', 'h5py', 'cv2', 'pandas', 'httpx') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"
