"""Entry point of the command `skfem-stvk`, also run by `python -m skfem_stvk.scenes.commands`."""

import signal
import sys


def main() -> int:
    """Import the command and run it. Ctrl-C ends the imports with one line and exit code 130."""
    try:
        from .main import main as command

        code = command()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done, and its exit code holds
        return code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
