"""Write pictures to a file as they come: MP4 through ffmpeg, GIF without any further package."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

KINDS = (".mp4", ".gif")


def check_file(file: Path, what: str, kinds: Sequence[str]) -> None:
    """Refuse early what could not be written late.

    Raises:
        ValueError: another kind of file, or a folder that does not exist.
    """
    if file.suffix not in kinds:
        raise ValueError(f"a {what} is {' or '.join(kinds)}; got {str(file)!r}")
    if not file.parent.is_dir():
        raise ValueError(f"the folder {str(file.parent)!r} does not exist; make it first")


class VideoWriter:
    """A video file, written one picture at a time; use it in a `with` statement.

    Args:
        file: where to; .mp4 or .gif.
        size: [px] width and height.
        fps: pictures per second.

    Raises:
        ValueError: another kind of file, or a folder that does not exist.
        ImportError: an MP4 without the package imageio-ffmpeg.
    """

    def __init__(self, file: Path, size: tuple[int, int], fps: float) -> None:
        self.file, self.size, self.fps = Path(file), size, fps
        check_file(self.file, "video", KINDS)
        self._pictures: list[Any] = []
        self._pipe: Any = None
        if self.file.suffix == ".mp4":
            try:
                import imageio_ffmpeg  # type: ignore[import-untyped]
            except ImportError as error:
                raise ImportError("an MP4 needs `pip install imageio-ffmpeg`; a .gif needs nothing") from error
            even = (size[0] - size[0] % 2, size[1] - size[1] % 2)  # what the codec asks for: a last row may be left out
            self._pipe = imageio_ffmpeg.write_frames(str(self.file), even, fps=fps, macro_block_size=2, quality=7)
            self._pipe.send(None)

    def write(self, picture: NDArray[np.uint8]) -> None:
        """Append one picture [height, width, 3]."""
        if self._pipe is not None:
            height, width = picture.shape[:2]
            self._pipe.send(np.ascontiguousarray(picture[: height - height % 2, : width - width % 2]))
            return
        from PIL import Image

        self._pictures.append(Image.fromarray(picture).convert("P", palette=Image.Palette.ADAPTIVE, colors=64))

    def close(self) -> None:
        """Finish the file."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        elif self._pictures:
            first, *rest = self._pictures
            first.save(self.file, save_all=True, append_images=rest, duration=round(1e3 / self.fps), loop=0)
            self._pictures = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
