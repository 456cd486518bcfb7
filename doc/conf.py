"""Settings of Sphinx for the site of the pages (`make doc`): the repository is the source, so that links serve both."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

(release,) = re.findall(r"<version>(.+)</version>", (Path(__file__).parents[1] / "package.xml").read_text())
project = "geodesic_motion_ros"
author = copyright = "geodesic_motion_ros maintainers"
root_doc = "doc/index"
include_patterns = [
    "doc/*.md", "config/README.md", "models/README.md", "models/*/README.md", "studies/**/*.md",
    "CONTRIBUTING.md",
]  # fmt: skip
exclude_patterns = ["doc/README.md"]  # the index for readers of the repository
extensions = ["myst_parser", "autoapi.extension", "sphinx.ext.napoleon"]
# doc/api.md says what is shown. Sources are read, not imported: of what it shows alone, all of them take minutes.
autoapi_dirs = ["geodesic_motion_ros"]
_READ = {
    "certification/declared_scene", "contract/settings", "contract/status", "demonstrations/demonstrations",
    "filtering/motion_filter", "motion/plan", "obstacles/obstacles", "planning/planner", "planning/streaming_planner",
    "robot/kinematics", "skill/skill",
}  # fmt: skip
_PACKAGE = Path(__file__).parents[1] / "geodesic_motion_ros"
autoapi_ignore = [
    str(file) for file in _PACKAGE.rglob("*.py")
    if file.name != "__init__.py" and str(file.relative_to(_PACKAGE).with_suffix("")) not in _READ
]  # fmt: skip
autoapi_generate_api_docs = autoapi_add_toctree_entry = False
autoapi_python_class_content = "both"
napoleon_use_ivar = True
autodoc_member_order, default_role = "bysource", "code"
add_module_names, python_use_unqualified_type_names = False, True
suppress_warnings = ["autoapi.python_import_resolution"]
# examples.md shows pictures that are kept: sphinx-gallery would run the examples here, without the package and torch.
myst_heading_anchors = 4
html_theme = "furo"
html_static_path, html_css_files = ["site"], ["wide.css"]
html_title = f"{project} {release}"


def setup(app: Sphinx) -> None:
    """Keep napoleon from taking what precedes a colon in the sentence of a property for its type."""
    app.connect("autodoc-process-docstring", _begin_with_no_type, priority=400)


def _begin_with_no_type(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    if what == "property":
        lines.insert(0, "")
