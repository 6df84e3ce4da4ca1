"""Messages of the library reach the terminal once, and other handlers as well."""

import logging

from labcdp.cli.terminal import log_to_terminal


def test_warnings_are_shown_once_however_often_commands_ran(capsys, caplog):
    log_to_terminal(verbose=True)
    log_to_terminal(verbose=False)
    logging.getLogger("labcdp.drivers.camera").warning("camera lost")
    logging.getLogger("labcdp.drivers.camera").info("camera found")
    logging.getLogger("labcdp.calibration").warning("part of the result")
    assert capsys.readouterr().err == "labcdp: camera lost\n"
    assert "camera lost" in caplog.messages
