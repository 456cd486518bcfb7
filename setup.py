"""Package description for pip and for colcon (ament_python)."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "geodesic_motion_ros"
#: The programs that `ros2 run` starts, and the folders where they begin.
EXECUTABLES = {
    **dict.fromkeys(("planner", "filter", "twin", "record", "franka", "view"), "nodes"),
    "paper_planner": "paper", "demo": "demo",
}  # fmt: skip
SHARE = Path("share") / NAME


def shared(folder: str, *patterns: str) -> list[tuple[str, list[str]]]:
    """Files of `folder` that match, for data_files: each goes to the same place under share/."""
    found: dict[str, list[str]] = {}
    for pattern in patterns:
        for file in sorted(Path(folder).rglob(pattern)):
            if file.is_file():
                found.setdefault((SHARE / file.parent).as_posix(), []).append(file.as_posix())
    return sorted(found.items())


setup(
    name=NAME,
    version="0.2.0",
    description="Reactive robot motion on learned Riemannian manifolds, for ROS 2",
    author="geodesic_motion_ros maintainers",
    author_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        f"{NAME}.robot": ["*.urdf", "robots/*/*", "robots/*/meshes/*"],
    },
    python_requires=">=3.10",
    # rclpy and the message packages stay out of here: on a machine with ROS they are the system's, and pip
    # must not add a second set. Without a system ROS, the extra `ros` brings them.
    install_requires=[
        "matplotlib",
        "numba",
        "numpy",
        "pillow",
        "pycollada",  # lets trimesh read .dae
        "PyYAML",
        "rosbags",  # reads bags of ROS 1 and ROS 2 without either, where people record and train
        "safetensors",
        "scipy",
        "tqdm",
        "trimesh",  # reads the meshes that collide, in every format that URDFs name
        "xacro",  # ROS's own, expands xacro files without a ROS
    ],
    extras_require={
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],
        "learn": ["torch", "pytorch_kinematics"],
        "simulation": ["pybullet"],
        "franka": ["pylibfranka"],
        "view": ["viser"],  # the page in the browser: meshes, status and what is dragged in one pip install
        "test": ["hypothesis", "mpmath", "mypy", "pytest", "pytest-timeout", "pytest-xdist", "ruff"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE.as_posix(), ["package.xml"]),
        # colcon puts console scripts into lib/<package> by itself, pip does not: `ros2 run` looks only there.
        (f"lib/{NAME}", [f"resource/executables/{name}" for name in EXECUTABLES]),
        *shared("config", "*.md", "*.yaml", "*.rviz", "*.xml"),
        *shared("launch", "*.yaml"),
        *shared("models", "*"),
    ],
    entry_points={
        "console_scripts": [
            *(f"{name} = {NAME}.{folder}.start:{name}" for name, folder in EXECUTABLES.items()),
            f"geodesic-motion = {NAME}.__main__:main",
        ]
    },
    zip_safe=True,
)
