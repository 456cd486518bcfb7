"""`geodesic-motion`, or `python -m geodesic_motion_ros`: the command line."""

import os
import signal
import sys
from types import FrameType


def main() -> int:
    """Run the command line of this process; returns the exit status.

    An interrupt while the commands load would surface as a traceback from deep within a library: until they are there
    it ends the process at once, as nothing was begun.
    """
    before = signal.signal(signal.SIGINT, _end)
    from geodesic_motion_ros.studies.cli import main as run

    signal.signal(signal.SIGINT, before)
    return run()


def _end(number: int, frame: FrameType | None) -> None:
    os.write(sys.stderr.fileno(), b"geodesic-motion: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
