from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small file in centimetres: four reaches that bulge differently far and turn the tool."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    items = []
    for bulge in (-8.0, -3.0, 3.0, 8.0):
        bent = bulge * np.sin(np.pi * share) * [0.8, 0.0, 0.6]
        positions = [45.0, -28.0, 32.0] + share * [3.0, 54.0, 4.0] + bent
        half = 0.25 * share
        zero = np.zeros_like(half)
        items.append(np.hstack([positions, zero, np.cos(half), np.sin(half), zero]))
    path = tmp_path_factory.mktemp("recording") / "reach.npy"
    np.save(path, np.array(items))
    return path
