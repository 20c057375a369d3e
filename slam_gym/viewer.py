"""The live view: an episode in a window, driven by the clock and by keys."""

import itertools
import os
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam_gym.episode import Episode
from slam_gym.render import Frame, History, Renderer
from slam_gym.render_pygame import pygame
from slam_gym.video import VideoWriter

KEYS = (
    ("space n", "pause, one step"),
    ("+ \u2212", "faster, slower"),
    ("tab", "next estimator"),
    ("t b d", "truth, belief, split"),
    ("e r l", "ellipses, trails, lost"),
    ("v c x", "view, sweep, particles"),
    ("f", "follow robot, target"),
    ("arrows p", "drive, policy again"),
    ("s m", "save PNG, video"),
    ("enter q", "next world, quit"),
)
TOGGLES = {"t": "truth", "b": "belief", "e": "ellipses", "r": "trails", "v": "view", "c": "scan", "x": "particles",
           "l": "cloud"}  # fmt: skip
FOLLOW = {None: "robot", "robot": "target", "target": None}
FASTEST, SLOWEST = 64.0, 1.0 / 16.0  # times real time
BUSY = 0.5  # share of a picture's time that may go into simulation before it lags behind the clock
FPS = 60.0
VIDEO_FPS = 30.0
INVISIBLE = ("offscreen", "dummy")  # what SDL falls back on without a display
NOTE_TIME = 2.0  # [s] that a message stays


class Viewer:
    """Runs an episode at a multiple of real time and obeys keys.

    Args:
        episode: what runs; every estimator of it can be shown.
        renderer: where to; its window has the keyboard.
        folder: for saved pictures.
    """

    def __init__(self, episode: Episode, renderer: Renderer, folder: Path = Path()) -> None:
        self.episode, self.renderer, self.folder = episode, renderer, folder
        self.shown, self.paused, self.running, self.speed = 0, False, True, 1.0
        self.manual = False
        self._histories = [History() for _ in episode.names]
        self._owed = 0.0  # [s] of simulated time that the clock is ahead
        self._late_until = 0.0  # until when to say that the machine does not keep pace
        self._message, self._message_until = "", 0.0
        self._held: set[int] = set()
        self._video: VideoWriter | None = None
        self._video_owed = 0.0  # [s] that the clock is ahead of the video
        renderer.keys = KEYS
        self._record()

    def loop(self) -> None:
        """Until the window is closed or `q` pressed."""
        before = time.perf_counter()
        while self.running:
            for event in pygame.event.get():
                self.handle(event)
            now = time.perf_counter()
            self.tick(now - before)
            before = now

    def tick(self, elapsed: float) -> None:
        """Simulate what `elapsed` seconds of the clock ask for, as far as time allows, and draw."""
        if not self.paused and not self.episode.finished:
            self._owed += self.speed * min(elapsed, 0.25)
            deadline = time.perf_counter() + BUSY / FPS
            dt = self.episode.context.step_dt
            while self._owed >= dt and not self.episode.finished:
                self._step()
                self._owed -= dt
                if time.perf_counter() > deadline and self._owed >= dt:
                    self._owed = 0.0
                    self._late_until = deadline + NOTE_TIME
        self._draw()
        self._film(elapsed)

    def close(self) -> None:
        """Finish what is being recorded."""
        if self._video is not None:
            self._video.close()
            self._say(f"saved {self._video.file.name}")
            self._video = None

    def handle(self, event: pygame.event.Event) -> None:
        """Obey one event."""
        if event.type == pygame.QUIT:
            self.running = False
        elif event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.KEYDOWN:
            self._press(event.key, event.unicode)

    def _press(self, key: int, character: str) -> None:
        if key in (pygame.K_LEFT, pygame.K_RIGHT, pygame.K_UP, pygame.K_DOWN):
            self.manual = True
            self._held.add(key)
        elif key in (pygame.K_RETURN, pygame.K_KP_ENTER):
            self.episode.reset(self.episode.seed + 1)
            self._record()
        elif key == pygame.K_SPACE:
            self.paused = not self.paused
        elif key == pygame.K_TAB:
            self.shown = (self.shown + 1) % len(self.episode.names)
        elif key == pygame.K_ESCAPE or character == "q":
            self.running = False
        elif character in ("+", "="):
            self.speed = min(FASTEST, 2.0 * self.speed)
        elif character in ("-", "_"):
            self.speed = max(SLOWEST, 0.5 * self.speed)
        else:
            self._press_letter(character)

    def _press_letter(self, character: str) -> None:
        if character in TOGGLES:
            layer = TOGGLES[character]
            setattr(self.renderer.layers, layer, not getattr(self.renderer.layers, layer))
        elif character == "n":
            self.paused = True
            if not self.episode.finished:
                self._step()
        elif character == "f":
            self.renderer.follow = FOLLOW[self.renderer.follow]  # type: ignore[assignment]
        elif character == "d":
            self.renderer.split = not self.renderer.split
        elif character == "m":
            self._start_or_stop_video()
        elif character == "p":
            self.manual = False
        elif character == "s":
            self._save()

    def _step(self) -> None:
        self.episode.step(self._manual_command() if self.manual else None)
        self._record()

    def _manual_command(self) -> NDArray[np.float64]:
        """[1, 2] what the held arrow keys say: full speed, and 60 % of the highest turn rate or steering angle."""
        context = self.episode.context
        forward = (pygame.K_UP in self._held) - (pygame.K_DOWN in self._held)
        left = (pygame.K_LEFT in self._held) - (pygame.K_RIGHT in self._held)
        speed = forward * context.speed_max if forward > 0 else -forward * min(context.speed_min, 0.0)
        turn = context.steering_max if context.is_bicycle else context.turn_max
        return np.array([[speed, 0.6 * left * turn]])

    def _record(self) -> None:
        """Keep every estimator's history, so that switching shows whole trails."""
        for i, history in enumerate(self._histories):
            history.record(self._frame(i))

    def _frame(self, index: int) -> Frame:
        return Frame.from_simulation(self.episode.simulation, 0, index, label=self.episode.names[index])

    def _draw(self) -> None:
        self.renderer.note = self._note()
        self.renderer.draw(self._frame(self.shown), self._histories[self.shown])

    def _note(self) -> str:
        if time.perf_counter() < self._message_until:
            return self._message
        if self.episode.finished:
            return "the end; enter: next world" if self._video is None else "the end (enter), recording"
        speed = f"{self.speed:g}" if self.speed >= 1.0 else f"1/{1.0 / self.speed:g}"
        if time.perf_counter() < self._late_until:
            speed = f"< {speed}"  # as fast as it can, but not so fast
        alone = not self.manual and self._video is None  # with more to say, little room is left on a small screen
        words = ["paused" if self.paused else f"{speed} x {'real time' if alone else ''}".rstrip()]
        if self.manual:
            words.append("you drive")
        if self._video is not None:
            words.append("recording")
        return ", ".join(words)

    def _save(self) -> None:
        self._draw()  # keys and sizes of this moment are not on the picture yet
        file = self._unused_file(".png")
        try:
            pygame.image.save(self.renderer.surface, str(file))
            self._say(f"saved {file.name}")
        except (OSError, pygame.error) as error:
            self._say(f"not saved: {error}")

    def _say(self, words: str) -> None:
        self._message, self._message_until = words, time.perf_counter() + NOTE_TIME

    def _start_or_stop_video(self) -> None:
        """An MP4 where ffmpeg is installed, else a GIF."""
        if self._video is not None:
            self.close()
            return
        kind = ".mp4" if find_spec("imageio_ffmpeg") is not None else ".gif"
        try:
            self._video, self._video_owed = VideoWriter(self._unused_file(kind), self.renderer.size, VIDEO_FPS), 0.0
        except (OSError, ValueError) as error:
            self._say(f"no video: {error}")

    def _film(self, elapsed: float) -> None:
        """As many copies of the picture as the clock asks for; a window of another size ends the video."""
        if self._video is None:
            return
        if self._video.size != self.renderer.size:
            self.close()
            return
        self._video_owed += min(elapsed, 0.25)
        while self._video is not None and self._video_owed >= 1.0 / VIDEO_FPS:
            self._video_owed -= 1.0 / VIDEO_FPS
            self._video.write(self.renderer.pixels())

    def _unused_file(self, suffix: str) -> Path:
        name = f"{self.episode.scenario.name}-{self.episode.names[self.shown]}-{self.episode.step_count}"
        safe = "".join(c if c.isalnum() or c in "-._=" else "_" for c in name)
        return self.folder / _unused(self.folder, safe, suffix)


def _unused(folder: Path, stem: str, suffix: str) -> str:
    """A file's name that is not taken yet: stem.png, stem-2.png, ..."""
    names = (f"{stem}{f'-{i}' if i > 1 else ''}{suffix}" for i in itertools.count(1))
    return next(name for name in names if not (folder / name).exists())


def check_display() -> None:
    """Say what to do where no window can be opened.

    Raises:
        ValueError: there is no display.
    """
    try:
        pygame.display.init()
        driver = pygame.display.get_driver()
    except pygame.error as error:
        driver = str(error)
    else:
        chosen = os.environ.get("SDL_VIDEODRIVER")
        if driver not in INVISIBLE or driver == chosen:
            return
        pygame.display.quit()
    raise ValueError(
        f"no window can be opened here ({driver}): set DISPLAY, or use `slam-gym run --video out.gif`, which needs none"
    )
