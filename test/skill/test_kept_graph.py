"""The latent graph that was kept is the one that would be made, to the last bit, and only as long as it is."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph, build_configuration_graph
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import kept_graph
from geodesic_motion_ros.skill.skill import Skill

SHAPE = (24, 24)


@pytest.fixture
def made(tmp_path: Path, monkeypatch) -> list[str]:
    """An empty cache, and the names of what is made from now on, one each time."""
    makings: list[str] = []

    def make(**recipe) -> ConfigurationGraph:
        makings.append(str(recipe["shape"]))
        return build_configuration_graph(**recipe)

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kept_graph, "build_configuration_graph", make)
    monkeypatch.setattr(kept_graph, "SMALLEST", 1)
    return makings


@pytest.fixture(scope="module")
def skill() -> Skill:
    return Skill.load("ur5_reach")


def kept_files(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "cache" / "graphs").iterdir())


@pytest.mark.parametrize(("learned", "shape"), [("ur5_reach", SHAPE), ("paper_reach", (9, 9, 9))])
def test_it_is_made_once_and_read_to_the_last_bit(learned, shape, made, tmp_path):
    """Also of the raw sheet, whose nodes have no shares of mean paths: an array without numbers."""
    first, again = Skill.load(learned).graph(shape), Skill.load(learned).graph(shape)
    assert len(made) == 1
    assert len(kept_files(tmp_path)) == 1
    made_arrays, read_arrays = first.arrays(), again.arrays()
    assert made_arrays.keys() == read_arrays.keys()
    for name, array in made_arrays.items():
        read = read_arrays[name]
        assert array.tobytes() == read.tobytes(), name
        # Kernels are compiled for a type, an order of the elements, and arrays that can be written to.
        assert (array.dtype, array.shape, array.strides) == (read.dtype, read.shape, read.strides), name
        assert read.flags.writeable, name
    at = np.full(len(shape), 0.1)
    for one, other in zip(first.progress_map(at[None]), again.progress_map(at[None]), strict=True):
        np.testing.assert_array_equal(one, other)
    assert first.grid.shape == again.grid.shape
    assert (first.sigma_limit, first.energy_limit) == (again.sigma_limit, again.energy_limit)


def test_whatever_it_follows_from_has_a_graph_of_its_own(skill, made, monkeypatch):
    skill.graph(SHAPE)
    weights = skill.decoder.arrays()
    nudged = skill.decoder.from_arrays(weights | {"b3": weights["b3"] + 1e-12})
    for other in (
        replace(skill, decoder=nudged),
        replace(skill, energy_per_edge=2.0 * skill.energy_per_edge),
        replace(skill, metric=replace(skill.metric, joint_weight=0.06)),
        replace(skill, codes=skill.codes[:, ::-1]),
    ):
        before = len(made)
        other.graph(SHAPE)
        assert len(made) == before + 1
    skill.graph((24, 25))
    assert len(made) == 6
    monkeypatch.setattr(kept_graph, "_made_by", lambda: "other code")
    skill.graph(SHAPE)
    assert len(made) == 7
    moved = Robot.named("ur5")
    moved.chain = (moved.chain[0], moved.chain[1] + 1e-6, *moved.chain[2:])
    monkeypatch.setattr(Robot, "named", lambda name: moved)
    skill.graph(SHAPE)
    assert len(made) == 8
    skill.graph(SHAPE)
    assert len(made) == 8


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty", "no arrays", "a folder"])
def test_a_damaged_file_is_made_anew(skill, made, damage, tmp_path):
    skill.graph(SHAPE)
    [file] = kept_files(tmp_path)
    whole = file.read_bytes()
    if damage == "flipped":
        middle = len(whole) // 2
        file.write_bytes(whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :])
    elif damage == "a folder":
        file.unlink()
        file.mkdir()
    else:
        file.write_bytes({"cut": whole[:-5000], "empty": b"", "no arrays": b"PK" + bytes(100)}[damage])
    graph = skill.graph(SHAPE)
    assert len(made) == 2
    assert len(graph.edges) > 100
    if damage != "a folder":
        assert file.read_bytes() == whole
        skill.graph(SHAPE)
        assert len(made) == 2


def test_nothing_is_half_written(skill, made, monkeypatch, tmp_path, capsys):
    def full(stream, **arrays) -> None:
        stream.write(b"PK half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    assert len(skill.graph(SHAPE).edges) > 100
    assert kept_files(tmp_path) == []
    assert "ur5_reach could not be kept: [Errno 28] No space left on device" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["no folder", "a file in the place of the folder"])
def test_without_a_place_it_is_made_each_time(skill, made, place, monkeypatch, tmp_path, capsys):
    if place == "no folder":
        monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/cache")
    else:
        (tmp_path / "cache").mkdir()
        (tmp_path / "cache" / "graphs").write_text("")
    for _ in range(2):
        assert len(skill.graph(SHAPE).edges) > 100
    assert len(made) == 2
    assert ("could not be kept" in capsys.readouterr().err) == (place != "no folder")


def test_two_at_once_leave_one_whole_file(skill, made, tmp_path):
    both = threading.Barrier(2)

    def start(_: int) -> ConfigurationGraph:
        both.wait()
        return skill.graph(SHAPE)

    with ThreadPoolExecutor(2) as threads:
        one, other = threads.map(start, range(2))
    np.testing.assert_array_equal(one.sigma_shares, other.sigma_shares)
    assert len(kept_files(tmp_path)) == 1
    before = len(made)
    skill.graph(SHAPE)
    assert len(made) == before


def test_what_was_not_used_for_longest_goes_first(skill, made, monkeypatch, tmp_path):
    skill.graph(SHAPE)
    [oldest] = kept_files(tmp_path)
    skill.graph((24, 25))
    [middle] = [file for file in kept_files(tmp_path) if file != oldest]
    for file, age in ((oldest, 20.0), (middle, 10.0)):  # a file system's clock has steps
        os.utime(file, (time.time() - age,) * 2)
    skill.graph(SHAPE)  # used again, after the other one
    assert oldest.stat().st_mtime_ns > middle.stat().st_mtime_ns
    monkeypatch.setattr(kept_graph, "LARGEST_CACHE", int(2.5 * oldest.stat().st_size))
    skill.graph((25, 24))
    assert oldest in kept_files(tmp_path)
    assert middle not in kept_files(tmp_path)
    assert len(kept_files(tmp_path)) == 2


def test_a_small_graph_is_not_kept(skill, made, monkeypatch, tmp_path):
    monkeypatch.setattr(kept_graph, "SMALLEST", 1_000_000)
    skill.graph(SHAPE)
    assert not (tmp_path / "cache" / "graphs").exists()


def test_what_takes_long_is_announced(skill, made, monkeypatch, capsys):
    def make(**recipe) -> ConfigurationGraph:
        for thread in threading.enumerate():
            if isinstance(thread, threading.Timer):
                thread.join()
        return build_configuration_graph(**recipe)

    monkeypatch.setattr(kept_graph, "build_configuration_graph", make)
    monkeypatch.setattr(kept_graph, "_SILENT_FOR", 0.0)
    skill.graph(SHAPE)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "building the latent graph of ur5_reach, once: this may take a minute"
    assert second.startswith("built the latent graph of ur5_reach in ")
    skill.graph(SHAPE)
    assert capsys.readouterr().err == ""
