"""Datasets as NetCDF files: what is written is read again, and damage is an error that says so."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labcdp.core.errors import InputError
from labcdp.report.files import dataset_bytes, read_dataset


def test_what_is_written_is_read_again_and_damage_is_noticed(tmp_path: Path) -> None:
    axes = ("scene.luminance_cd_m2", "stage")
    cdp = np.where(np.arange(600) == 10, np.nan, np.random.default_rng(0).random(600)).reshape(200, 3)
    data = {"cdp": (axes, cdp, {"long_name": "CDP", "unit": "1"}), "snr_dark": (axes, cdp * np.inf)}
    luminance = (axes[0], np.geomspace(0.1, 1e4, 200), {"unit": "cd/m^2"})
    attributes = {"title": "Ein Füllstand", "contrast": np.nan, "seed": 7, "chain": '[scene]\nname = "ü"\n'}
    dataset = xr.Dataset(data, {axes[0]: luminance, axes[1]: ["sensor", "hdr", "köln"]}, attributes)
    path, whole = tmp_path / "map.nc", dataset_bytes(dataset, "map")
    path.write_bytes(whole)
    xr.testing.assert_identical(read_dataset(path, "map"), dataset)
    altered = bytearray(whole)
    altered[whole.index(b"\x78\x5e") + 1000] ^= 1  # in the first stream of zlib at this level
    for content in (b"CDP;0.5\n", whole[:5000], altered):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"map\.nc is (damaged or no|no) NetCDF file"):
            read_dataset(path, "map")
