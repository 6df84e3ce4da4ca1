"""Ways to damage a file: single bits, cuts, splices, and numbers and structure of text."""

import json
import random
import re
from collections.abc import Callable
from typing import Any

Damage = Callable[[bytes, random.Random], bytes]

INTEGERS = (0, 1, -1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
#: What stands in the place of a number, a text or any other value of a document.
TOKENS = (
    "0", "-1", "1e308", "-1e308", "1e-300", "1e999", "NaN", "nan", "inf", "Infinity", "9" * 30, "1" + "0" * 400,
    "7" * 5000, "1.5", "true", "null", '""', '"x"', '"' + "a" * 300 + '"', '"a\\u0000b"', '"\\u001b[31mred"', "[]",
    "{}", "[[[[0]]]]", "[" * 200 + "]" * 200, "[" * 100_000, '{"a":' * 3000, "1e5", "2026-01-01", "''", "\x1b[2J",
)  # fmt: skip
#: Larger inputs take time and say nothing more.
MOST_BYTES = 10_000_000
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TEXT = re.compile(rb'"(?:[^"\\\n]|\\.)*"')


def flip_bits(data: bytes, rng: random.Random) -> bytes:
    """Flip one to eight bits."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def set_bytes(data: bytes, rng: random.Random) -> bytes:
    """Put other bytes in the place of up to sixteen."""
    at, n = rng.randrange(len(data)), rng.choice((1, 2, 4, 16))
    filling = rng.choice((b"\0" * n, b"\xff" * n, rng.randbytes(n)))
    return data[:at] + filling + data[at + n :]


def set_integer(data: bytes, rng: random.Random) -> bytes:
    """Put an extreme integer somewhere, in either byte order."""
    size = rng.choice((1, 2, 4, 8))
    value = rng.choice(INTEGERS) % 256**size
    at = rng.randrange(max(len(data) - size, 1))
    # Headers are where it matters.
    at = min(at, rng.choice((64, 512, len(data))))
    return data[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + data[at + size :]


def cut(data: bytes, rng: random.Random) -> bytes:
    """End somewhere."""
    return data[: rng.randrange(len(data))]


def splice(data: bytes, rng: random.Random) -> bytes:
    """Remove a part, repeat it, or put it elsewhere."""
    start, end = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    part, at = data[start:end], rng.randrange(len(data) + 1)
    if rng.random() < 0.3:
        return data[:start] + data[end:]
    if rng.random() < 0.3:
        return data[:at] + part[:64] * rng.choice((2, 50, 2000)) + data[at:]
    return data[:at] + part + data[at:]


def replace_token(data: bytes, rng: random.Random) -> bytes:
    """Put something else in the place of a number or a text."""
    found = list(rng.choice((NUMBER, NUMBER, TEXT)).finditer(data))
    if not found:
        return set_bytes(data, rng)
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(TOKENS).encode() + data[one.end() :]


def change_lines(data: bytes, rng: random.Random) -> bytes:
    """Remove, repeat, exchange or shorten lines."""
    lines = data.splitlines(keepends=True)
    at = rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = [lines[at]] * min(rng.choice((1, 3, 3000)), 1 + MOST_BYTES // max(1, len(lines[at])))
    elif kind == 2:
        other = rng.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        lines[at] = lines[at][: rng.randrange(len(lines[at]) + 1)]
    else:
        lines[at] = lines[at].replace(rng.choice((b",", b";", b"=", b" ", b'"', b".")), rng.choice((b"", b",,", b"\t")))
    return b"".join(lines)


def change_document(data: bytes, rng: random.Random) -> bytes:
    """Change a value, a key or the order within a JSON document; of JSON lines, one of them."""
    lines = data.split(b"\n")
    at = rng.choice([n for n, line in enumerate(lines) if line.strip()] or [0])
    whole = data.lstrip().startswith(b"{") and not lines[0].rstrip().endswith(b"}")
    try:
        document = json.loads(data if whole else lines[at])
        _change(document, rng)
        text = json.dumps(document).encode()
    except (ValueError, RecursionError):
        return replace_token(data, rng)
    return text if whole else b"\n".join([*lines[:at], text, *lines[at + 1 :]])


def _change(value: Any, rng: random.Random) -> None:
    while isinstance(value, dict | list) and value:
        key: Any = rng.choice(list(value)) if isinstance(value, dict) else rng.randrange(len(value))
        if isinstance(value[key], dict | list) and value[key] and rng.random() < 0.8:
            value = value[key]
            continue
        others = (None, -1, 0, 1e308, 1e-300, 1.5, True, "", "x" * 300, "\x1b[0m", [], {}, [[0]], 10**30, value)
        kind = rng.randrange(4)
        if kind == 0:
            del value[key]
        elif kind == 1 and isinstance(value, dict):
            value["unknown"] = rng.choice(others[:-1])
        elif kind == 2 and isinstance(value, list):
            value.append(value[key])
        else:
            value[key] = json.loads(json.dumps(rng.choice(others)))
        return


BYTES: tuple[Damage, ...] = (flip_bits, flip_bits, set_bytes, set_integer, set_integer, cut, splice)
TEXTS: tuple[Damage, ...] = (flip_bits, set_bytes, cut, splice, replace_token, replace_token, change_lines)
JSON: tuple[Damage, ...] = (*TEXTS, change_document, change_document)


def damaged(data: bytes, ways: tuple[Damage, ...], rng: random.Random) -> bytes:
    """Damage a file in one to three ways."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if data:
            data = rng.choice(ways)(data, rng)[:MOST_BYTES]
    return data
