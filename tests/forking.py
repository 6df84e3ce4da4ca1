"""A process that has imported what the commands need, and forks for each of them: to import it takes five seconds.

It forks once for each test process, which connects to the socket that it is given and says in which network it is. From
there it reads a request a line: to start a command, answered with the number of its process, or to wait for one,
answered with its exit status. The commands run as they do from a terminal: in a process of their own, with their own
folder, standard input, output and error. Names of libraries that are given after the socket cannot be imported.
"""

import ctypes
import gc
import importlib
import json
import os
import pkgutil
import select
import signal
import socket
import sys
import traceback
from contextlib import suppress

#: Variable of the environment that says at which call that changes the disk a command is killed.
KILLED_AT = "LABCDP_TESTS_KILLED_AT"
#: What commands import only where they need it.
_HEAVY = (
    *("colour", "dask.array", "distributed", "matplotlib.backends.backend_agg", "netCDF4", "openpyxl", "rich.markdown"),
    *("scipy.interpolate", "scipy.optimize", "scipy.special", "scipy.stats", "tifffile", "xlsxwriter"),
)
#: Packages whose modules are imported, too; not those that start threads or compile.
_OWN = ("acquire", "chain", "cli", "evaluate", "files", "output", "regions", "report", "session")


def _main(listening: socket.socket, without: list[str]) -> None:
    """Serve test processes until the one that started this closes standard input, or ends."""
    main = _import_all(without)
    # None of it is looked at for garbage again, in any child.
    gc.freeze()
    while sys.stdin not in select.select([sys.stdin, listening], [], [])[0]:
        connection, _ = listening.accept()
        if os.fork() == 0:
            listening.close()
            _serve(connection, main)
            os._exit(0)
        connection.close()
    with suppress(ChildProcessError):
        while True:
            os.wait()


def _import_all(without: list[str]):
    # An import of what is None says that there is no such module.
    sys.modules.update(dict.fromkeys(without))
    from bokeh.plotting import figure

    import labcdp

    own = [
        module.name
        for package in _OWN
        for module in pkgutil.walk_packages([f"{labcdp.__path__[0]}/{package}"], f"labcdp.{package}.")
    ]
    for name in (*_HEAVY, *own):
        with suppress(*([ImportError] if without else [])):
            importlib.import_module(name)
    from labcdp.cli import main
    from labcdp.report.html import interactive

    # What Bokeh imports and reads with its first figure.
    interactive(figure())
    return main


def _serve(connection: socket.socket, main) -> None:
    _, (network,), *_ = socket.recv_fds(connection, 1, 1)
    if os.fstat(network).st_ino != os.stat("/proc/self/ns/net").st_ino and ctypes.CDLL(None).setns(network, 0) != 0:
        raise OSError("cannot move into the network of the test process")
    os.close(network)
    with connection.makefile("rw") as stream:
        for line in stream:
            request = json.loads(line)
            answer = _wait(**request) if "process" in request else _start(request, main)
            print(json.dumps(answer), file=stream, flush=True)


def _start(request, main) -> int:
    child = os.fork()
    if child == 0:
        _become(request, main)
    return child


def _become(request, main) -> None:
    status = 70
    try:
        os.chdir(request["cwd"])
        os.environ.update(request["environment"])
        for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
            flags = os.O_RDONLY if descriptor == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            os.dup2(os.open(request[name], flags), descriptor)
            # As Python does it at its start.
            encoding, buffering = os.environ.get("PYTHONIOENCODING", "utf-8"), 1 if descriptor == 2 else -1
            setattr(sys, name, os.fdopen(descriptor, "w" if descriptor else "r", buffering, encoding, closefd=False))
        sys.argv = request["arguments"]
        status = 0
        if KILLED_AT in os.environ:
            _kill_at(int(os.environ[KILLED_AT]))
        main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        status = 1
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(status)


def _kill_at(call: int) -> None:
    """Let this process be killed at a given call of the system that changes the disk; a write gets half done."""
    left = call

    def counted(name):
        function = getattr(os, name)

        def wrapper(*arguments, **keywords):
            nonlocal left
            left -= 1
            if left == 0:
                if name == "write":
                    function(arguments[0], bytes(arguments[1])[: len(arguments[1]) // 2])
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **keywords)

        setattr(os, name, wrapper)

    for name in ("write", "fsync", "link", "replace", "rename", "mkdir", "rmdir", "unlink"):
        counted(name)


def _wait(process: int, timeout_s: float) -> int | None:
    """Exit status, negative for the number of a signal; None if it still runs."""
    watched = os.pidfd_open(process)
    ended = bool(select.select([watched], [], [], timeout_s)[0])
    os.close(watched)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) if ended else None


if __name__ == "__main__":
    _main(socket.socket(fileno=int(sys.argv[1])), sys.argv[2:])
