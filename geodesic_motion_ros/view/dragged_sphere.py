"""A sphere on the page that a user drags: by itself, or along an axis by the arrows of its gizmo."""

from __future__ import annotations

import numpy as np
import viser

_COLOUR = (222, 66, 54)


class DraggedSphere:
    """A sphere of a number and a radius [m]."""

    def __init__(self, scene: viser.SceneApi, number: int, centre: np.ndarray, radius: float) -> None:
        """centre : (3,) [m], where it begins."""
        self.number, self.radius = number, radius
        name = f"/dragged/{number}"
        self._gizmo = scene.add_transform_controls(
            name, scale=2.4 * radius, disable_rotations=True, disable_sliders=True, position=centre, depth_test=False,
            line_width=2.0,
        )  # fmt: skip
        # Within what the planner counts, which is as large at least: the surfaces do not coincide.
        self._ball = scene.add_icosphere(f"{name}/ball", 0.97 * radius, color=_COLOUR, subdivisions=4)
        self._label = scene.add_label(
            f"{name}/label", "drag me", position=(0.0, 0.0, 1.3 * radius), anchor="bottom-center"
        )
        self._grip = np.zeros(3)
        self._ball.on_drag(self._drag)
        self._gizmo.on_update(lambda _: self._hide_label())

    @property
    def centre(self) -> np.ndarray:
        """Where it is (3,) [m]."""
        return np.array(self._gizmo.position)

    @centre.setter
    def centre(self, centre: np.ndarray) -> None:
        self._gizmo.position = centre

    def remove(self) -> None:
        """Take it from the page."""
        self._gizmo.remove()

    def _drag(self, event: viser.SceneNodeDragEvent) -> None:
        """Follow the pointer in the plane of the camera that it was grabbed in."""
        pointer = np.array(event.end_position)
        if event.phase == "start":
            self._grip = self.centre - pointer
        self.centre = pointer + self._grip
        self._hide_label()

    def _hide_label(self) -> None:
        if self._label.visible:
            self._label.visible = False
