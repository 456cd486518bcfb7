"""Who may import whom, by folder: downward only, never a sibling.

The folders stand on floors; a module imports from its own folder and from folders of lower floors. So no circle of
folders is possible. Imports inside functions, relative ones and those for type checkers count as well. The root holds
nothing but `__init__.py`, which hands out names of the floors below, and `__main__.py`.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE, STUDIES = "geodesic_motion_ros", "geodesic_motion_studies"
SOURCE = Path(__file__).resolve().parents[1] / PACKAGE
#: From the ground upwards; folders of one floor do not know each other.
FLOORS = (
    {"utils"},
    {"geometry"},
    {"robot", "obstacles"},
    {"manifold"},
    {"skill", "trajectory"},
    {"contract"},
    {"certification"},
    {"queries"},
    {"detours"},
    {"motion"},
    {"planning", "demonstrations"},
    {"filtering"},
    {"kernels", "simulation", "visualization", "learning", "hardware", "view"},
    {"nodes"},
    {"demo", "paper"},
    {"cli"},
)
FLOOR = {folder: floor for floor, folders in enumerate(FLOORS) for folder in folders}
#: Libraries, and the folders that may import them.
LIBRARIES = {
    re.compile(r"(rclpy|\w+_msgs|builtin_interfaces|std_srvs|rcl_interfaces|tf2_\w+)(\.|$)"): {
        "nodes", "demo", "paper",
    },
    re.compile(r"(torch|pytorch_kinematics)(\.|$)"): {"learning"},
    re.compile(r"pybullet(_data)?(\.|$)"): {"simulation"},
    re.compile(r"(pylibfranka|franka_sim)(\.|$)"): {"hardware"},
}
ROOT = {"__init__.py", "__main__.py"}


def imports(nodes: list[ast.AST], file: Path, package: Path) -> Iterator[str]:
    """Absolute names that a file imports anywhere in it."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                folder = file.relative_to(package.parent).parts[: -node.level]
                module = ".".join([*folder, *([module] if module else [])])
            yield from (f"{module}.{alias.name}" for alias in node.names)


def strings(nodes: list[ast.AST]) -> Iterator[str]:
    """The strings of a file, those of f-strings too, without docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    described = {id(node.body[0].value) for node in nodes if isinstance(node, documented) and ast.get_docstring(node)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described:
            yield node.value


def violations(package: Path) -> list[str]:
    """All that a package breaks of the rules above, a line each."""
    files = {path.name for path in package.iterdir() if path.is_file()}
    found = [f"{name} stands in the root" for name in sorted(files - ROOT)]
    # What an older version has left is a folder of caches alone.
    folders = {file.relative_to(package).parts[0] for file in package.glob("*/**/*.py")}
    found += [f"{folder} has no floor" for folder in sorted(folders - FLOOR.keys())]
    for file in sorted(package.rglob("*.py")):
        place = file.relative_to(package)
        folder = place.parts[0]
        if folder not in FLOOR:
            continue
        nodes = list(ast.walk(ast.parse(file.read_text(), str(file))))
        for name in imports(nodes, file, package):
            for library, folders in LIBRARIES.items():
                if library.match(name) and folder not in folders:
                    found.append(f"{place} imports {name}")
            if name.partition(".")[0] == STUDIES:
                found.append(f"{place} imports {name}")
            other = name.removeprefix(f"{PACKAGE}.").partition(".")[0]
            if name.startswith(f"{PACKAGE}.") and other != folder and FLOOR.get(other, -1) >= FLOOR[folder]:
                found.append(f"{place} imports {name}")
        # Studies are found by their entry point: see `cli`.
        found += [f"{place} names {text}" for text in strings(nodes) if f"{STUDIES}." in text]
    return found


def test_imports_lead_downward_alone() -> None:
    assert violations(SOURCE) == []


@pytest.mark.parametrize(
    ("place", "text", "violation"),
    [
        ("contract/mode.py", "from geodesic_motion_ros.nodes import clock", "imports geodesic_motion_ros.nodes.clock"),
        ("planning/planner.py", "def tick():\n    import torch.nn", "imports torch.nn"),
        ("manifold/grid.py", "from ..learning import training", "imports geodesic_motion_ros.learning.training"),
        ("robot/model.py", "from geodesic_motion_ros import obstacles", "imports geodesic_motion_ros.obstacles"),
        ("cli/train.py", "import geodesic_motion_studies.folds", "imports geodesic_motion_studies.folds"),
        ("cli/train.py", "from rclpy.node import Node", "imports rclpy.node.Node"),
        ("nodes/twin.py", "import pybullet", "imports pybullet"),
        ("nodes/twin.py", 'NAME = f"geodesic_motion_studies.{1}"', "names geodesic_motion_studies."),
        (
            "skill/skill.py",
            "import typing\nif typing.TYPE_CHECKING:\n    from geodesic_motion_ros.trajectory.timing import T",
            "imports geodesic_motion_ros.trajectory.timing.T",
        ),
    ],
)
def test_a_violation_is_found(place: str, text: str, violation: str, tmp_path: Path) -> None:
    file = tmp_path / PACKAGE / place
    file.parent.mkdir(parents=True)
    file.write_text(f"{text}\n")
    assert violations(tmp_path / PACKAGE) == [f"{place} {violation}"]


def test_what_is_allowed_is_no_violation(tmp_path: Path) -> None:
    file = tmp_path / PACKAGE / "nodes" / "planner_node.py"
    file.parent.mkdir(parents=True)
    (tmp_path / PACKAGE / "__init__.py").write_text("from geodesic_motion_ros.nodes import planner_node\n")
    file.write_text("import rclpy\nfrom geodesic_motion_ros.planning import planner\nfrom . import messages\n")
    assert violations(tmp_path / PACKAGE) == []


def test_a_module_in_the_root_and_a_folder_without_a_floor_are_found(tmp_path: Path) -> None:
    folder = tmp_path / PACKAGE / "helpers"
    folder.mkdir(parents=True)
    (tmp_path / PACKAGE / "planner.py").touch()
    (folder / "text.py").touch()
    assert violations(tmp_path / PACKAGE) == ["planner.py stands in the root", "helpers has no floor"]


def floors_within(folder: Path) -> dict[str, int]:
    """The floor of each module of a folder, from 1: one above the highest of those that it imports."""
    files = {".".join(file.relative_to(SOURCE.parent).with_suffix("").parts): file for file in folder.rglob("*.py")}
    below = {}
    for module, file in files.items():
        names = list(imports(list(ast.walk(ast.parse(file.read_text()))), file, SOURCE))
        # Of `from folder.module import name`, and of `from folder import module`.
        below[module] = {other for name in names for other in (name, name.rpartition(".")[0]) if other in files}
    floors: dict[str, int] = {}
    while len(floors) < len(files):
        ready = [module for module in below if module not in floors and below[module] - {module} <= floors.keys()]
        assert ready, f"a circle among {sorted(below.keys() - floors.keys())}"
        for module in ready:
            floors[module] = 1 + max((floors[other] for other in below[module] - {module}), default=0)
    return floors


#: Folders that a tick goes through.
TICK = ("contract", "certification", "queries", "detours", "motion", "planning", "trajectory", "obstacles", "manifold")


@pytest.mark.parametrize("folder", TICK)
def test_modules_of_a_folder_stand_on_few_floors(folder: str) -> None:
    floors = floors_within(SOURCE / folder)
    assert 1 < max(floors.values()) <= 6, floors


def test_planning_loads_neither_torch_nor_ros_nor_pybullet() -> None:
    folders = {folder for floor in FLOORS[: FLOOR["planning"] + 1] for folder in floor}
    files = [file for folder in sorted(folders) for file in sorted((SOURCE / folder).rglob("*.py"))]
    places = [file.relative_to(SOURCE.parent).with_suffix("") for file in files]
    names = [".".join(place.parts).removesuffix(".__init__") for place in places]
    code = f"import sys, {', '.join(names)}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=SOURCE.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"torch", "pytorch_kinematics", "rclpy", "pybullet"}
