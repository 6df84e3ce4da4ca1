"""What all tests share: a network of their own, so that they neither reach nor disturb real cameras."""

import ctypes
import os
import shutil
import subprocess

import hypothesis
import pytest

_CLONE_NEWNET = 0x40000000

# Tests do not depend on how busy the computer is.
hypothesis.settings.register_profile("labcdp", deadline=None)
hypothesis.settings.load_profile("labcdp")


def _may_have_a_network_of_its_own() -> bool:
    return os.geteuid() == 0 and shutil.which("ip") is not None


def pytest_xdist_auto_num_workers() -> int:
    """As many processes as processors, but one where all would share the port of the simulated camera."""
    return os.cpu_count() or 1 if _may_have_a_network_of_its_own() else 1


def pytest_configure() -> None:
    """Move the test process into a network namespace with nothing but loopback, where that is allowed."""
    # The call moves the calling thread only, and those it will start.
    if _may_have_a_network_of_its_own() and ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET) == 0:
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        subprocess.run(["ip", "addr", "add", "127.0.0.2/8", "dev", "lo"], check=True)


@pytest.fixture(scope="session")
def aravis():
    """Aravis, or skip."""
    gi = pytest.importorskip("gi", reason="PyGObject (python3-gi) is not installed")
    try:
        gi.require_version("Aravis", "0.8")
    except ValueError:
        pytest.skip("Aravis (gir1.2-aravis-0.8) is not installed")
    from gi.repository import Aravis

    return Aravis


@pytest.fixture(scope="session")
def aravis_tools(aravis):
    """Debian's command line programs of Aravis, or skip."""
    for name, package in (("arv-tool-0.8", "aravis-tools-cli"), ("arv-camera-test-0.8", "aravis-tools")):
        if shutil.which(name) is None:
            pytest.skip(f"{name} ({package}) is not installed")


@pytest.fixture(scope="session")
def small_configuration():
    """Bench of the example session: 16 patches on 480 x 400 pixels."""
    from labcdp.session import SessionConfiguration, example_session

    return SessionConfiguration.load(example_session() / "session.toml")
