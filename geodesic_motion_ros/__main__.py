"""`geodesic-motion`, or `python -m geodesic_motion_ros`: the command line."""

import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command line of this process; returns the exit status.

    An interrupt ends it with one line and status 130. While the commands load, and after the last of them, it would
    surface as a traceback from deep within a library: there it ends the process at once, for nothing was begun, or all
    is done.
    """
    before = signal.signal(signal.SIGINT, _end)
    from geodesic_motion_ros.cli import main as run

    signal.signal(signal.SIGINT, before)
    try:
        status = run()
    except KeyboardInterrupt:
        _say_interrupted()
        status = 130
    signal.signal(signal.SIGINT, _end)
    return status


def _end(number: int, frame: FrameType | None) -> None:
    _say_interrupted()
    os._exit(130)


def _say_interrupted() -> None:
    os.write(sys.stderr.fileno(), b"geodesic-motion: interrupted\n")


if __name__ == "__main__":
    sys.exit(main())
