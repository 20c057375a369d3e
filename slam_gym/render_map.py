"""The map of a frame: truth in dark greys, belief in colours, each layer drawn by a function of its own."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.interface import TARGET
from slam_gym.palette import BLUE, GREEN, ORANGE, PURPLE, VERMILION, rgb
from slam_gym.render_canvas import Camera, Canvas, Colour, ellipse_points
from slam_gym.render_frame import Frame, History
from slam_gym.render_pygame import pygame

Floats = NDArray[np.float64]

BACKGROUND: Colour = (236, 237, 238)
FLOOR: Colour = (255, 255, 255)
GRID: Colour = (240, 241, 242)
INK: Colour = (30, 33, 36)
WALL: Colour = (90, 94, 99)
PILLAR: Colour = (196, 199, 203)
TRUTH: Colour = (95, 99, 104)
RAY: Colour = (172, 182, 190)
SEEN: Colour = (255, 248, 219)  # the part of the floor that the sensor covers
ROBOT = rgb(BLUE)
BELIEVED_TARGET = rgb(VERMILION)
BELIEVED_LANDMARK = rgb(GREEN)
CLUTTER = rgb(ORANGE)
PARTICLE = rgb(PURPLE)
CLOUD = rgb(VERMILION)

TRAIL_POINTS = 700  # a longer trail is thinned out
VIEW_RAYS = 121
HEADING_POINTS = np.array([[1.5, 0.0], [-0.9, 0.95], [-0.45, 0.0], [-0.9, -0.95]])  # an arrow head, unit size


@dataclass(slots=True)
class Layers:
    """What is drawn; the keys of `slam-gym watch` change them."""

    truth: bool = True
    belief: bool = True
    ellipses: bool = True
    trails: bool = True
    view: bool = True
    scan: bool = True
    particles: bool = True
    cloud: bool = True


def draw_map(canvas: Canvas, area: pygame.Rect, camera: Camera, frame: Frame, history: History, layers: Layers) -> None:
    """Everything inside an area of the picture, on the ground that is there, from the floor up."""
    canvas.clip(area)
    draw_floor(canvas, camera, frame)
    seeing = frame.pose if layers.truth else frame.belief_pose
    if layers.view:
        draw_view(canvas, camera, frame, seeing, hidden_truth=not layers.truth)
    draw_walls(canvas, camera, frame)  # over the view, which knows of none
    if layers.truth:
        draw_landmarks(canvas, camera, frame)
    if layers.scan:
        draw_scan(canvas, camera, frame, seeing)
    if layers.belief and layers.cloud and frame.cloud is not None and frame.cloud_weights is not None:
        draw_cloud(canvas, camera, frame.cloud, frame.cloud_weights)
    if layers.trails:
        draw_trails(canvas, camera, history, layers)
    if layers.belief:
        if layers.particles and frame.particles is not None:
            draw_particles(canvas, camera, frame.particles)
        draw_believed_landmarks(canvas, camera, frame, layers.ellipses)
    if layers.truth:
        draw_truth(canvas, camera, frame)
    if layers.belief:
        draw_belief(canvas, camera, frame, layers.ellipses)
    canvas.clip(None)


def bounds(frame: Frame, history: History) -> tuple[Floats, Floats]:
    """Lowest and highest corner [2] of what has to be on the picture: arena, landmarks and where everyone was."""
    half = 0.5 * np.asarray(frame.arena)
    tracks = [history.track(name) for name in ("", "belief_", "target_")]
    points = np.concatenate([[-half, half], frame.landmarks, *tracks])
    return np.nanmin(points, axis=0), np.nanmax(points, axis=0)


def grid_step(camera: Camera) -> float:
    """[m] between grid lines: 1, 2 or 5 times a power of ten, about 50 pixels or more."""
    rough = 50.0 / camera.scale
    power = 10.0 ** math.floor(math.log10(rough))
    return next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough)


def floor_box(camera: Camera, frame: Frame) -> pygame.Rect:
    """The arena in whole pixels."""
    (left, bottom), (right, top) = np.rint(_corners(camera, frame)[[0, 2]]).astype(int).tolist()
    return pygame.Rect(left, top, right - left, bottom - top)


def draw_floor(canvas: Canvas, camera: Camera, frame: Frame) -> None:
    """Arena and grid; boxes, because they are filled several times as fast as polygons and thick lines."""
    half = 0.5 * np.asarray(frame.arena)
    floor = floor_box(camera, frame)
    canvas.box(floor, FLOOR)
    step = grid_step(camera)
    for axis in (0, 1):
        for value in np.arange(math.ceil(-half[axis] / step), math.floor(half[axis] / step) + 1) * step:
            x, y = np.rint(camera.pixels((value, value))).astype(int).tolist()
            canvas.box(
                pygame.Rect((x, floor.top, 1, floor.height) if axis == 0 else (floor.left, y, floor.width, 1)), GRID
            )


def draw_walls(canvas: Canvas, camera: Camera, frame: Frame) -> None:
    """Around the arena, where it has any."""
    if frame.walls:
        canvas.line(_corners(camera, frame), WALL, 2.5, closed=True)


def _corners(camera: Camera, frame: Frame) -> Floats:
    """[4, 2] of the arena in pixels, the lower left first."""
    return camera.pixels(0.5 * np.asarray(frame.arena) * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))


def view_outline(frame: Frame, pose: Floats, use_pillars: bool = True) -> Floats:
    """Outline [n, 2] of what the sensor covers from a pose: the wedge, cut short behind opaque pillars."""
    half = 0.5 * frame.field_of_view
    angles = pose[2] + np.linspace(-half, half, VIEW_RAYS)
    reach = np.full(VIEW_RAYS, frame.max_range)
    if use_pillars and frame.opaque and len(frame.landmarks):
        rel = frame.landmarks - pose[:2]
        along = np.outer(np.cos(angles), rel[:, 0]) + np.outer(np.sin(angles), rel[:, 1])  # [rays, N]
        across = np.outer(np.cos(angles), rel[:, 1]) - np.outer(np.sin(angles), rel[:, 0])
        depth = frame.landmark_radius**2 - across**2
        hit = along - np.sqrt(np.maximum(depth, 0.0))
        hit = np.where((depth > 0.0) & (hit > 0.0), hit, np.inf)
        reach = np.minimum(reach, hit.min(axis=1))
    rim = pose[:2] + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return rim if frame.field_of_view > 2.0 * math.pi - 1e-6 else np.concatenate([pose[None, :2], rim])


def draw_view(canvas: Canvas, camera: Camera, frame: Frame, pose: Floats, hidden_truth: bool) -> None:
    """The sensor's range and field of view; pillars cast shadows unless they are hidden truth."""
    canvas.polygon(camera.pixels(view_outline(frame, pose, not hidden_truth)), SEEN)


def draw_landmarks(canvas: Canvas, camera: Camera, frame: Frame) -> None:
    """True landmarks: pillars to scale, points as dots."""
    for centre, radius in zip(camera.pixels(frame.landmarks), frame.landmark_radius, strict=True):
        size = camera.scale * radius
        if size > 2.5:
            canvas.disc(centre, size, PILLAR)
            canvas.disc(centre, size, TRUTH, 1.0)
        else:
            canvas.disc(centre, 3.0 * canvas.line_scale, TRUTH)


def draw_scan(canvas: Canvas, camera: Camera, frame: Frame, pose: Floats) -> None:
    """The latest sweep: a ray per return, the target's in its colour, false alarms dashed with a cross."""
    if not len(frame.returns):
        return
    angles = pose[2] + frame.returns[:, 1]
    ends = pose[:2] + frame.returns[:, :1] * np.column_stack([np.cos(angles), np.sin(angles)])
    eye = camera.pixels(pose[:2])
    for end, source in zip(camera.pixels(ends), frame.sources, strict=True):
        if source == TARGET:
            canvas.line([eye, end], BELIEVED_TARGET, 1.5)
        elif source >= 0:
            canvas.line([eye, end], RAY, 1.0)
        else:
            canvas.dashes([eye, end], CLUTTER, 1.0, 4.0)
            canvas.cross(end, 4.0 * canvas.line_scale, CLUTTER, 1.5, turned=True)


def draw_trails(canvas: Canvas, camera: Camera, history: History, layers: Layers) -> None:
    """Where everyone was: truth thin and grey, belief coloured."""
    every = -(-max(len(history), 1) // TRAIL_POINTS)
    thin = slice(None, None, every)
    if layers.truth:
        for name in ("", "target_"):
            canvas.line(camera.pixels(history.track(name)[thin]), TRUTH, 1.0)
    if layers.belief:
        for name, colour in (("belief_", ROBOT), ("belief_target_", BELIEVED_TARGET)):
            canvas.line(camera.pixels(history.track(name)[thin]), colour, 1.5)


def draw_particles(canvas: Canvas, camera: Camera, particles: Floats) -> None:
    """At most 500 of the particles' positions."""
    every = -(-len(particles) // 500)
    shown = particles[::every, :2]
    canvas.discs(camera.pixels(shown), np.full(len(shown), canvas.line_scale), PARTICLE)


def draw_cloud(canvas: Canvas, camera: Camera, points: Floats, weights: Floats) -> None:
    """Where a lost target may be: dots whose area goes with their weight."""
    sizes = 1.7 * np.sqrt(weights * len(weights))
    canvas.discs(camera.pixels(points), canvas.line_scale * np.clip(sizes, 0.8, 5.0), CLOUD)


def draw_believed_landmarks(canvas: Canvas, camera: Camera, frame: Frame, ellipses: bool) -> None:
    """Mapped landmarks: a plus, and the ellipse that should hold the true one in 95 % of cases."""
    for middle in camera.pixels(frame.belief_landmarks):
        canvas.cross(middle, 4.0 * canvas.line_scale, BELIEVED_LANDMARK, 1.5)
    if ellipses:
        for outline in camera.pixels(ellipse_points(frame.belief_landmarks, frame.belief_landmark_cov)):
            canvas.line(outline, BELIEVED_LANDMARK, 1.5, closed=True)


def robot_size(camera: Camera, frame: Frame) -> float:
    """[px] of the robot's symbol: to scale, but never so small that it cannot be seen."""
    return max(camera.scale * frame.robot_radius, 7.0)


def draw_truth(canvas: Canvas, camera: Camera, frame: Frame) -> None:
    """True robot (an arrow head) and target (a disc with a tail pointing ahead)."""
    size = robot_size(camera, frame)
    if frame.target is not None:
        middle = camera.pixels(frame.target[:2])
        ahead = middle + 1.9 * size * np.array([math.cos(frame.target[2]), -math.sin(frame.target[2])])
        canvas.line([middle, ahead], INK, 2.0)
        canvas.disc(middle, 0.75 * size, INK)
    canvas.polygon(arrow(camera, frame.pose, size), INK)


def draw_belief(canvas: Canvas, camera: Camera, frame: Frame, ellipses: bool) -> None:
    """Believed robot (an outlined arrow head) and target (a cross), with their ellipses."""
    size = robot_size(camera, frame)
    if ellipses:
        ellipse = ellipse_points(frame.belief_pose[:2], frame.belief_pose_cov[:2, :2])
        canvas.line(camera.pixels(ellipse), ROBOT, 2.0, closed=True)
    canvas.line(arrow(camera, frame.belief_pose, size), ROBOT, 2.0, closed=True)
    if frame.belief_target is None or frame.belief_target_cov is None:
        return
    canvas.cross(camera.pixels(frame.belief_target), 0.9 * size, BELIEVED_TARGET, 2.5, turned=True)
    draw_heading_fan(canvas, camera, frame, 3.2 * size)
    if ellipses:
        ellipse = ellipse_points(frame.belief_target, frame.belief_target_cov)
        canvas.line(camera.pixels(ellipse), BELIEVED_TARGET, 2.0, closed=True)


def draw_heading_fan(canvas: Canvas, camera: Camera, frame: Frame, length: float) -> None:
    """Two rays from the believed target that hold its heading in 95 % of cases, and the arc between; length in [px]."""
    half = 1.96 * frame.belief_target_heading_std
    if frame.belief_target is None or not half < 0.9 * math.pi:
        return
    angles = frame.belief_target_heading + np.linspace(-half, half, 16)
    middle = camera.pixels(frame.belief_target)
    arc = middle + length * np.column_stack([np.cos(angles), -np.sin(angles)])
    canvas.line(np.vstack([middle, arc, middle]), BELIEVED_TARGET, 1.0)


def arrow(camera: Camera, pose: Floats, size: float) -> Floats:
    """Outline [4, 2] in pixels of an arrow head at a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turned = HEADING_POINTS @ np.array([[c, -s], [-s, -c]]) * size  # pixels: y points down
    return camera.pixels(pose[:2]) + turned
