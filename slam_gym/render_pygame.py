"""pygame without its greeting on standard output; import it from here."""

import os

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

__all__ = ["pygame", "show_directly"]


def show_directly() -> None:
    """Have a window that is opened from now on take its pictures from shared memory, where that is possible.

    By itself SDL draws each as a texture with OpenGL, which without a graphics card costs more than all the drawing
    before it. Only X11 has another way: other drivers are left as they are. Call it between `pygame.display.init` and
    `pygame.display.set_mode`.
    """
    if pygame.display.get_driver() == "x11":
        os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
