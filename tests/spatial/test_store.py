import json
from dataclasses import fields

import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.calibration.colour import ColourCalibration
from labcdp.calibration.dark_library import DarkLibrary
from labcdp.calibration.defects import Defect, DefectMap
from labcdp.calibration.store import calibration_schema, file_sha256, load_any
from labcdp.errors import InputError
from labcdp.vignetting import Cos4Vignetting, FlatField, RadialVignetting, middle_of

SHAPE = (48, 64)


def flat(seed=1):
    relative = 1 + 0.01 * np.random.default_rng(seed).normal(size=SHAPE)
    return FlatField(relative / relative[middle_of(SHAPE)].mean(), 0.001, 0.01, 8)


def defects():
    reasons = np.zeros(SHAPE, np.uint8)
    reasons[3, 4], reasons[5, 6] = Defect.HOT | Defect.NOISY, Defect.DEAD
    return DefectMap.of(reasons)


def library():
    rng = np.random.default_rng(2)
    covariance = ((0.1, 0.0), (0.0, 0.2))
    return DarkLibrary(rng.normal(size=SHAPE), rng.normal(size=SHAPE), covariance, covariance, 30.0, None, 20)


@pytest.fixture
def full(make_calibration):
    return make_calibration(vignetting=flat(), defects=defects(), dark_library=library())


@pytest.mark.parametrize(
    "vignetting", [None, Cos4Vignetting(0.006, 3.45e-6), RadialVignetting(-0.3, 0.1, 0.0, (30.0, 20.0)), flat()]
)
def test_round_trip_of_every_fall_off(make_calibration, tmp_path, vignetting):
    calibration = make_calibration(vignetting=vignetting)
    save(calibration, tmp_path / "c.json")
    loaded = load(tmp_path / "c.json")
    assert loaded == calibration
    assert type(loaded.vignetting) is type(vignetting)


def test_round_trip_with_all_arrays(full, tmp_path):
    save(full, tmp_path / "camera.json")
    loaded = load(tmp_path / "camera.json")
    assert loaded == full
    assert (loaded.vignetting.relative == full.vignetting.relative).all()
    assert not loaded.vignetting.relative.flags.writeable
    (beside,) = tmp_path.glob("*.npz")
    assert sorted(p.name for p in tmp_path.iterdir()) == [beside.name, "camera.json"]
    with np.load(beside, allow_pickle=False) as archive:
        assert (archive["relative_0"] == full.vignetting.relative).all()


def test_saving_again_takes_the_older_arrays_away(full, make_calibration, tmp_path):
    path = tmp_path / "camera.json"
    save(full, path)
    save(make_calibration(vignetting=flat(seed=7)), path)
    assert len(list(tmp_path.glob("*.npz"))) == 1
    assert load(path).vignetting == flat(seed=7)
    save(make_calibration(), path)
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


def test_saving_again_leaves_files_of_others_alone(full, make_calibration, tmp_path):
    path = tmp_path / "camera.json"
    save(full, path)
    document = json.loads(path.read_text())
    (tmp_path / "precious.npz").write_bytes(b"mine")
    document["arrays"]["file"] = "precious.npz"
    path.write_text(json.dumps(document))
    save(make_calibration(), path)
    assert (tmp_path / "precious.npz").read_bytes() == b"mine"


def test_a_save_that_is_cut_off_leaves_the_older_pair(full, make_calibration, tmp_path, monkeypatch):
    """The JSON text cannot be written once the arrays are: what was there before is still whole."""
    from labcdp.session import files

    path = tmp_path / "camera.json"
    save(full, path)
    write = files.write_whole

    def only_arrays(folder, name, data):
        if name.endswith(".json"):
            raise OSError(28, "No space left on device")
        return write(folder, name, data)

    monkeypatch.setattr(files, "write_whole", only_arrays)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        save(make_calibration(vignetting=flat(seed=7)), path)
    assert load(path) == full


def test_missing_arrays(full, tmp_path):
    save(full, tmp_path / "camera.json")
    next(tmp_path.glob("*.npz")).unlink()
    with pytest.raises(
        InputError,
        match=r"\.npz, which holds the arrays of calibration camera\.json, cannot be read .*: copy both files",
    ):
        load(tmp_path / "camera.json")


def test_altered_arrays(full, tmp_path):
    save(full, tmp_path / "camera.json")
    beside = next(tmp_path.glob("*.npz"))
    data = bytearray(beside.read_bytes())
    data[-1] ^= 1
    beside.write_bytes(data)
    with pytest.raises(InputError, match=r"\.npz, which holds the arrays .*, was changed after it was written"):
        load(tmp_path / "camera.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"file": "../c.npz"}, "key arrays: it names no file beside it"),
        ({"sha256": None}, "key arrays: it names no file beside it"),
    ],
)
def test_files_elsewhere_are_not_read(full, tmp_path, change, message):
    path = tmp_path / "camera.json"
    save(full, path)
    document = json.loads(path.read_text())
    document["arrays"] |= change
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        load(path)


def test_arrays_cannot_be_swapped_by_hand(full, tmp_path):
    path = tmp_path / "camera.json"
    save(full, path)
    document = json.loads(path.read_text())
    library = document["calibration"]["dark_library"]
    library["offset_dn"], library["rate_dn_s"] = library["rate_dn_s"], library["offset_dn"]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="was changed after it was written"):
        load(path)


def test_an_array_that_is_not_there(full, tmp_path):
    path = tmp_path / "camera.json"
    save(full, path)
    document = json.loads(path.read_text())
    document["calibration"]["vignetting"]["relative"]["array"] = "other"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="there is no array 'other' in the file beside it"):
        load(path)


def test_colour_calibrations_are_of_another_kind(make_calibration, tmp_path):
    planes = tuple(make_calibration(vignetting=flat(seed), defects=defects()) for seed in range(4))
    values = dict.fromkeys((f.name for f in fields(ColourCalibration)), ())
    values |= {"planes": planes, "weights": (0.2, 0.35, 0.35, 0.1), "weight_covariance": ((0.0,) * 4,) * 4}
    values |= {"spectral_rel": 0.0, "scatter_rel": 0.0, "range_cd_m2": (0.5, 2000.0)}
    values |= {"sensitivity": None, "f1_prime": None}
    colour = ColourCalibration(**values)
    save(colour, tmp_path / "colour.json")
    assert load_any(tmp_path / "colour.json") == colour
    with pytest.raises(InputError, match="is for a colour camera: give one of a monochrome camera"):
        load(tmp_path / "colour.json")


def test_an_unknown_kind(full, tmp_path):
    path = tmp_path / "camera.json"
    save(full, path)
    document = json.loads(path.read_text())
    document["kind"] = "thermal"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="has kind 'thermal': this labcdp knows monochrome, colour"):
        load(path)


def test_the_hash_tells_files_apart(full, make_calibration, tmp_path):
    for name, calibration in (("a", full), ("b", make_calibration()), ("c", full)):
        save(calibration, tmp_path / f"{name}.json")
    a, b = (file_sha256(tmp_path / f"{name}.json") for name in "ab")
    assert a != b
    assert len(a) == 64


def conforms(value, schema, root):
    """Validate the keywords that pydantic's schemas of these types use."""
    if "$ref" in schema:
        return conforms(value, root["$defs"][schema["$ref"].rsplit("/", 1)[1]], root)
    if "anyOf" in schema:
        return any(conforms(value, one, root) for one in schema["anyOf"])
    if "const" in schema and value != schema["const"]:
        return False
    if "prefixItems" in schema:
        items = schema["prefixItems"]
        return len(value) == len(items) and all(conforms(v, s, root) for v, s in zip(value, items, strict=True))
    types = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None)}
    types["boolean"] = bool
    if "type" in schema and not isinstance(value, types[schema["type"]]):
        return False
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        return set(schema.get("required", ())) <= set(value) and all(
            conforms(v, properties.get(k, schema.get("additionalProperties") or {}), root) for k, v in value.items()
        )
    if isinstance(value, list):
        return all(conforms(v, schema.get("items", {}), root) for v in value)
    return True


def test_files_conform_to_the_schema(full, tmp_path):
    save(full, tmp_path / "camera.json")
    document, schema = json.loads((tmp_path / "camera.json").read_text()), calibration_schema()
    assert conforms(document, schema, schema)
    document["calibration"]["lens"]["f_number"] = "wide"
    assert not conforms(document, schema, schema)
    assert schema["properties"]["version"] == {"const": 2}
    assert "weights" in calibration_schema("colour")["properties"]["calibration"]["properties"]
