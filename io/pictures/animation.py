"""Movies of a run."""

import shutil
from pathlib import Path

import numpy as np

from periporo.io.pictures.colours import choose_field, colour_limits, colour_values
from periporo.io.pictures.drawing import STYLE, PointPicture, extent_of, require_matplotlib

_MOST_FRAMES = 300
_DURATION = 10.0  # s, of a movie with many outputs
_DPI = 100


def animate_run(results, path, field=None):
    """Write a movie of all outputs (evenly chosen ones if they are very many); the file written.

    path: without ending; MP4 where the program ffmpeg is installed, else GIF. View and colours stay the same.
    """
    matplotlib = require_matplotlib()
    outputs = np.unique(np.linspace(0, results.output(-1), _MOST_FRAMES).round().astype(int))
    rate = max(4.0, len(outputs) / _DURATION)
    file, writer = _movie_writer(Path(path), rate)
    field = choose_field(results, field)
    with matplotlib.rc_context(STYLE):
        some = outputs[np.linspace(0, len(outputs) - 1, 10).round().astype(int)]
        limits = colour_limits(np.concatenate([colour_values(results, field, k)[0] for k in some]))
        picture = PointPicture(results, field, extent=extent_of(results, outputs), limits=limits)
        with writer.saving(picture.figure, file, _DPI):
            for k in outputs:
                picture.show(k)
                writer.grab_frame()
    return file


def _movie_writer(path, rate):
    """Name of the movie, and the writer for the best format that this machine can make."""
    from matplotlib import animation

    if shutil.which("ffmpeg"):
        # Players want even numbers of pixels and this pixel format.
        even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
        return path.with_name(path.name + ".mp4"), animation.FFMpegWriter(fps=rate, extra_args=even)
    return path.with_name(path.name + ".gif"), animation.PillowWriter(fps=rate)
