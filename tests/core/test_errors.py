import pytest

from labcdp.core.errors import InputError


@pytest.mark.parametrize("given", ["a" * 10**6, "a b " * 10**6, "'a " * 10**6, "a\x1b\n" * 10**6], ids=range(4))
def test_a_message_quotes_little_and_what_is_printable(given):
    message = str(InputError(f"stage is {given!r}: give one of the camera's"))
    assert message.startswith("stage is ")
    assert message.endswith(": give one of the camera's")
    assert len(message) < 140
    assert message.isprintable()
