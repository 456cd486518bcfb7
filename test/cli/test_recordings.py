"""Recordings on the command line: `inspect` shows them before the training, `train --bag` learns from them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.skill.skill import Skill

DOWN = (0.0, 1.0, 0.0, 0.0)


def poses(count: int = 4, spoiled: bool = False) -> list[np.ndarray]:
    """Places (T, 3) [m] of a tool in one go at 50 Hz: motions of 54 cm, and back, with standstills between them."""
    share = (0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 100)))[:, None]
    pieces = []
    for number in range(count):
        bulge = (0.04 * number - 0.06) * np.sin(np.pi * share) * [0.8, 0.0, 0.6]
        motion = np.array([0.45, -0.28, 0.32]) + share * [0.03, 0.54, 0.04] + bulge
        if spoiled and number == 2:
            motion = motion[:60]
        if pieces:
            pieces.append(pieces[-1][-1] + share * (motion[0] - pieces[-1][-1]))
        pieces += [np.tile(motion[0], (150, 1)), motion, np.tile(motion[-1], (150, 1))]
    return np.vstack(pieces)


def published(places: np.ndarray) -> list:
    return [
        (100.0 + 0.02 * number, 100.0 + 0.02 * number, ("panda_link0", (*place, *DOWN)))
        for number, place in enumerate(places)
    ]


@pytest.fixture(scope="module")
def good(bag, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bags")
    return bag.write(folder / "reach.mcap", {"/tool": published(poses()), "/note": [(100.0, 0.0, "first try")]})


@pytest.fixture(scope="module")
def spoiled(bag, tmp_path_factory) -> Path:
    places = poses(5, spoiled=True)
    places[200] += 0.3
    return bag.write(tmp_path_factory.mktemp("bags") / "reach", {"/tool": published(places)})


@pytest.mark.usefixtures("brief_training")
def test_a_bag_becomes_a_skill(good, tmp_path, capsys) -> None:
    arguments = ["train", "--bag", str(good), "--out", str(tmp_path / "skill"), "--steps", "30", "--kernels", "20"]
    assert main([*arguments, "--strict"]) in (0, 1)  # written, if it has no motion yet
    provenance = Skill.load(tmp_path / "skill").provenance
    assert provenance["data"] == "reach.mcap"
    assert provenance["demonstrations"] == ["reach_0", "reach_1", "reach_2", "reach_3"]
    assert "3 motions lead back to the start and are passed over" in capsys.readouterr().out
    assert "passed over" in (tmp_path / "skill" / "report.html").read_text()


def test_inspect_shows_demonstrations_and_flaws_and_draws_them(spoiled, tmp_path, capsys) -> None:
    described, picture = tmp_path / "reach.json", tmp_path / "reach.png"
    assert main(["inspect", str(spoiled), "--json", str(described), "--picture", str(picture)]) == 0
    shown, content = capsys.readouterr().out, json.loads(described.read_text())
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [row["learned"] for row in content["demonstrations"]] == ["yes", "yes", "no", "yes", "yes"]
    spike, *back, cut = content["flaws"]
    assert spike["what"].startswith("has a spike of 1 sample, 15")
    assert spike["time"] == pytest.approx(3.98)
    assert [flaw["what"] for flaw in back] == 4 * ["leads back"]
    assert cut["demonstration"] == "reach_2"
    assert cut["what"].startswith("is interrupted: ")
    for row in content["flaws"]:
        assert row["what"] in shown
    assert main(["inspect", str(spoiled), "--strict", "--picture", str(picture)]) == 2
    assert "'reach' has a spike of 1 sample" in capsys.readouterr().err


def test_inspect_reads_whatever_train_reads(recording, tmp_path, capsys) -> None:
    still = np.load(recording)
    still[1] = still[1, 0]
    np.save(tmp_path / "still.npy", still)
    arguments = ["--units", "cm", "--picture", str(tmp_path / "picture.png")]
    assert main(["inspect", str(recording), *arguments]) == 0
    assert "no flaws" in capsys.readouterr().out
    assert main(["inspect", str(tmp_path / "still.npy"), *arguments]) == 2
    printed = capsys.readouterr()
    assert "does not move: 0 mm at most" in printed.out
    assert "demonstration 'still_1' does not move" in printed.err


def test_text_in_one_go_is_split_as_a_bag_is(tmp_path, capsys) -> None:
    rows = [" ".join(map(str, (0.02 * number, *place))) for number, place in enumerate(poses())]
    (tmp_path / "log.txt").write_text("\n".join(["# stamp x y z", *rows]))
    arguments = ["inspect", str(tmp_path / "log.txt"), "--units", "m", "--columns", "t=stamp,px=x,py=y,pz=z"]
    arguments += ["--json", str(tmp_path / "log.json"), "--picture", str(tmp_path / "log.png")]
    assert main(arguments) == 0
    found = json.loads((tmp_path / "log.json").read_text())
    assert [row["name"] for row in found["demonstrations"]] == ["log_0", "log_1", "log_2", "log_3"]
    assert main([*arguments, "--split", "/mark"]) == 2
    assert "topics of markers are in bags" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ("t=stamp,px=x,py=y,pz=z,rx=a,ry=b,rz=c", "is rx,ry,rz a rotation vector, as of UR? Then say rotvec_x=a,"),
        ("t=stamp,px=x,py=y,pz=z", "breaks off between line 401 and line 402, where column 'run' changes: "),
    ],
)
def test_what_a_file_leaves_open_is_asked_before_it_is_shown_or_learned_from(columns, said, tmp_path, capsys) -> None:
    one = poses(1)
    places = np.vstack([one, one])
    rows = [(0.02 * number, *place, 1.0, 0.5, 0.2, number // len(one)) for number, place in enumerate(places)]
    log = tmp_path / "log.txt"
    log.write_text("\n".join(["stamp x y z a b c run", *(" ".join(map(str, row)) for row in rows)]))
    for command in (["inspect", str(log)], ["train", "--demos", str(log), "--out", str(tmp_path / "s")]):
        assert main([*command, "--units", "m", "--columns", columns]) == 2
        assert said in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.txt"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--bag", "{good}", "--topic", "/joints"], "has no topic /joints. The bag has /note (std_msgs/String, 1)"),
        (["--bag", "{good}", "--topic", "/note"], "needed is sensor_msgs/JointState or geometry_msgs/PoseStamped"),
        (["--bag", "{tmp}/none.mcap"], "none.mcap: cannot be read"),
        (["--bag", "{tmp}/cut.mcap"], "cut.mcap: is no readable bag, damaged or cut short"),
        (["--bag", "{good}", "--split", "5"], "give standstill, a topic of markers as /mark, or the beginning"),
        (["--bag", "{good}", "--split", "/mark"], "has no topic /mark; it has /note"),
        (["--bag", "{good}", "--pause", "0"], "must be positive"),
        (["--bag", "{tmp}/empty"], "empty: is no bag: a folder of ROS 2, or a file that ends in .db3"),
        (["--bag", "{tmp}/one_hz"], "'one_hz_0' has 3 samples, 1 a second, at 3.00 s; left out: at least 10"),
        (["--bag", "{good}", "--units", "cm"], "messages have metres"),
        (["--bag", "{good}", "--space", "joint"], "--space joint"),
        (["--bag", "{good}", "--joint-weight", "0.1"], "--joint-weight is for recordings of joints"),
        (["--bag", "{spoiled}", "--strict"], "'reach' has a spike of 1 sample"),
    ],
)  # fmt: skip
def test_what_cannot_be_learned_from_is_said_in_one_line_and_nothing_is_written(
    arguments, said, good, spoiled, bag, tmp_path, capsys
) -> None:
    (file,) = good.glob("*.mcap")
    (tmp_path / "empty").mkdir()
    bag.write(tmp_path / "one_hz", {"/tool": published(poses())[::50]})
    (tmp_path / "cut.mcap").write_bytes(file.read_bytes()[:3000])
    places = {"good": good, "spoiled": spoiled, "tmp": tmp_path}
    command = ["train", *(argument.format(**places) for argument in arguments), "--out", str(tmp_path / "s")]
    assert main(command) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert len(lines) == 1
    assert said in lines[0]
    assert not (tmp_path / "s").exists()


def test_files_of_other_kinds_are_refused_with_what_makes_one_that_is_read(tmp_path, capsys) -> None:
    (tmp_path / "episode.parquet").write_bytes(b"PAR1")
    assert main(["inspect", str(tmp_path / "episode.parquet")]) == 2
    assert "cannot read '.parquet' files, only bags and .npy, .npz, .csv" in capsys.readouterr().err


def test_inspect_of_an_empty_folder_names_both_that_it_could_be(tmp_path, capsys) -> None:
    assert main(["inspect", str(tmp_path)]) == 2
    assert "holds neither a skill (skill.yaml) nor a recording (metadata.yaml" in capsys.readouterr().err


def test_poses_in_another_frame_than_the_base_are_questioned(bag, tmp_path, capsys) -> None:
    """The control: those of the robot's base are not."""
    for frame in ("camera", "panda_link0"):
        rows = [(when, stamp, (frame, pose)) for when, stamp, (_, pose) in published(poses())]
        path = bag.write(tmp_path / frame, {"/tool": rows})
        assert main(["inspect", str(path), "--picture", str(tmp_path / "picture.png")]) == 0
        asked = "has poses in the frame 'camera'" in capsys.readouterr().out
        assert asked == (frame == "camera")


def test_a_bag_and_a_file_are_not_mixed(good, recording, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["train", "--bag", str(good), "--demos", str(recording), "--out", str(tmp_path / "s")])
    assert left.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err
