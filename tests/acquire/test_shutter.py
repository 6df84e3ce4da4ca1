"""An acquisition whose dark frames a shutter makes: nobody covers the lens."""

from labcdp.acquire import ShutterOperator, Unattended
from labcdp.drivers.shutter import SerialShutter
from labcdp.drivers.simulated.pty import PtyMeter
from labcdp.drivers.simulated.shutter import SimulatedShutter

from .conftest import Hands


def test_dark_frames_need_no_hand(changed, on_bench):
    with on_bench(changed(["P12"])) as on:
        moves = []

        def move(light):
            moves.append(light)
            (on.bench.uncover_lens if light else on.bench.cover_lens)()

        hands = Hands(on.bench)
        with PtyMeter(SimulatedShutter(move), response_time_s=0) as served, SerialShutter(served.port) as shutter:
            assert on.acquire(ShutterOperator(shutter, hands)) == ()
        assert moves == [1, 0, 1]
        assert hands.done == ["point_meter P12"]
        dark = [on.session.load(record).dn.mean() for record in on.session.frames("dark")]
        light = [on.session.load(record).dn.mean() for record in on.session.frames("light")]
        assert max(dark) < min(light)


def test_unattended_only_pointing_is_left(changed, on_bench):
    with on_bench(changed(["P12"])) as on:
        shutter = SimulatedShutter(lambda light: (on.bench.uncover_lens if light else on.bench.cover_lens)())
        left = on.acquire(ShutterOperator(shutter, Unattended()))
        assert [part.what for part in left] == ["readings P12"] or [part.hand for part in left] == [
            "point the luminance meter at each patch"
        ]
        assert on.session.frames("dark")
