"""The page: an arm, what its planner shows, and a panel beside it; with control, what a user drags and presses.

What is pressed waits in `take_requests`, what is dragged in `spheres` and `goal`, for who talks to the planner to
fetch: the browser's threads touch nothing else.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_ros.view.words import SILENT, SaidStatus

try:
    import viser
except ModuleNotFoundError as error:
    raise GeodesicMotionError(
        "viser, which shows the page, is not installed: pip install 'geodesic_motion_ros[view]'; in the repository "
        "`make view` does it"
    ) from error

from geodesic_motion_ros.view.dragged_sphere import DraggedSphere
from geodesic_motion_ros.view.drawn_arm import DrawnArm
from geodesic_motion_ros.view.shown_shapes import ShownShapes

#: How far an arm reaches until its URDF is known [m].
_REACH = 1.2
#: Where the camera stands, what it looks at, and the middle of where the arm works, in reaches.
_CAMERA, _LOOK_AT, _WORK = (1.3, -0.95, 0.85), (0.24, 0.0, 0.26), (0.45, -0.05, 0.25)
#: Where the first sphere is, as the camera sees it, to the right of and above that middle, and each next one from
#: there, in reaches: as far from the camera as the middle, so that a mouse drags it right there.
_FIRST, _NEXT = (0.25, 0.25), (-0.14, 0.0)
_FIELD_OF_VIEW = 0.75
#: Widths of the status and of the picture of the latent space [pixels].
_STATUS, _LATENT = 330, 250
#: Radii of spheres [m]: the smallest, the largest and the first.
_RADII = (0.02, 0.15, 0.055)


class _Server(viser.ViserServer):
    """A server that no page can ask to make it public."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        return None


class Page:
    """The page and its server.

    Attributes
    ----------
    shapes : what the planner shows.
    """

    def __init__(self, host: str, port: int, title: str, control: bool, goal: Pose | None, repeat: bool) -> None:
        """host, port : where it is served; where the port is taken the next free one. title : above the panel.

        control : whether there is anything to drag and to press. goal : where its gizmo begins; None: there is none.
        repeat : whether the motion is to be repeated from the start on.
        """
        self._server = server = _Server(host=host, port=port, label=title, verbose=False)
        scene, gui = server.scene, server.gui
        scene.set_up_direction("+z")
        scene.add_grid(
            "/floor", 4.0, 4.0, cell_size=0.1, section_size=0.5, cell_color=(222, 226, 230),
            section_color=(190, 196, 202), plane_color=(248, 249, 250), plane_opacity=1.0, shadow_opacity=0.2,
            position=(0.0, 0.0, -0.002),
        )  # fmt: skip
        scene.configure_environment_map("studio", environment_intensity=0.4)
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()
        server.initial_camera.fov = _FIELD_OF_VIEW
        self.shapes = ShownShapes(scene)
        self._arm: DrawnArm | None = None
        self._reach = _REACH
        self._look_at_arm()
        self._requests: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._spheres: list[DraggedSphere] = []
        self._removed: list[int] = []
        self._numbers = 0
        self._goal: viser.TransformControlsHandle | None = None
        # Once it is known how far the arm reaches.
        self._add_first: Callable[[], None] = _nothing
        self._said = SILENT
        # Apart from what is pressed, which would move as lines come and go above it.
        status = gui.add_panel()
        with status.add_tab("Status"):
            self._status = gui.add_markdown(SILENT.markdown)
            self._answer = gui.add_markdown("", visible=False)
        status.float(x=16, y=16, width=_STATUS)
        self._latent: viser.GuiImageHandle | None = None
        if control:
            self._add_controls(goal, repeat)
        with gui.add_folder("Show"):
            body = gui.add_checkbox("Spheres of the arm", False, hint="what the certificate keeps away from obstacles")
            body.on_update(lambda _: setattr(self.shapes, "is_body_shown", body.value))

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def clients(self) -> list[viser.ClientHandle]:
        """The browsers that show it, each with its camera."""
        return list(self._server.get_clients().values())

    def stop(self) -> None:
        """End the server."""
        self._server.stop()

    # ------------------------------------------------------------------ what a user wants

    @property
    def goal(self) -> Pose | None:
        """Where the gizmo of the goal is."""
        return None if self._goal is None else Pose(np.array(self._goal.position), np.array(self._goal.wxyz))

    @property
    def spheres(self) -> list[tuple[int, np.ndarray, float]]:
        """The spheres that are dragged: numbers, centres (3,) and radii [m]."""
        return [(one.number, one.centre, one.radius) for one in tuple(self._spheres)]

    def take_removed(self) -> list[int]:
        """Return the numbers of spheres that were removed since the last call."""
        with self._lock:
            removed, self._removed = self._removed, []
        return removed

    def take_requests(self) -> dict[str, Any]:
        """Return what was pressed since the last call, the newest of each kind: `go` and `reset` (None), `hold` and
        `repeat` (bool), `speed` (float).
        """
        with self._lock:
            requests, self._requests = self._requests, {}
        return requests

    def drag(self, number: int, centre: np.ndarray) -> None:
        """Drag the sphere of a number to a centre (3,) [m]."""
        next(one for one in self._spheres if one.number == number).centre = centre

    def remove_sphere(self) -> None:
        """Remove the newest sphere; harmless where there is none."""
        if self._spheres:
            sphere = self._spheres.pop()
            sphere.remove()
            with self._lock:
                self._removed.append(sphere.number)

    def press(self, name: str, value: Any = None) -> None:
        """Press what makes a request: see `take_requests`."""
        with self._lock:
            self._requests[name] = value

    # ------------------------------------------------------------------ what is shown

    def draw_arm(self, urdf: str, base_frame: str) -> list[str]:
        """Show the arm of a URDF, in the place of the one before; returns what of it cannot be drawn, a line each.

        Raises
        ------
        RobotError : as of `DrawnArm`.
        """
        if self._arm is not None:
            self._arm.remove()
        self._arm = DrawnArm(self._server.scene, urdf, base_frame)
        self._reach = self._arm.reach or _REACH
        self._look_at_arm()
        self._add_first()
        self._add_first = _nothing
        return self._arm.missing

    def place_arm(self, positions: Mapping[str, float]) -> None:
        """Move the joints of the arm to positions [rad, m], by name."""
        if self._arm is not None:
            self._arm.place(positions)

    def show_status(self, said: SaidStatus) -> None:
        """Show what the planner says."""
        if said.markdown != self._said.markdown:
            self._status.content = said.markdown
        self._said = said

    def show_answer(self, text: str) -> None:
        """Show what came of a request."""
        self._answer.content, self._answer.visible = f"*{text}*", bool(text)

    def show_latent(self, pixels: np.ndarray) -> None:
        """Show a picture (h, w, 3) uint8 of the latent space."""
        if self._latent is None:
            panel = self._server.gui.add_panel()
            with panel.add_tab("Latent space"):
                self._latent = self._server.gui.add_image(pixels, format="jpeg")
            panel.float(x=16, y=-16, width=_LATENT)
        self._latent.image = pixels

    def updating(self) -> Any:
        """Return a context in which what changes is shown at once."""
        return self._server.atomic()

    # ------------------------------------------------------------------ inside

    def _look_at_arm(self) -> None:
        camera = self._server.initial_camera
        camera.position, camera.look_at = self._reach * np.array(_CAMERA), self._reach * np.array(_LOOK_AT)

    def _add_controls(self, goal: Pose | None, repeat: bool) -> None:
        gui, scene = self._server.gui, self._server.scene
        if goal is not None:
            self._goal = scene.add_transform_controls(
                "/goal", scale=0.16, position=goal.position, wxyz=goal.quaternion, depth_test=False, line_width=2.0
            )
            scene.add_label("/goal/label", "goal", position=(0.0, 0.0, 0.0), anchor="top-left")
        with gui.add_folder("Motion"):
            presses = {"To the goal": "go", "Reset the twin": "reset"}
            buttons = gui.add_button_group("Arm", tuple(presses))
            buttons.on_click(lambda _: self.press(presses[buttons.value]))
            for name, label, value, hint in (
                ("repeat", "Repeat", repeat, "a reset of the twin once it has arrived, and again"),
                ("hold", "Hold", False, "the arm comes to rest on its path"),
            ):
                box = gui.add_checkbox(label, value, hint=hint)
                box.on_update(lambda _, name=name, box=box: self.press(name, box.value))
            speed = gui.add_slider("Speed", 0.0, 1.0, 0.05, 1.0, hint="share of it: the planner's speed_override")
            speed.on_update(lambda _: self.press("speed", speed.value))
        with gui.add_folder("Obstacles"):
            smallest, largest, first = _RADII
            radius = gui.add_slider("Radius [m]", smallest, largest, 0.005, first, hint="of the next sphere")
            changes = {"Add a sphere": lambda: self._add_sphere(radius.value), "Remove one": self.remove_sphere}
            spheres = gui.add_button_group("Spheres", tuple(changes))
            spheres.on_click(lambda _: changes[spheres.value]())
        self._add_first = lambda: self._add_sphere(first)

    def _add_sphere(self, radius: float) -> None:
        look = np.array(_LOOK_AT) - _CAMERA
        right = np.cross(look, (0.0, 0.0, 1.0))
        axes = np.stack([right, np.cross(right, look)])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        place = _WORK + (np.array(_FIRST) + len(self._spheres) * np.array(_NEXT)) @ axes
        self._spheres.append(DraggedSphere(self._server.scene, self._numbers, self._reach * place, radius))
        self._numbers += 1


def _nothing() -> None:
    pass
