"""Settings of Sphinx for the site of the pages (`make doc`): the repository is the source, so that links serve both."""

from __future__ import annotations

import re
from pathlib import Path

(release,) = re.findall(r"<version>(.+)</version>", (Path(__file__).parents[1] / "package.xml").read_text())
project = "geodesic_motion_ros"
author = copyright = "geodesic_motion_ros maintainers"
root_doc = "doc/index"
include_patterns = [
    "doc/*.md", "config/README.md", "models/README.md", "models/*/README.md", "studies/**/*.md",
    "CONTRIBUTING.md",
]  # fmt: skip
exclude_patterns = ["doc/README.md"]  # the index for readers of the repository
extensions = ["myst_parser"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"{project} {release}"
