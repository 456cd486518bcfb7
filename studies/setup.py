"""Package description of the studies, for pip: what measures geodesic_motion_ros, and its commands.

    pip install ./studies
"""

from setuptools import find_packages, setup

NAME = "geodesic_motion_studies"

setup(
    name=NAME,
    version="0.2.0",
    description="Experiments, comparisons and fault injection for geodesic_motion_ros",
    author="geodesic_motion_ros maintainers",
    author_email="maintainers@example.org",
    license="Apache-2.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    python_requires=">=3.10",
    install_requires=["geodesic_motion_ros[learn,simulation]"],
    extras_require={
        # Predictors that `evaluate` and `train --held-out` compare with.
        "peers": ["movement_primitives", "pytransform3d"],
        # Methods that `benchmark` compares with; what is not installed is left out there.
        "benchmark": ["movement_primitives", "pytransform3d", "ompl", "pin", "pin-pink", "daqp", "roboplan-rrt"],
        # What `timing` compares the search with.
        "timing": ["igraph", "networkit", "networkx"],
    },
    entry_points={"geodesic_motion_ros.commands": [f"studies = {NAME}.cli:STUDIES"]},
    zip_safe=True,
)
