"""The figures, of invented outcomes."""

from __future__ import annotations

from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.figures import draw_clearances, draw_success
from geodesic_motion_studies.comparison.report import Report
from geodesic_motion_studies.comparison.results import Played


def test_figures_are_drawn_where_a_row_has_no_success_and_a_panel_no_scene(tmp_path) -> None:
    common = {
        "refusal": "", "duration": 6.0, "clearance": 0.05, "dtw": 0.0, "orientation": 0.1, "jerk": 10.0,
        "replans": (0.001,), "ticks": 100, "in_time": 99,
    }  # fmt: skip
    good = Outcome(mostly_free=True, reached=True, contact="", **common)
    hit = Outcome(mostly_free=True, reached=False, contact="moving", **common)
    # Of nine successes in nine, the interval's upper end is not 1 but for rounding.
    played = [Played("ours", "gate", i, {}, good) for i in range(9)] + [Played("replay", "gate", 0, {}, hit)]
    report = Report("reach", 0, played, {"ours": "geodesics", "replay": "the control"}, held_out=True)
    for draw in (draw_success, draw_clearances):
        draw(report, tmp_path / "figure.png")
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
        (tmp_path / "figure.png").unlink()
