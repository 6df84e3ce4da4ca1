"""Aravis' library and its GObject typelib, of one installation or of two."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import gi

from labcdp.drivers.aravis.library import aravis_version

from ..conftest import opened


def test_the_driver_says_which_aravis_it_uses(aravis_tools):
    stated = subprocess.run(["arv-tool-0.8", "--version"], capture_output=True, text=True, check=True).stdout.split()[
        -1
    ]
    version, _, path = aravis_version().partition(" ")
    assert version == stated
    assert Path(path.strip("()")).exists()
    with opened() as camera:
        assert camera.driver == f"Aravis {version} {path}"


def test_a_typelib_of_another_version_than_the_library_is_one_line(aravis, tmp_path):
    path = gi.Repository.get_default().get_typelib_path("Aravis")
    typelib = bytearray(Path(path).read_bytes())
    # An enumeration value that the library lacks: after the offset of its name stands its number.
    entry = typelib.index(struct.pack("<I", typelib.index(b"\0wrong_packet_id\0") + 1))
    typelib[entry + 4 : entry + 8] = struct.pack("<i", 99)
    (tmp_path / "Aravis-0.8.typelib").write_bytes(typelib)
    code = "from labcdp.drivers import discover; discover()"
    environment = os.environ | {"GI_TYPELIB_PATH": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    line = ran.stderr.splitlines()[-1]
    assert "the GObject typelib of Aravis is of another version than its library, 0.8." in line
    assert "let GI_TYPELIB_PATH and LD_LIBRARY_PATH name folders of one installation, or neither" in line
