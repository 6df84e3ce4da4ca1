import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from labcdp.chain import Capture, Chain, Context, Level, Signal, Windscreen, register, registry
from labcdp.core.errors import ConfigurationError, InputError

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(autouse=True)
def own_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers is gone after it."""
    monkeypatch.setattr(registry, "_CLASSES", {table: dict(types) for table, types in registry._CLASSES.items()})


@dataclass(frozen=True)
class Dimmer:
    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    factor: float = 0.5

    def __post_init__(self) -> None:
        if self.factor <= 0:
            raise InputError(f"factor is {self.factor}: give a number above 0")

    def process(self, signal: Signal, context: Context) -> Signal:
        return replace(
            signal,
            values=signal.values * self.factor,
            to_luminance=lambda values: signal.to_luminance(values / self.factor),
        )


@dataclass(frozen=True)
class Inverter:
    """A stage behind the sensor."""

    takes: ClassVar[str] = "digital number"
    gives: ClassVar[str] = "digital number"

    top_dn: int = 1000

    def process(self, signal: Signal, context: Context) -> Signal:
        return replace(
            signal,
            values=self.top_dn - signal.values,
            to_luminance=lambda values: signal.to_luminance(self.top_dn - values),
        )


@dataclass(frozen=True)
class Ruler:
    """Sensor without noise: 100 DN per lx s."""

    width: int
    height: int
    pixel_pitch_m: float = 1e-6

    @property
    def shape(self) -> tuple[int, int]:
        return self.height, self.width

    def capture(self, signal: Signal, context: Context, index: int) -> Capture:
        assert context.settings is not None
        time = context.settings.exposure_s[index]
        return Capture(signal.values * (100 * time), time, 0.0, 0.0, 100 * time, 1e6, 1.0, 0.0)


@dataclass(frozen=True)
class Ramp:
    """Scene that rises from left to right."""

    width: int
    height: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.height, self.width

    def luminance_map(self) -> np.ndarray:
        return np.broadcast_to(np.arange(1, self.width + 1, dtype=np.float32), self.shape)

    def regions(self) -> Mapping[str, np.ndarray]:
        return {}

    def levels(self) -> Sequence[Level]:
        return ()

    def pairs(self) -> Sequence[tuple[str, str]]:
        return ()


CHAIN = """
[scene]
type = "ramp"
width = 6
height = 4
[windscreen]
transmittance = 0.5
glare_fraction = 0.3
glare_subtracted = true
[dimmer]
factor = 0.25
[optics]
f_number = 1.0
transmittance = 1.0
[exposure]
exposure_s = [0.1, 1.0]
[sensor]
type = "ruler"
[hdr]
method = "linear"
[inverter]
[isp]
"""


@pytest.fixture
def own_parts(own_registry: None) -> None:
    register("scene", Ramp, "ramp")
    register("sensor", Ruler, "ruler")
    register("dimmer", Dimmer)
    register("inverter", Inverter)


@pytest.mark.usefixtures("own_parts")
def test_own_scene_stages_and_sensor_make_a_chain() -> None:
    run = Chain.from_toml(CHAIN, "own.toml").run()
    assert list(run) == [
        *("scene", "windscreen", "dimmer", "optics", "sensor 100 ms", "sensor 1000 ms", "hdr", "inverter", "isp")
    ]
    scene = np.tile(np.arange(1.0, 7.0), (4, 1))
    expected_dn = 100 * np.pi / 4 * 0.25 * 0.5 * (scene + 0.3 * 3.5)
    np.testing.assert_allclose(run["sensor 1000 ms"].values, expected_dn, rtol=1e-6)
    np.testing.assert_allclose(run["inverter"].values, 1000 - expected_dn, rtol=1e-6)
    for name in ("dimmer", "optics", "sensor 100 ms", "sensor 1000 ms", "hdr", "inverter"):
        np.testing.assert_allclose(run[name].luminance_cd_m2, scene, rtol=1e-4)


@pytest.mark.usefixtures("own_parts")
def test_own_stage_in_the_wrong_place_is_refused() -> None:
    text = CHAIN.replace("[inverter]\n", "").replace("[optics]", "[inverter]\n[optics]")
    with pytest.raises(
        ConfigurationError, match=r"inverter takes digital number in DN, but what comes to it is luminanc"
    ):
        Chain.from_toml(text, "own.toml")


@pytest.mark.usefixtures("own_parts")
def test_stage_behind_the_sensor_hands_on_what_it_gives() -> None:
    @dataclass(frozen=True)
    class ToLuminance:
        takes: ClassVar[str] = "digital number"
        gives: ClassVar[str] = "luminance"

        def process(self, signal: Signal, context: Context) -> Signal:
            return replace(
                signal, values=signal.luminance_cd_m2, quantity="luminance", to_luminance=lambda luminance: luminance
            )

    register("to_luminance", ToLuminance)
    text = CHAIN.replace("[inverter]\n", "").replace("[isp]\n", "[to_luminance]\n")
    run = Chain.from_toml(text, "own.toml").run()
    assert run["to_luminance"].unit == "cd/m^2"
    np.testing.assert_allclose(run["to_luminance"].values, run["scene"].values, rtol=1e-4)
    with pytest.raises(
        ConfigurationError, match=r"isp takes digital number in DN, but what comes to it is luminance in"
    ):
        Chain.from_toml(text + "[isp]\n", "own.toml")


@dataclass(frozen=True)
class Nothing:
    width: int = 1


@pytest.mark.usefixtures("own_parts")
@pytest.mark.parametrize(
    ("table", "type_name", "old", "new", "message"),
    [
        (
            "nothing",
            "standard",
            "[dimmer]\nfactor = 0.25",
            "[nothing]",
            "nothing is registered as Nothing, which is no st",
        ),
        ("sensor", "nothing", '"ruler"', '"nothing"', "sensor is registered as Nothing, which is no sensor model"),
        (
            "scene",
            "nothing",
            '"ramp"\nwidth = 6\nheight = 4',
            '"nothing"',
            "scene is registered as Nothing, which is no",
        ),
    ],
)
def test_class_that_is_not_a_such_part_is_refused(table: str, type_name: str, old: str, new: str, message: str) -> None:
    register(table, Nothing, type_name)
    with pytest.raises(ConfigurationError, match=message):
        Chain.from_toml(CHAIN.replace(old, new), "own.toml")


def test_a_type_belongs_to_one_class() -> None:
    register("windscreen", Windscreen)
    with pytest.raises(
        InputError, match=r"^the type 'standard' of windscreen is Windscreen already: give another name$"
    ):
        register("windscreen", Dimmer)
    register("windscreen", Dimmer, "dimmer")
    assert registry.class_of("windscreen", "dimmer") is Dimmer
    assert registry.class_of("windscreen", None) is Windscreen


MODULE = """
from dataclasses import dataclass
from typing import ClassVar
from labcdp.chain import Chain, register

@dataclass(frozen=True)
class Filter:
    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    def process(self, signal, context):
        return signal

register("filter", Filter)
register("windscreen", Filter, "filter")
"""


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, module: str, text: str) -> None:
    """Lay a package with an entry point beside the installed ones."""
    (folder / f"{module}.py").write_text(text, encoding="utf-8")
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[labcdp.chain]\nfilter = {module}\n", encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, module)


FILTER_CHAIN = '[scene]\ntype = "flat"\nwidth = 1\nheight = 1\nluminance_cd_m2 = 1\n'


@pytest.mark.parametrize("table", ["[filter]\n", '[windscreen]\ntype = "filter"\n'])
def test_installed_package_makes_its_parts_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: str) -> None:
    install(tmp_path, monkeypatch, "some_filter", MODULE)
    run = Chain.from_toml(FILTER_CHAIN + table, "own.toml").run()
    assert len(run) == 2


def blocks(page: str, language: str) -> list[str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def test_chain_file_of_the_documentation_runs() -> None:
    run = Chain.from_toml(blocks("reference/chain-files.md", "toml")[0], "example.toml").run()
    assert list(run)[-2:] == ["hdr", "isp"]


def test_program_of_the_documentation_runs() -> None:
    names: dict[str, Any] = {"__name__": "docs_chain"}
    for page in ("howto/choose-a-sensor.md", "howto/own-stage.md"):
        for block in blocks(page, "python"):
            exec(compile(block, page, "exec"), names)
    assert names["luminance"].shape == (420, 301)
    text = FILTER_CHAIN + (
        "[haze]\ntransmittance = 0.5\nluminance_cd_m2 = 3.0\n"
        "[optics]\nf_number = 0.5\ntransmittance = 1.0\n"
        "[exposure]\nexposure_s = 1.0\n"
        '[sensor]\ntype = "perfect"\npixel_pitch_m = 1e-6\ndn_per_lx_s = 1e4\n'
    )
    run = Chain.from_toml(text, "haze.toml").run()
    assert run["haze"].values == pytest.approx(0.5 * 1 + 0.5 * 3)
    assert run["sensor"].luminance_cd_m2 == pytest.approx(1, abs=1e-3)


def test_documentation_names_every_table_and_type() -> None:
    text = (DOCS / "reference/chain-files.md").read_text(encoding="utf-8")
    for table, types in registry._CLASSES.items():
        assert f"| `{table}` |" in text
        assert all(f"`{type_name}`" in text for type_name in types)


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ("[filter]\n", "filter is not known"),
        ('[windscreen]\ntype = "x"\n', r"windscreen\.type is 'x', which is not known"),
    ],
)
def test_package_that_cannot_be_imported_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: str, reason: str
) -> None:
    install(tmp_path, monkeypatch, "broken_filter", "import not_there_at_all\n")
    message = (
        rf"^own.toml: {reason}, and the entry point 'broken_filter' of labcdp\.chain cannot be loaded "
        r"\(No module named 'not_there_at_all'\): repair or remove its package$"
    )
    with pytest.raises(ConfigurationError, match=message):
        Chain.from_toml(FILTER_CHAIN + table, "own.toml")
