"""Shared fixtures: where real recordings are, when they are there at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings (GEODESIC_DATA, or shared/data beside the clone); skips where there is none."""
    folder = Path(os.environ.get("GEODESIC_DATA", REPOSITORY.parent / "shared" / "data"))
    if not (folder / "robotasks").is_dir():
        pytest.skip(f"no recordings in {folder}: set GEODESIC_DATA to a folder that holds robotasks/")
    return folder
