"""`python -m harvester` and the command `harvester`, from the process's first moment on."""

import sys


def main() -> int:
    """Run the command line; returns the exit code.

    What it needs is imported here, so that an interrupt meanwhile ends in a line as well.
    """
    try:
        from harvester.command_line import main as run

        return run()
    except KeyboardInterrupt:
        print("harvester: interrupted; nothing was written", file=sys.stderr)
        return 130


if __name__ == "__main__":
    import os

    # Python has put the working folder first on the path. It is removed: nothing is imported from
    # there.
    if not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
        del sys.path[0]
    sys.exit(main())
