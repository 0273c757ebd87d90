"""`python -m harvester` and the command `harvester`, from the process's first moment on."""

import gc
import signal
import sys


def main() -> int:
    """Run the command line; returns the exit code.

    Its imports are here, so that an interrupt meanwhile ends in a line as well. Callbacks
    of compiled libraries may swallow an interrupt: the exit code reports it nevertheless.
    """
    # With Python's default threshold the garbage collector took a tenth of a short command's time.
    gc.set_threshold(50_000)
    signals = []

    def interrupt(*signal_and_frame):
        signals.append(signal_and_frame[0])
        raise KeyboardInterrupt

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    try:
        from harvester.cli.command_line import main as run

        code = run()
    except KeyboardInterrupt:
        print("harvester: interrupted; nothing was written", file=sys.stderr)
        return 130
    if signals and code == 0:
        print("harvester: interrupted, but only after its last result", file=sys.stderr)
    return code or (130 if signals else 0)


if __name__ == "__main__":
    import os

    # Python has put the working folder first on the path. It is removed: nothing is imported from
    # there.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
    sys.exit(main())
