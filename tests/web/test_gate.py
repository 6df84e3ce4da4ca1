from labcdp.web.gate import Gate

GATE = Gate("secret-token-0123", loopback_only=True)
COOKIE = f"{GATE.cookie}=secret-token-0123"
HOST = "127.0.0.1:5006"


def test_the_token_opens_in_the_address_and_as_a_cookie() -> None:
    assert GATE.refusal(HOST, None, "", "token=secret-token-0123") == ""
    assert GATE.refusal(HOST, None, COOKIE, "") == ""
    # A tunnel may end at another port; the page it brings is then its own origin.
    assert GATE.refusal("localhost:8080", "http://localhost:8080", COOKIE, "") == ""
    assert GATE.refusal("[::1]:5006", None, COOKIE, "") == ""


def test_nobody_else_gets_in() -> None:
    assert "lacks its token" in GATE.refusal(HOST, None, "", "")
    assert "lacks its token" in GATE.refusal(HOST, None, "", "token=secret-token-012")
    assert "lacks its token" in GATE.refusal(HOST, None, "", "token=%C3%A4%00")
    assert "lacks its token" in GATE.refusal(HOST, None, f"{GATE.cookie}=", "token=")
    assert "lacks its token" in GATE.refusal(HOST, None, "a=b; =;;,\x00", "token")
    assert "lacks its token" in GATE.refusal(HOST, None, COOKIE.replace("labcdp-rois", "labcdp"), "")


def test_other_pages_and_other_names_of_the_host_are_refused() -> None:
    assert "no other page" in GATE.refusal(HOST, "http://127.0.0.1:8000", COOKIE, "")
    assert "no other page" in GATE.refusal(HOST, "http://evil.example", COOKIE, "")
    assert "no other page" in GATE.refusal(HOST, "null", COOKIE, "")
    assert "loopback only" in GATE.refusal("evil.example:5006", "http://evil.example:5006", COOKIE, "")
    assert "loopback only" in GATE.refusal("[bad", None, COOKIE, "")
    assert Gate(GATE.token, loopback_only=False).refusal("bench.lab:5006", "http://bench.lab:5006", COOKIE, "") == ""
