"""What is promised of the package as a whole: its description and its installation."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from email.parser import Parser
from importlib.metadata import PathDistribution, requires
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGE = "geodesic_motion_ros"
SOURCE = REPOSITORY / PACKAGE
EXECUTABLES = ("planner", "filter", "twin", "record", "franka", "view", "paper_planner", "demo")
REQUIREMENTS = [f"requirements{part}.txt" for part in ("", "-benchmark", "-doc", "-franka", "-robot-server", "-view")]
NOT_SOURCE = shutil.ignore_patterns(
    ".git", ".venv*", ".*_cache", ".hypothesis", "__pycache__", "*.egg-info", "build", "install", "log", "out"
)
ROS_NAME = r"(rclpy|\w+_msgs|builtin_interfaces|std_srvs|rcl_interfaces)"
ROS = re.compile(rf"{ROS_NAME}(\.|$)")


# ---------------------------------------------------------------- installing


def clean_environment(**changes: str) -> dict[str, str]:
    """This environment without what would let the source tree or a workspace pass for the installation."""
    removed = {"PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    return {name: value for name, value in os.environ.items() if name not in removed} | changes


@pytest.fixture(scope="module")
def source_copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source tree: building leaves files behind, and must not do so in the repository."""
    return shutil.copytree(REPOSITORY, tmp_path_factory.mktemp("source") / PACKAGE, ignore=NOT_SOURCE)


@pytest.fixture(scope="module")
def installed(source_copy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prefix into which pip installed the package, neither with its dependencies nor from the network."""
    prefix = tmp_path_factory.mktemp("prefix")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    command += ["--no-index", "--disable-pip-version-check", "--ignore-installed"]
    command += ["--prefix", str(prefix), "."]
    done = subprocess.run(command, cwd=source_copy, env=clean_environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return prefix


@pytest.fixture(scope="module")
def distribution(installed: Path) -> PathDistribution:
    """Metadata of the installed package, as pip and `importlib.metadata` read it."""
    (folder,) = installed.glob(f"lib/python*/site-packages/{PACKAGE}-*.dist-info")
    return PathDistribution(folder)


def site_packages(prefix: Path) -> Path:
    (folder,) = prefix.glob("lib/python*/site-packages")
    return folder


def test_pip_registers_the_package_in_the_ament_index(installed: Path) -> None:
    assert (installed / "share/ament_index/resource_index/packages" / PACKAGE).is_file()
    assert (installed / "share" / PACKAGE / "package.xml").is_file()


@pytest.mark.parametrize(
    ("folder", "patterns"),
    [("config", ("*.md", "*.yaml", "*.rviz")), ("launch", ("*.yaml",)), ("models", ("*",))],
)
def test_pip_ships_every_shared_file(installed: Path, folder: str, patterns: tuple[str, ...]) -> None:
    tree, share = REPOSITORY / folder, installed / "share" / PACKAGE / folder
    wanted = {f.relative_to(tree) for pattern in patterns for f in tree.rglob(pattern) if f.is_file()}
    assert wanted, f"{folder}/ is empty: there is nothing to run the planner with"
    for file in wanted:
        assert (share / file).read_bytes() == (tree / file).read_bytes()


def test_pip_ships_every_module_and_robot_description(installed: Path) -> None:
    wanted = {f.relative_to(SOURCE) for f in SOURCE.rglob("*") if f.suffix in (".py", ".urdf", ".yaml")}
    missing = {str(file) for file in wanted if not (site_packages(installed) / PACKAGE / file).is_file()}
    assert not missing


@pytest.mark.parametrize("name", EXECUTABLES)
def test_ros2_run_finds_an_executable(installed: Path, name: str) -> None:
    assert os.access(installed / "lib" / PACKAGE / name, os.X_OK)


def test_entry_points_lead_to_functions_that_exist(distribution: PathDistribution) -> None:
    points = distribution.entry_points.select(group="console_scripts")
    assert points.names == {*EXECUTABLES, "geodesic-motion"}
    for point in points:
        module = REPOSITORY / point.module.replace(".", "/")
        file = module / "__init__.py" if module.is_dir() else module.with_suffix(".py")
        assert file.is_file(), f"{point.name} starts {point.module}, which does not exist"
        functions = {n.name for n in ast.parse(file.read_text()).body if isinstance(n, ast.FunctionDef)}
        assert point.attr in functions


@pytest.mark.parametrize("name", EXECUTABLES)
def test_executable_starts_what_the_console_script_starts(
    installed: Path, distribution: PathDistribution, name: str
) -> None:
    (point,) = distribution.entry_points.select(name=name)
    text = (installed / "lib" / PACKAGE / name).read_text()
    assert f"from {point.module} import {point.attr} as main;" in text
    assert f'sys.argv[0] = "{name}"' in text


def test_executable_prefers_the_interpreter_it_was_installed_with(tmp_path: Path) -> None:
    folder = tmp_path / "lib" / PACKAGE
    folder.mkdir(parents=True)
    executable = shutil.copy(REPOSITORY / "resource/executables/planner", folder)
    for place, word in (("bin", "beside"), ("elsewhere", "path")):
        script = tmp_path / place / "python3"
        script.parent.mkdir()
        script.write_text(f'#!/bin/sh\nshift 2\necho {word} "$@"\n')
        script.chmod(0o755)
    environment = clean_environment(PATH=f"{tmp_path / 'elsewhere'}:{os.defpath}")

    def answer() -> str:
        command = [executable, "--ros-args", "-r", "__ns:=/a b"]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert answer() == "beside --ros-args -r __ns:=/a b\n"
    (tmp_path / "bin" / "python3").unlink()
    assert answer() == "path --ros-args -r __ns:=/a b\n"


def test_installed_package_finds_its_shared_files(installed: Path, tmp_path: Path) -> None:
    code = "from geodesic_motion_ros.utils.shared_files import find_shared; print(find_shared('package.xml'))"
    environment = clean_environment(PYTHONPATH=str(site_packages(installed)))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()) == installed / "share" / PACKAGE / "package.xml"


@pytest.mark.skipif(shutil.which("colcon") is None, reason="colcon is not installed here")
@pytest.mark.parametrize("mode", [[], ["--symlink-install"]], ids=["copy", "symlink"])
def test_colcon_builds_the_same_layout(source_copy: Path, tmp_path: Path, mode: list[str]) -> None:
    shutil.copytree(source_copy, tmp_path / "src" / PACKAGE, ignore=NOT_SOURCE)
    done = subprocess.run(
        ["colcon", "build", *mode], cwd=tmp_path, env=clean_environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    prefix = tmp_path / "install" / PACKAGE
    assert (prefix / "share/ament_index/resource_index/packages" / PACKAGE).is_file()
    assert (prefix / "share" / PACKAGE / "package.xml").is_file()
    assert all(os.access(prefix / "lib" / PACKAGE / name, os.X_OK) for name in EXECUTABLES)


# ---------------------------------------------------------------- description


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    return ElementTree.parse(REPOSITORY / "package.xml").getroot()


def test_manifest_is_one_that_colcon_takes_for_ament_python(manifest: ElementTree.Element) -> None:
    assert manifest.tag == "package"
    assert manifest.get("format") == "3"
    assert manifest.findtext("export/build_type") == "ament_python"
    assert re.fullmatch(r"\d+\.\d+\.\d+", manifest.findtext("version"))
    for maintainer in manifest.findall("maintainer"):
        # a malformed address makes colcon take the package for plain Python
        address = maintainer.get("email")
        assert re.fullmatch(r"[\w%+-]+(\.[\w%+-]+)*@[\w%-]+(\.[\w%-]+)*\.[a-zA-Z]{2,}", address)


def test_manifest_and_setup_say_the_same(
    manifest: ElementTree.Element, distribution: PathDistribution
) -> None:
    metadata = Parser().parsestr(distribution.read_text("METADATA"))
    assert manifest.findtext("name") == metadata["Name"] == PACKAGE
    assert manifest.findtext("version") == metadata["Version"]
    assert manifest.findtext("license") == (metadata["License-Expression"] or metadata["License"])
    assert "Apache License" in (REPOSITORY / manifest.find("license").get("file")).read_text()


def test_manifest_names_every_ros_package_that_is_imported(manifest: ElementTree.Element) -> None:
    # most files name no package of ROS anywhere: they need not be parsed
    naming = [file for file in sources() if re.search(ROS_NAME, file.read_text())]
    imported = {name.split(".")[0] for file in naming for name in imports(file)}
    declared = {element.text for element in manifest.findall("exec_depend")}
    used = {name for name in imported if ROS.match(name)}
    assert "rclpy" in used
    assert used <= declared


def test_pip_never_brings_a_second_ros(distribution: PathDistribution) -> None:
    always = [line for line in distribution.requires if "extra ==" not in line]
    assert always
    # rosbags is no part of ROS, and brings none.
    assert not [line for line in always if re.match(r"(ros(?!bags\b)|rcl|torch|.*[-_]msgs)", line, re.IGNORECASE)]
    assert "test" in Parser().parsestr(distribution.read_text("METADATA")).get_all("Provides-Extra")


@pytest.mark.parametrize("name", REQUIREMENTS)
def test_requirements_pin_everything_and_name_no_package_host(name: str) -> None:
    text = (REPOSITORY / name).read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    pin = re.compile(r"[A-Za-z0-9._-]+(\[\w+\])?==[0-9][0-9a-z.]*( ; .*)?")
    assert not [line for line in lines if not pin.fullmatch(line)]
    assert "://" not in text


def test_requirements_pin_every_declared_dependency(distribution: PathDistribution) -> None:
    def normal(name: str) -> str:
        return re.sub(r"[-_.]+", "-", re.match(r"[A-Za-z0-9._-]+", name)[0]).lower()

    texts = [(REPOSITORY / name).read_text() for name in REQUIREMENTS]
    pinned = {normal(line) for text in texts for line in text.splitlines() if "==" in line}
    studies = [line for line in requires("geodesic_motion_studies") if not line.startswith(PACKAGE)]
    assert len(studies) > 5
    assert {normal(line) for line in (*distribution.requires, *studies)} <= pinned


# ---------------------------------------------------------------- what a forge and its tools read


def test_the_changelog_is_one_that_catkin_reads_and_begins_with_this_version(manifest: ElementTree.Element) -> None:
    text = (REPOSITORY / "CHANGELOG.rst").read_text()
    title = f"Changelog for package {PACKAGE}"
    assert text.startswith(f"{'^' * len(title)}\n{title}\n{'^' * len(title)}\n")
    headings = re.findall(r"^(\d+\.\d+\.\d+) \(\d{4}-\d{2}-\d{2}\)\n-+$", text, re.MULTILINE)
    assert headings[0] == manifest.findtext("version")
    links = re.findall(r"<([^>:#]+)(?:#[^>]*)?>`__", text)
    assert links
    assert not [link for link in links if not (REPOSITORY / link).is_file()]


def test_every_licence_of_others_is_in_reuse() -> None:
    text = (REPOSITORY / "REUSE.toml").read_text()
    paths = re.findall(r'^path = "(.+)/\*\*"$', text, re.MULTILINE)
    assert sorted(paths) == sorted(str(file.parent.relative_to(REPOSITORY)) for file in SOURCE.rglob("NOTICE"))


def workflow_steps() -> list[dict[str, str]]:
    workflow = yaml.safe_load((REPOSITORY / ".github/workflows/ros.yml").read_text())
    # YAML reads the key `on` as true.
    assert {"name", True, "jobs"} == workflow.keys()
    return [step for job in workflow["jobs"].values() for step in job["steps"]]


def test_steps_of_the_workflow_name_what_exists() -> None:
    steps = workflow_steps()
    assert all(step.keys() <= {"name", "uses", "with", "run"} for step in steps)
    assert all(len(step.keys() & {"uses", "run"}) == 1 for step in steps)
    commands = "\n".join(step.get("run", "") for step in steps)
    targets = set(re.findall(r"^([a-z-]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE))
    started = re.findall(rf"ros2 run {PACKAGE} (\w+)", commands)
    launched = re.findall(rf"ros2 launch {PACKAGE} (\S+)", commands)
    tests = re.findall(rf"pytest src/{PACKAGE}/(\S+)", commands)
    made = re.findall(r"^make (\S+)", commands, re.MULTILINE)
    assert started
    assert set(started) <= set(EXECUTABLES)
    assert launched
    assert all((REPOSITORY / "launch" / name).is_file() for name in launched)
    assert tests
    assert all((REPOSITORY / name).is_file() for name in tests)
    assert made
    assert set(made) <= targets


def test_the_workflow_installs_what_rosdep_does_not(
    manifest: ElementTree.Element, distribution: PathDistribution
) -> None:
    (installed_there,) = re.findall(r"pip install (.+)", "\n".join(step.get("run", "") for step in workflow_steps()))
    keys = {element.text.removeprefix("python3-") for element in manifest.findall("exec_depend")}
    names = {"pillow": "pil", "pyyaml": "yaml"}
    needed = {line.lower() for line in distribution.requires if "extra ==" not in line}
    assert {name for name in needed if names.get(name, name) not in keys} == set(installed_there.split()) - {"pytest"}


# ---------------------------------------------------------------- imports


def sources() -> list[Path]:
    return sorted(SOURCE.rglob("*.py"))


def imports(file: Path) -> Iterator[str]:
    """Absolute names a file imports anywhere in it, inside functions as well."""
    for node in ast.walk(ast.parse(file.read_text(), str(file))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                folder = file.relative_to(SOURCE.parent).parts[: -node.level]
                module = ".".join([*folder, *([module] if module else [])])
            yield from (f"{module}.{alias.name}" for alias in node.names)
