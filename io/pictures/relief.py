"""Natural ground behind the points of a picture: shaded as on maps, by light from the north-west, with contours."""

import numpy as np

_DARK, _LIGHT = 0.45, 1.0  # grey of a slope in its own shadow, and of one that faces the light
_STEEPER = 1.5  # times as steep as it is, so that gentle forms show
_CONTOURS = 12
_LABELLED = 4  # corners of a contour in view, beyond which it has a label


class Relief:
    """The ground in one view; `show` draws it, and again only where it has moved."""

    def __init__(self, axes, view, up: int):
        """up: the vertical axis; from above contours are drawn, too."""
        self._axes, self._view, self._up = axes, view, up
        self._drawn: list = []
        self._corners = np.empty((0, 3, 3))

    def show(self, faces: list[np.ndarray]) -> None:
        """Draw faces with corners (k, 3) m each."""
        fans = [np.stack([np.broadcast_to(f[0], f[1:-1].shape), f[1:-1], f[2:]], axis=1) for f in faces]
        corners = np.concatenate(fans) if fans else np.empty((0, 3, 3))
        if np.array_equal(corners, self._corners):
            return
        for artist in self._drawn:
            artist.remove()
        self._corners, self._drawn = corners, self._draw(corners) if len(corners) else []

    def _draw(self, corners):
        from matplotlib.collections import TriMesh
        from matplotlib.tri import Triangulation

        view, axes = self._view, self._axes
        if view.towards is not None:  # what is next to the viewer comes last
            corners = corners[np.argsort(view.sign * corners[:, :, view.towards].mean(axis=1), kind="stable")]
        points, rows = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        triangles = rows.reshape(-1, 3)
        plan = Triangulation(points[:, view.across], points[:, view.up], triangles)
        mesh = TriMesh(plan, cmap="gray", zorder=0, rasterized=True)
        mesh.set_array(self._brightness(points, triangles))
        mesh.set_clim(0.0, 1.0)
        axes.add_collection(mesh, autolim=False)
        if view.towards != self._up or np.ptp(points[:, self._up]) == 0.0:
            return [mesh]
        limits = axes.axis()
        lines = axes.tricontour(plan, points[:, self._up], levels=_CONTOURS, colors="0.35", linewidths=0.5, zorder=0.5)
        axes.axis(limits)
        low, high = np.reshape(limits, (2, 2)).T
        return [mesh, lines, *axes.clabel(lines, fontsize=7, fmt="%g", manual=_middles(lines, low, high))]

    def _brightness(self, points, triangles):
        """Grey (n,) of each corner: that of the mean normal of what meets there."""
        first = points[triangles[:, 0]]
        normal = np.cross(points[triangles[:, 1]] - first, points[triangles[:, 2]] - first)
        normal[normal[:, self._up] < 0.0] *= -1.0
        mean = np.stack([np.bincount(triangles.ravel(), np.repeat(n, 3), len(points)) for n in normal.T], axis=1)
        mean[:, self._up] /= _STEEPER
        mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
        light = np.full(3, np.sqrt(0.5))  # 45 degrees high
        level = [axis for axis in range(3) if axis != self._up]
        light[level] = [-0.5, 0.5]
        return _DARK + (_LIGHT - _DARK) * np.clip(mean @ light, 0.0, 1.0)


def _middles(lines, low, high):
    """Places for labels: the middle of the longest part that each contour has between two corners (2,) of the view."""
    places = []
    for segments in lines.allsegs:
        inside = [s[((s > low) & (s < high)).all(axis=1)] for s in segments]
        longest = max(inside, key=len, default=np.empty((0, 2)))
        if len(longest) > _LABELLED:
            places.append(tuple(longest[len(longest) // 2]))
    return places


def grounds_of(results):
    """Numbers of the obstacles that are natural ground."""
    contacts = results.configuration.get("contacts", ())
    return {number for number, contact in enumerate(contacts) if contact.get("type") == "terrain"}
