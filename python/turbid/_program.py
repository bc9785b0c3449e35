"""The program as a child process: where it is, what it says, how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings
from typing import IO, Any, Callable, Dict, List, Mapping, NamedTuple, NoReturn, Optional, Sequence, Union

from .errors import InputError, InterruptedRun, Mistake, NotRunError, ProgramError, RunError, TurbidError, TurbidWarning

PathLike = Union[str, "os.PathLike[str]"]
Event = Dict[str, Any]

#: Ctrl-C as a shell tells it.
INTERRUPTED = 130

_found: Dict[str, str] = {}


def executable() -> str:
    """Path of the program: that of `TURBID`, else the one that was installed with this module, else the one on the path.

    Errors: `ProgramError` where there is none.
    """
    given = os.environ.get("TURBID", "")
    if given not in _found:
        _found[given] = _look_for(given)
    return _found[given]


def _look_for(given: str) -> str:
    import shutil
    import sysconfig

    if given:
        if not os.access(given, os.X_OK):
            raise ProgramError(f"TURBID={given}: there is no program")
        return os.path.abspath(given)
    name = "turbid.exe" if os.name == "nt" else "turbid"
    schemes = [sysconfig.get_default_scheme(), f"{os.name}_user"] if sys.version_info >= (3, 10) else [f"{os.name}_prefix", f"{os.name}_user"]
    folders = [sysconfig.get_path("scripts", scheme) for scheme in schemes]
    # `pip install --target` puts programs beside modules.
    folders.append(os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "bin"))
    for folder in folders:
        path = os.path.join(folder, name)
        if os.access(path, os.X_OK):
            return path
    on_path = shutil.which(name)
    if on_path is None:
        raise ProgramError("the program `turbid` is not there: install the wheel, or name the program in the variable TURBID")
    return on_path


class Ended(NamedTuple):
    """A program that has ended."""

    code: int
    out: str
    err: str


def _start(arguments: Sequence[str]) -> subprocess.Popen[str]:
    # A session of its own: Ctrl-C of the terminal reaches it once, through this process, and not twice, which would end it at once.
    apart: Dict[str, Any] = {"start_new_session": True}
    if os.name == "nt":
        apart = {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
    command = [executable(), *arguments]
    environment = {**os.environ, "TURBID_ERRORS": "json"}
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            encoding="utf-8",
            errors="replace",
            **apart,
        )
    except OSError as error:
        raise ProgramError(f"{command[0]} cannot be started: {error}") from error


def _interrupt(child: subprocess.Popen[str]) -> None:
    """Asks the program to end with what it has; a second time it ends at once."""
    if child.poll() is None:
        child.send_signal(getattr(signal, "CTRL_BREAK_EVENT") if os.name == "nt" else signal.SIGINT)


def stream(arguments: Sequence[str], on_line: Callable[[str], None]) -> Ended:
    """Runs the program, hands on each line of its stdout, and waits for its end. `out` is empty.

    Ctrl-C asks the program to end, hands on what it says meanwhile, and is raised once it has ended.
    """
    import threading

    child = _start(arguments)
    assert child.stdout is not None and child.stderr is not None
    err: List[str] = []

    def drain(pipe: IO[str]) -> None:
        err.append(pipe.read())

    listener = threading.Thread(target=drain, args=(child.stderr,), daemon=True)
    listener.start()
    interrupted: Optional[BaseException] = None
    while True:
        try:
            for line in child.stdout:
                on_line(line)
            child.wait()
            break
        except KeyboardInterrupt as pressed:
            interrupted = pressed
            _interrupt(child)
        except BaseException:
            # A callback failed: nobody listens any more.
            _interrupt(child)
            child.stdout.close()
            child.wait()
            raise
    listener.join()
    child.stdout.close()
    child.stderr.close()
    if interrupted is not None:
        raise interrupted
    return Ended(child.returncode, "", "".join(err))


def call(arguments: Sequence[str]) -> Ended:
    """Runs the program to its end."""
    child = _start(arguments)
    interrupted: Optional[BaseException] = None
    while True:
        try:
            out, err = child.communicate()
            break
        except KeyboardInterrupt as pressed:
            interrupted = pressed
            _interrupt(child)
    if interrupted is not None:
        raise interrupted
    return Ended(child.returncode, out, err)


def ask(arguments: Sequence[str]) -> str:
    """What the program prints. Errors: those that it tells."""
    ended = call(arguments)
    if ended.code != 0:
        fail(ended)
    warn(ended.err)
    return ended.out


def ask_json(arguments: Sequence[str]) -> Any:
    """The same as JSON."""
    return parsed(ask(arguments))


def parsed(text: str) -> Any:
    """JSON of the program."""
    try:
        return json.loads(text)
    except ValueError:
        raise ProgramError(f"{executable()} did not answer with JSON but with {text[:200]!r}; is it another version of turbid?") from None


def mistakes(err: str) -> List[Mistake]:
    """Those that stderr tells."""
    lines = [line for line in err.splitlines() if line.startswith('{"mistakes":')]
    return [Mistake.of(told) for line in lines for told in json.loads(line)["mistakes"]]


def warn(err: str) -> None:
    """Hands on the warnings of stderr."""
    if "warning: " in err:
        warnings.warn(err.strip(), TurbidWarning, stacklevel=4)


def fail(ended: Ended, failures: Optional[Mapping[str, str]] = None) -> NoReturn:
    """Raises what stands behind an exit code that is not 0."""
    told = mistakes(ended.err)
    rest = "\n".join(line for line in ended.err.splitlines() if not line.startswith('{"mistakes":')).strip()
    text = "\n".join(map(str, [m for m in told if m.severity == "error"] or told)) or rest
    if ended.code < 0:
        name = signal.Signals(-ended.code).name if -ended.code in set(signal.Signals) else str(-ended.code)
        out_of_memory = "; perhaps the machine had no memory left" if name == "SIGKILL" else ""
        raise ProgramError(f"the program was ended by {name}{out_of_memory}\n{rest}".strip(), told)
    if ended.code == INTERRUPTED:
        raise InterruptedRun(text or "interrupted; what was finished is kept", told)
    if failures:
        listed = "\n".join(f"{instance}: {message}" for instance, message in failures.items())
        raise RunError(listed if not text else f"{listed}\n{text}", told, failures)
    kinds: Dict[str, Callable[[str, Sequence[Mistake]], TurbidError]] = {"not_run": NotRunError}
    if ended.code == 2:
        raise InputError(text, told)
    if ended.code == 1:
        raise kinds.get(told[0].kind if told else "", RunError)(text or "the program failed", told)
    raise ProgramError(f"the program ended with {ended.code}\n{text}".strip(), told)
