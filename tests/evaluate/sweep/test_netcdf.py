"""Datasets as NetCDF files: what is written is read again, and damage is an error that says so."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labcdp.core.errors import InputError
from labcdp.report.files import dataset_bytes, read_dataset


def save(dataset: xr.Dataset, path: Path) -> None:
    path.write_bytes(dataset_bytes(dataset, "map"))


@pytest.fixture
def dataset() -> xr.Dataset:
    rng = np.random.default_rng(0)
    axes = ("scene.luminance_cd_m2", "stage")
    cdp = np.where(np.arange(600) == 10, np.nan, rng.random(600)).reshape(200, 3)
    data = {"cdp": (axes, cdp, {"long_name": "CDP", "unit": "1"}), "snr_dark": (axes, cdp * np.inf)}
    luminance = (axes[0], np.geomspace(0.1, 1e4, 200), {"unit": "cd/m^2"})
    attributes = {"title": "Ein Füllstand", "contrast": np.nan, "seed": 7, "chain": '[scene]\nname = "ü"\n'}
    counts = {"n_pixels": (axes, rng.integers(0, 9, (200, 3)))}
    return xr.Dataset(data | counts, {axes[0]: luminance, axes[1]: ["sensor", "hdr", "köln"]}, attributes)


def test_round_trip_is_identical(dataset: xr.Dataset, tmp_path: Path) -> None:
    save(dataset, tmp_path / "map.nc")
    read = read_dataset(tmp_path / "map.nc", "map")
    xr.testing.assert_identical(read, dataset)
    assert read["stage"].dtype == dataset["stage"].dtype
    assert [path.name for path in tmp_path.iterdir()] == ["map.nc"]


def test_an_altered_byte_of_the_data_is_noticed(tmp_path: Path) -> None:
    cdp = np.random.default_rng(0).random(20_000)
    save(xr.Dataset({"cdp": ("gain", cdp)}, coords={"gain": np.arange(20_000.0)}), tmp_path / "map.nc")
    data = bytearray((tmp_path / "map.nc").read_bytes())
    data[data.index(b"\x78\x5e") + 1000] ^= 1  # in the first stream of zlib at this level
    (tmp_path / "map.nc").write_bytes(data)
    with pytest.raises(InputError, match=r"map\.nc is damaged or no NetCDF file \(.+\): restore it from a copy"):
        read_dataset(tmp_path / "map.nc", "map")


@pytest.mark.parametrize("content", [b"", b"CDP;0.5\n", b"\x89HDF\r\n\x1a\n" + bytes(500), None])
def test_foreign_and_cut_files_are_refused(content: bytes | None, dataset: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "map.nc"
    path.write_bytes(dataset_bytes(dataset, "map")[:5000] if content is None else content)
    with pytest.raises(InputError, match=r"map\.nc is damaged or no NetCDF file|map\.nc is no NetCDF file"):
        read_dataset(path, "map")
