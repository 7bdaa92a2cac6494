"""A picture of a robot: its shapes over a level chequered ground, by casting a ray through every pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Direction to the light, and colours: red, green, blue from 0 to 1.
_LIGHT = np.array([-0.4, -0.5, 0.77])
_SKY, _LIGHT_SQUARE, _DARK_SQUARE = np.array([[0.86, 0.91, 0.96], [0.80, 0.82, 0.84], [0.66, 0.69, 0.72]])
_BASE, _LIMB = np.array([[0.23, 0.27, 0.33], [0.85, 0.47, 0.18]])
#: Edge of a square of the ground, m, and the distance at which the ground fades into the sky, m.
_SQUARE, _FAR = 0.25, 12.0
#: Field of view from top to bottom, rad.
_VIEW = 0.7


class Camera:
    """Looks from ``eye`` at ``target``, m, world frame, with z upward in the picture."""

    def __init__(self, eye: Array, target: Array, width: int, height: int) -> None:
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self.eye, self.axes = eye, np.stack([right, np.cross(right, ahead), ahead])
        self.width, self.height, self.focus = width, height, 0.5 * height / np.tan(0.5 * _VIEW)

    def pixel(self, point: Array) -> tuple[float, float, float]:
        """Column and row of a point, and how far ahead it is, m."""
        x, y, z = self.axes @ (point - self.eye)
        ahead = max(float(z), 1e-6)
        return 0.5 * self.width + self.focus * x / ahead, 0.5 * self.height - self.focus * y / ahead, float(z)

    def rays(self, columns: slice, rows: slice) -> Array:
        """Directions through pixels, shape ``(rows, columns, 3)``."""
        x = (np.arange(self.width)[columns] + 0.5 - 0.5 * self.width) / self.focus
        y = (0.5 * self.height - np.arange(self.height)[rows] - 0.5) / self.focus
        grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        directions: Array = grid @ self.axes
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return directions

    def around(self, centre: Array, radius: float) -> tuple[slice, slice] | None:
        """Columns and rows in which a ball can be seen; ``None`` where it cannot."""
        x, y, ahead = self.pixel(centre)
        if ahead <= radius:
            return None
        reach = self.focus * radius / (ahead - radius) + 1.0
        columns = slice(max(0, int(x - reach)), min(self.width, int(x + reach) + 1))
        rows = slice(max(0, int(y - reach)), min(self.height, int(y + reach) + 1))
        return (columns, rows) if columns.start < columns.stop and rows.start < rows.stop else None


def picture(shape: Mapping[str, Any], pose: tuple[Sequence[float], ...], width: int, height: int) -> NDArray[np.uint8]:
    """The robot ``shape`` at ``pose`` (position and orientation of the base, joint angles), seen from the side, ahead and
    above; red, green and blue of each pixel, shape ``(height, width, 3)``."""
    base = np.asarray(pose[0], float)
    frames = _frames(shape["bodies"], base, np.asarray(pose[1], float), pose[2])
    bounds = [_bound(one["shape"]) + float(np.linalg.norm(one["position"])) for one in shape["geoms"]]
    reach = max([float(np.linalg.norm(frames[one["body"]][0] - base)) + r for one, r in zip(shape["geoms"], bounds)], default=0.5)
    eye = base + 3.2 * reach * np.array([0.55, -0.85, 0.32])
    camera = Camera(np.array([eye[0], eye[1], max(eye[2], 0.1)]), base, width, height)
    everywhere = (slice(0, width), slice(0, height))
    image, depth = _ground(camera, camera.rays(*everywhere))
    for one in shape["geoms"]:
        position, turn = frames[one["body"]]
        centre = position + turn @ np.asarray(one["position"], float)
        seen = camera.around(centre, _bound(one["shape"]))
        if seen is None:
            continue
        columns, rows = seen
        rays = camera.rays(columns, rows)
        distance, normal = _hit(one["shape"], centre, turn @ _matrix(one["quaternion"]), camera.eye, rays)
        nearer = distance < depth[rows, columns]
        light = 0.45 + 0.55 * np.clip(normal @ _LIGHT, 0.0, 1.0)
        colour = _BASE if one["body"] == 0 else _LIMB
        depth[rows, columns][nearer] = distance[nearer]
        image[rows, columns][nearer] = (light[..., None] * colour)[nearer]
    return (255.0 * np.clip(image, 0.0, 1.0)).astype(np.uint8)


def _frames(bodies: Sequence[Mapping[str, Any]], base: Array, turn: Array, angles: Sequence[float]) -> list[tuple[Array, Array]]:
    """Position and rotation of each body in the world."""
    frames = [(base, _matrix(turn))]
    for body in bodies[1:]:
        position, rotation = frames[body["parent"]]
        position = position + rotation @ np.asarray(body["position"], float)
        rotation = rotation @ _matrix(body["quaternion"])
        joint = body["joint"]
        if joint is not None and joint["slides"]:
            along = np.asarray(joint["axis"], float)
            position = position + rotation @ along * (angles[joint["index"]] / np.linalg.norm(along))
        elif joint is not None:
            # A turn about the anchor: the anchor stays where it is.
            anchor = position + rotation @ np.asarray(joint["anchor"], float)
            rotation = rotation @ _about(np.asarray(joint["axis"], float), angles[joint["index"]])
            position = anchor - rotation @ np.asarray(joint["anchor"], float)
        frames.append((position, rotation))
    return frames


def _matrix(quaternion: Sequence[float] | Array) -> Array:
    """The rotation of a quaternion, wxyz."""
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def _about(axis: Array, angle: float) -> Array:
    unit = axis / np.linalg.norm(axis)
    return _matrix([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * unit)])


def _bound(shape: Mapping[str, Any]) -> float:
    """Radius of a ball around a shape, m."""
    kind, size = next(iter(shape.items()))
    if kind == "box":
        return float(np.linalg.norm(size["half"]))
    return float(size["radius"]) + float(size.get("half_length", 0.0))


def _hit(shape: Mapping[str, Any], centre: Array, turn: Array, eye: Array, rays: Array) -> tuple[Array, Array]:
    """Distance along each ray to a shape, infinite where it is missed, and the outward normal. Cylinders have round ends."""
    kind, size = next(iter(shape.items()))
    if kind == "box":
        return _hit_box(np.asarray(size["half"], float), centre, turn, eye, rays)
    half = float(size.get("half_length", 0.0))
    return _hit_capsule(centre - half * turn[:, 2], centre + half * turn[:, 2], float(size["radius"]), eye, rays)


def _hit_box(half: Array, centre: Array, turn: Array, eye: Array, rays: Array) -> tuple[Array, Array]:
    start, along = turn.T @ (eye - centre), rays @ turn
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-half - start) / along, (half - start) / along])
    near, far = ends.min(axis=0), ends.max(axis=0)
    axis = near.argmax(axis=-1)
    first, last = near.max(axis=-1), far.min(axis=-1)
    normal = -np.sign(np.take_along_axis(along, axis[..., None], axis=-1)) * turn.T[axis]
    return np.where((first <= last) & (first > 0.0), first, np.inf), normal


def _hit_capsule(a: Array, b: Array, radius: float, eye: Array, rays: Array) -> tuple[Array, Array]:
    """The nearest of both end balls and the tube between them."""
    axis, start = b - a, eye - a
    length = float(axis @ axis)
    distance = np.minimum(_hit_ball(a, radius, eye, rays), _hit_ball(b, radius, eye, rays))
    if length > 1e-12:
        across = rays - (rays @ axis / length)[..., None] * axis
        offset = start - (start @ axis / length) * axis
        square, middle = (across * across).sum(axis=-1), across @ offset
        inside = middle**2 - square * (offset @ offset - radius**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            tube = (-middle - np.sqrt(np.maximum(inside, 0.0))) / square
        place = (start @ axis + tube * (rays @ axis)) / length
        on = (inside > 0.0) & (tube > 0.0) & (place >= 0.0) & (place <= 1.0)
        distance = np.minimum(distance, np.where(on, tube, np.inf))
    point = eye + np.where(np.isfinite(distance), distance, 0.0)[..., None] * rays
    share = np.clip((point - a) @ axis / max(length, 1e-12), 0.0, 1.0)
    return distance, (point - a - share[..., None] * axis) / radius


def _hit_ball(centre: Array, radius: float, eye: Array, rays: Array) -> Array:
    offset = eye - centre
    middle = rays @ offset
    inside = middle**2 - (offset @ offset - radius**2)
    first = -middle - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0.0) & (first > 0.0), first, np.inf)


def _ground(camera: Camera, rays: Array) -> tuple[Array, Array]:
    """Colours of sky and ground, and the distance of each, m."""
    down = rays[..., 2] < -1e-6
    distance = np.where(down, camera.eye[2] / np.where(down, -rays[..., 2], 1.0), np.inf)
    place = camera.eye + np.where(down, distance, 0.0)[..., None] * rays
    odd = np.floor(place[..., :2] / _SQUARE).sum(axis=-1) % 2 == 1
    squares = np.where(odd[..., None], _DARK_SQUARE, _LIGHT_SQUARE)
    haze = np.clip(np.where(down, distance, _FAR) / _FAR, 0.0, 1.0)[..., None]
    return (1.0 - haze) * squares + haze * _SKY, distance
