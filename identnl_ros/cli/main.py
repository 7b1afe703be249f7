# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Entry point of `identnl`; what takes time to import comes after the signals are caught."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
import signal
import sys
import time
from types import FrameType

WRONG_USE = 2
BY_SIGNAL = 128  # exit code of a shell's child that a signal has ended: this plus its number
PATIENCE = 5.0  # [s] for which more signals do not disturb the clearing up after the first
# Called from C, which does not expect an exception that a signal throws in: the process would
# crash, or end by the signal once everything is cleared up.
UNSAFE = ('numba', 'llvmlite')
REPEATED = 0.2  # [s]


class Interruption:
    """The signals that ask to end, each as a KeyboardInterrupt."""

    def __init__(self) -> None:
        self.number = 0
        self._since = 0.0

    @contextmanager
    def caught(self) -> Iterator[None]:
        """
        Catch the signals.

        Yields
        ------
        None

        """
        before = {
            number: signal.getsignal(number)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        }
        # What is ignored, as after nohup, stays so.
        before = {
            number: handler for number, handler in before.items() if handler != signal.SIG_IGN
        }
        for number in before:
            signal.signal(number, self._note)
        signal.signal(signal.SIGALRM, self._interrupt)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            sys.settrace(None)
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.number and now - self._since < PATIENCE:
            return
        self.number, self._since = number, now
        self._interrupt(number, frame)

    def _interrupt(self, _number: int, frame: FrameType | None) -> None:
        # Some code throws exceptions away, e.g. when it is called while an object is deleted:
        # once more, then, until one is being handled.
        signal.setitimer(signal.ITIMER_REAL, REPEATED)
        if _is_interrupt(sys.exception()):
            return
        caller = _caller_of_unsafe(frame)
        if caller is None:
            raise KeyboardInterrupt
        # Compiled code asks Python for something at nearly every call, and signals wait for that:
        # the interrupt has to come on the way back, at the next line of who called.
        caller.f_trace = self._at_line
        sys.settrace(_not_traced)

    def _at_line(self, frame: FrameType, _event: str, _argument: object) -> None:
        sys.settrace(None)
        frame.f_trace = None
        raise KeyboardInterrupt


def _caller_of_unsafe(frame: FrameType | None) -> FrameType | None:
    """Find the innermost frame that no unsafe one is below; None: there is no unsafe one."""
    caller = None
    while frame is not None:
        if frame.f_globals.get('__name__', '').partition('.')[0] in UNSAFE:
            caller = frame.f_back
        frame = frame.f_back
    return caller


def _not_traced(_frame: FrameType, _event: str, _argument: object) -> None:
    return None


def main() -> None:
    """Run the command line as a process of its own."""
    try:
        run()
    except SystemExit as ending:
        if isinstance(ending.code, int) and ending.code > BY_SIGNAL:
            # Everything is cleared up. The interpreter's own way out would take the exit code
            # away where the interrupt has come through code that was started from C.
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(ending.code)
        raise


def run() -> None:
    """
    Run the command line.

    Raises
    ------
    SystemExit
        With the exit code.

    """
    # `ros2 run` may hand over ROS arguments, which mean nothing here.
    arguments = sys.argv[1:]
    if '--ros-args' in arguments:
        arguments = arguments[: arguments.index('--ros-args')]
    interruption = Interruption()
    try:
        with interruption.caught():
            exit_code = _run(arguments)
    except SystemExit:
        raise
    except BaseException as error:
        # Compiled code may turn the interrupt into an error of its own.
        if not (interruption.number or _is_interrupt(error)):
            raise
        print('interrupted', file=sys.stderr)
        _show_error('interrupted', arguments)
        exit_code = BY_SIGNAL + (interruption.number or signal.SIGINT)
    sys.exit(exit_code)


def _run(arguments: list[str]) -> int:
    import click
    from identnl_ros.cli.commands import cli
    from identnl_ros.cli.output import DONE, UNWRITABLE, WRITABLE

    try:
        # A whole number: --help and the like.
        result = cli.main(arguments, 'identnl', standalone_mode=False)
        return result if isinstance(result, int) else 0
    except click.Abort:
        raise KeyboardInterrupt from None
    except OSError as error:
        # What commands read and write they tell themselves: this is the text of --help.
        sys.stdout = None
        if isinstance(error, BrokenPipeError):
            return DONE
        print(f'identnl: {UNWRITABLE}: {error.strerror}; {WRITABLE}', file=sys.stderr)
        return WRONG_USE
    except click.ClickException as error:
        error.show()
        _show_error(error.format_message(), arguments)
        return WRONG_USE


def _show_error(message: str, arguments: list[str]) -> None:
    if '--json' in arguments:
        from identnl_ros.cli.output import show_error

        show_error(message)


def _is_interrupt(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


if __name__ == '__main__':
    main()
