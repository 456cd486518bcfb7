"""What a planner shows, on the page: path, obstacles as it counts them, declared scene, spheres of the arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from geodesic_motion_ros.view.shape import BODY, Shape

_BALL, _BOX = trimesh.creation.icosphere(subdivisions=2), trimesh.creation.box()


class ShownShapes:
    """The shapes on a page; what has not changed is not sent again.

    Attributes
    ----------
    path : (n, 3) [m], of the planner; empty without one.
    is_body_shown : whether the spheres that stand for the arm are.
    """

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._nodes: dict[tuple[str, int], tuple[object, Any]] = {}
        self._body: dict[int, Shape] = {}
        self._balls: Any = None
        self.path = np.zeros((0, 3))
        self.is_body_shown = False

    def put(self, shapes: Iterable[Shape]) -> None:
        """Show shapes, in the place of those with their names."""
        for shape in shapes:
            if shape.group == BODY:
                self._body[shape.number] = shape
                continue
            if shape.group == "path":
                self.path = shape.points
            key = shape.group, shape.number
            points = shape.points.tobytes() if shape.kind == "boxes" else len(shape.points)
            look = shape.kind, shape.size, shape.colour, points
            if key not in self._nodes or self._nodes[key][0] != look:
                self._drop(key)
                self._nodes[key] = look, self._made(shape)
            node = self._nodes[key][1]
            if shape.kind == "line":
                node.points = _segments(shape.points)
            elif (moved := (shape.position, shape.wxyz)) != (tuple(node.position), tuple(node.wxyz)):
                node.position, node.wxyz = moved
        self._show_body()

    def remove(self, keys: Iterable[tuple[str, int]]) -> None:
        """Remove shapes by group and number; harmless where there are none."""
        for key in keys:
            self._drop(key)
            if key[0] == "path":
                self.path = np.zeros((0, 3))

    def _drop(self, key: tuple[str, int]) -> None:
        if (known := self._nodes.pop(key, None)) is not None:
            known[1].remove()
        elif key[0] == BODY:
            self._body.pop(key[1], None)

    def _show_body(self) -> None:
        """Show the arm's spheres as one node, for there are dozens; they are sent only where somebody looks."""
        shapes = list(self._body.values()) if self.is_body_shown else []
        if self._balls is not None and len(self._balls.batched_positions) != len(shapes):
            self._balls.remove()
            self._balls = None
        if not shapes:
            return
        positions = np.array([shape.position for shape in shapes], dtype=np.float32)
        radii = np.array([0.5 * shape.size[0] for shape in shapes], dtype=np.float32)
        if self._balls is None:
            self._balls = self._batch("/planner/body", _BALL, shapes[0].colour, positions, radii)
        self._balls.batched_positions = positions

    def _batch(
        self, name: str, mesh: trimesh.Trimesh, colour: Sequence[float], positions: np.ndarray, scales: np.ndarray
    ) -> Any:
        upright = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (len(positions), 1))
        return self._scene.add_batched_meshes_simple(
            name, mesh.vertices, mesh.faces, upright, positions, batched_scales=scales, batched_colors=_rgb(colour),
            opacity=colour[3], cast_shadow=False,
        )  # fmt: skip

    def _made(self, shape: Shape) -> Any:
        name, colour, opacity = f"/planner/{shape.group}/{shape.number}", _rgb(shape.colour), shape.colour[3]
        look = {"color": colour, "opacity": None if opacity >= 1.0 else opacity, "cast_shadow": opacity > 0.3}
        if shape.kind == "sphere":
            return self._scene.add_icosphere(name, 0.5 * shape.size[0], subdivisions=4, **look)
        if shape.kind == "box":
            return self._scene.add_box(name, dimensions=shape.size, **look)
        if shape.kind == "cylinder":
            return self._scene.add_cylinder(name, 0.5 * shape.size[0], shape.size[2], radial_segments=40, **look)
        if shape.kind == "boxes":
            edges = np.full(len(shape.points), shape.size[0], dtype=np.float32)
            return self._batch(name, _BOX, shape.colour, shape.points.astype(np.float32), edges)
        return self._scene.add_line_segments(name, _segments(shape.points), colour, thickness=shape.size[0])


def _segments(points: np.ndarray) -> np.ndarray:
    """Segments (n - 1, 2, 3) of a line."""
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def _rgb(colour: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (int(255 * part) for part in colour[:3])
    return red, green, blue
