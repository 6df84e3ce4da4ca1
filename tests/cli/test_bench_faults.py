"""Faults typed at `labcdp simulate-bench`, and those of a file."""

import serial

from labcdp.session import example_session

BENCH = ("simulate-bench", example_session() / "session.toml")


def say(bench, line):
    bench.stdin.write(line + "\n")
    bench.stdin.flush()
    return bench.stderr.readline().strip()


def test_typed_faults_befall_the_devices(running_bench):
    bench, told = running_bench()
    assert say(bench, "light -10%").startswith("Lens open; meter points at P01; light 90.0%, camera at 35.0 degrees")
    assert say(bench, "temperature +5 C").endswith("camera at 40.0 degrees Celsius")
    assert say(bench, "show P07").startswith("Lens open; meter points at P07")
    assert say(bench, "lose 5") == "'lose 5' is not a known fault: write for example 'lose 5% for 20 s'"
    assert "vanish for 5 s | " in say(bench, "help")
    assert say(bench, "meter ER30").startswith("Lens open")
    with serial.Serial(told["meter"]["port"], 4800, bytesize=7, parity="E", stopbits=2, timeout=300) as port:
        port.write(b"MES\r\n")
        assert port.readline() == b"ER30\r\n"
    bench.stdin.write("vanish for 1 h\nquit\n")
    bench.stdin.flush()
    assert bench.wait(300) == 0


def test_a_file_of_faults_is_read_before_anything_starts(tmp_path, labcdp):
    wrong = tmp_path / "night.txt"
    wrong.write_text("at 1 s stall for 1 s\nat 5 min vanisch\n")
    done = labcdp(*BENCH, "--faults", wrong)
    assert done.returncode == 1
    assert f"{wrong}, line 2: 'vanisch' is not a known fault: write for example 'vanish for 5 s'" in done.stderr
    absent = labcdp(*BENCH, "--faults", tmp_path / "absent.txt")
    assert absent.returncode == 1
    assert "absent.txt cannot be read" in absent.stderr
