from labcdp.web.gate import Gate


def test_other_names_of_the_host_are_refused_unless_another_address_was_asked_for() -> None:
    gate, host = Gate("secret-token-0123", loopback_only=True), "bench.lab:5006"
    cookie = f"{gate.cookie}={gate.token}"
    assert gate.refusal("[::1]:5006", None, cookie, "") == ""
    for name in (host, "[bad"):
        assert "loopback only" in gate.refusal(name, None, cookie, "")
    assert Gate(gate.token, loopback_only=False).refusal(host, f"http://{host}", cookie, "") == ""
    assert "lacks its token" in gate.refusal("127.0.0.1:5006", None, "", "token=%C3%A4%00")
