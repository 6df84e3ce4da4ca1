"""A process that has imported what the commands need, and forks for each of them: starting Python costs a second each.

It reads a request a line on standard input: to start a command, answered with the number of its process, or to wait for
one, answered with its exit status. The commands run as they do from a terminal: in a process of their own, with their
own folder, standard input, output and error.
"""

import importlib
import json
import os
import pkgutil
import select
import sys
import traceback

#: What commands import, beside labcdp's own modules; nothing of them runs before the fork.
_HEAVY = (
    *("colour", "cv2", "dask.array", "distributed", "jinja2", "matplotlib.backends.backend_agg", "matplotlib.figure"),
    *("netCDF4", "numpy", "openpyxl", "PIL.Image", "plotly.graph_objects", "pydantic", "rich.markdown"),
    *("rich.progress", "scipy.interpolate", "scipy.optimize", "scipy.special", "scipy.stats"),
    *("tifffile", "xarray", "xlsxwriter"),
)
#: Packages whose modules are imported, too; not those that start threads or compile.
_OWN = ("acquire", "chain", "cli", "evaluate", "files", "output", "regions", "report", "session")


def _serve() -> None:
    import labcdp

    own = [
        module.name
        for package in _OWN
        for module in pkgutil.walk_packages([f"{labcdp.__path__[0]}/{package}"], f"labcdp.{package}.")
    ]
    for name in (*_HEAVY, *own):
        importlib.import_module(name)
    from labcdp.cli import main

    for line in sys.stdin:
        request = json.loads(line)
        answer = _wait(**request) if "process" in request else _start(request, main)
        print(json.dumps(answer), flush=True)


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


def _wait(process: int, timeout_s: float) -> int | None:
    """Exit status, negative for the number of a signal; None if it still runs."""
    watched = os.pidfd_open(process)
    ended = bool(select.select([watched], [], [], timeout_s)[0])
    os.close(watched)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) if ended else None


if __name__ == "__main__":
    _serve()
