"""Ticks a second of planner and twin as two processes, as `studies.rates` measures them; needs ROS when it runs.

`rate`: with a goal that stays or moves, a moving sphere, and clouds; with a skill of joint space also the time from an
obstacle's message to the trajectory that answers it. `paper-rate`: the same of the paper's planner in both spaces, and
how often a tick ends with the cheapest path. `camera`: a depth camera sees the arm that moves, for minutes: what stops
the arm, what clouds cost; and a ball beside the forearm, place after place, in the cloud and not. `view-rate`: what a
page in the browser costs, and from a sphere that is dragged there to the trajectory that answers it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.study import Report, Study, option

if TYPE_CHECKING:
    from geodesic_motion_studies.rates.camera_stream import BallRow, MinutesRow
    from geodesic_motion_studies.rates.chunk_time import ChunkRow
    from geodesic_motion_studies.rates.node_rate import RateRow
    from geodesic_motion_studies.rates.reaction_time import ReactionRow
    from geodesic_motion_studies.rates.view_rate import ViewRow


@dataclass(frozen=True)
class RateReport(Report):
    """Rows of rates, and of reactions where they were timed."""

    rows: Sequence[RateRow]
    reactions: Sequence[ReactionRow] = ()

    def as_dict(self) -> dict[str, Any]:
        reactions = {"reactions": [asdict(row) for row in self.reactions]} if self.reactions else {}
        return {"rows": [asdict(row) for row in self.rows], **reactions}

    def table(self) -> str:
        from geodesic_motion_studies.rates import node_rate, reaction_time

        tables = [node_rate.table(self.rows)]
        if self.reactions:
            tables.append(reaction_time.table(self.reactions))
        return "\n\n".join(tables)

    def draw(self, path: Path) -> None:
        """There is none."""


@dataclass(frozen=True)
class Rate(Study):
    """The nodes with one skill."""

    skill: str = option("panda_pouring", "its folder, or a shipped name", metavar="SKILL")
    rates: tuple[float, ...] = option((100.0,), "of the planner", type=metres, metavar="HZ,HZ")
    seconds: float = option(8.0, "length of each stretch")
    goals_hz: float = option(10.0, "new goals a second")
    obstacles: int = option(10, "spheres beside the path")
    spheres: int = option(100, "that appear on the path, to time answers; 0: none")

    def measure(self, out: Path) -> RateReport:
        from geodesic_motion_studies.rates import node_rate, reaction_time

        folder = out / "rate"
        rows = node_rate.measure_rates(
            self.skill, folder, self.rates, self.seconds, self.goals_hz, self.obstacles
        )  # fmt: skip
        if self.spheres <= 0 or Skill.load(self.skill).space != "joint":
            return RateReport(rows)
        return RateReport(rows, reaction_time.measure_reaction(self.skill, folder, self.rates, self.spheres))


@dataclass(frozen=True)
class PaperRate(Study):
    """The nodes with the paper's planner."""

    rate: float = option(100.0, "of the planner", metavar="HZ")
    seconds: float = option(8.0, "length of each stretch")

    def measure(self, out: Path) -> RateReport:
        from geodesic_motion_studies.rates import node_rate

        return RateReport(node_rate.measure_paper(out / "paper-rate", self.rate, self.seconds))


@dataclass(frozen=True)
class ChunkTimeReport(Report):
    """Rows of a filter, and of a node that forwards."""

    rows: Sequence[ChunkRow]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) for row in self.rows]}

    def table(self) -> str:
        from geodesic_motion_studies.rates import chunk_time

        return chunk_time.table(list(self.rows))

    def draw(self, path: Path) -> None:
        """There is none."""


@dataclass(frozen=True)
class ChunkTime(Study):
    """A filter that chunks are offered to."""

    hertz: float = option(50.0, "chunks a second")
    chunks: int = option(1000, "that are offered to each node", least=1)

    def measure(self, out: Path) -> ChunkTimeReport:
        from geodesic_motion_studies.rates import chunk_time

        return ChunkTimeReport(chunk_time.measure_chunks(out / "chunk-time", self.hertz, self.chunks))


@dataclass(frozen=True)
class ViewReport(Report):
    """Rows of who looks, and of drags."""

    rows: Sequence[ViewRow]
    drags: Sequence[ReactionRow]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) for row in self.rows], "drags": [asdict(row) for row in self.drags]}

    def table(self) -> str:
        from geodesic_motion_studies.rates import reaction_time, view_rate

        return "\n\n".join([view_rate.table(self.rows), reaction_time.table(list(self.drags))])

    def draw(self, path: Path) -> None:
        """There is none."""


@dataclass(frozen=True)
class ViewRate(Study):
    """The nodes with a page in the browser."""

    skill: str = option("panda_reach_to_grasp", "its folder, or a shipped name", metavar="SKILL")
    seconds: float = option(20.0, "length of each stretch")
    drags: int = option(50, "of the page's sphere into the path", least=1)

    def measure(self, out: Path) -> ViewReport:
        from geodesic_motion_studies.rates import view_rate

        folder = out / "view-rate"
        rows = view_rate.measure_view(self.skill, folder, self.seconds)
        return ViewReport(rows, view_rate.measure_drags(self.skill, folder, self.drags))


@dataclass(frozen=True)
class CameraReport(Report):
    """What minutes have shown, and rows of balls."""

    minutes: MinutesRow
    balls: Sequence[BallRow]

    def as_dict(self) -> dict[str, Any]:
        return {"minutes": asdict(self.minutes), "balls": [asdict(row) for row in self.balls]}

    def table(self) -> str:
        from geodesic_motion_studies.rates import camera_stream

        tables = [camera_stream.minutes_table(self.minutes)]
        if self.balls:
            tables.append(camera_stream.balls_table(self.balls))
        return "\n\n".join(tables)

    def draw(self, path: Path) -> None:
        """There is none."""


@dataclass(frozen=True)
class Camera(Study):
    """The nodes with a camera that sees a Panda."""

    minutes: float = option(10.0, "for which the arm goes to and fro")
    points: int = option(300_000, "of a cloud, or a few more", least=1)
    balls: int = option(10, "places of a ball beside the forearm, one after the other; 0: none", least=0)
    seed: int = option(0, "of these places")
    rate: float = option(100.0, "of the planner", metavar="HZ")

    def measure(self, out: Path) -> CameraReport:
        from geodesic_motion_studies.rates import camera_stream

        folder, skill = out / "camera", camera_stream.SKILL
        minutes = camera_stream.measure_minutes(skill, folder, self.minutes, self.points, self.rate)
        places = camera_stream.ball_places(Skill.load(skill), self.balls, self.points, self.seed)
        return CameraReport(minutes, camera_stream.measure_balls(skill, folder, places, self.points, self.rate))
