"""`python -m geodesic_motion_ros`: the command line."""

import sys

from geodesic_motion_ros.studies.cli import main

if __name__ == "__main__":
    sys.exit(main())
