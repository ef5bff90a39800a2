"""Drawing of soil points: what a picture and a movie of a run have in common."""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics import cells
from periporo.core.numerics.gravity import vertical_axis
from periporo.io.output.results import ResultError
from periporo.io.pictures.colours import choose_field, colour_limits, colour_values, names_of
from periporo.io.pictures.relief import Relief, grounds_of

STYLE = {"font.size": 10, "axes.titlesize": 11, "axes.labelsize": 10, "legend.frameon": False,
         "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "0.35",
         "xtick.color": "0.35", "ytick.color": "0.35", "axes.labelcolor": "0.2", "savefig.dpi": 160,
         "axes.grid": False, "grid.color": "0.9", "lines.linewidth": 1.5}
_AXES = "xyz"
_COLOURS = "viridis"
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # of a square, over half its side


_FAR = 20.0  # lengths of its last segment, by which a line without end is drawn on
_WEB = 1.75  # spacings between points, up to which there is soil between them
_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a hexahedron


def require_matplotlib():
    """The package matplotlib, which is optional; ImportError with what to do if it is missing."""
    try:
        import matplotlib
    except ImportError:
        raise ImportError("pictures need matplotlib: pip install 'periporo[plot]'") from None
    return matplotlib


def point_spacing(results):
    """Spacing of the points (m): as configured, or the median distance to the nearest neighbour at first."""
    spacing = results.configuration.get("spacing")
    if isinstance(spacing, (int, float)):
        return float(spacing)
    position = results.positions(0)
    if len(position) < 2:
        return 1.0
    sample = position[:: max(1, len(position) // 50)]
    squared = [np.partition(np.sum((position - x) ** 2, axis=1), 1)[1] for x in sample]
    return float(np.sqrt(np.median(squared)))


@dataclass
class View:
    """An orthographic view: axis across, axis up, and the axis that points towards the viewer times sign."""

    across: int
    up: int
    towards: int | None = None
    sign: float = 1.0
    name: str = ""

    def nearest_last(self, position):
        """Order of drawing: the points next to the viewer come last and hide those behind."""
        if self.towards is None:
            return np.arange(len(position))
        return np.argsort(self.sign * position[:, self.towards], kind="stable")


def views(results):
    """The views to draw: one in two dimensions, front and top in three."""
    up = vertical_axis(results.configuration.get("gravity"), results.dimension)
    if results.dimension == 2:
        return [View(1 - up, up)]
    across = 0 if up != 0 else 1
    behind = 3 - up - across
    # Looking along +behind from the front, the front-most point has the smallest coordinate.
    return [View(across, up, behind, -1.0, "front"), View(across, behind, up, 1.0, "top")]


class PointPicture:
    """A figure of the points of one output; `show` draws another output into the same figure."""

    def __init__(self, results, field=None, *, extent=None, limits=None):
        """extent (2, 3) m: lower and upper corner to show; limits: ends of the colour scale."""
        from matplotlib.figure import Figure

        self.results = results
        self.field = choose_field(results, field)
        self.spacing = point_spacing(results)
        self.views = views(results)
        self.extent = extent_of(results, (0, -1)) if extent is None else extent
        self.limits = limits
        self.figure, self.axes, self._bar = self._lay_out(Figure)
        prepared = [self._prepare(axes, view) for axes, view in zip(self.axes, self.views, strict=True)]
        self.points, self.squares, self.webs = zip(*prepared, strict=True)
        self.obstacles = [self._prepare_obstacles(axes) for axes in self.axes]
        self._grounds = grounds_of(results)
        up = vertical_axis(results.configuration.get("gravity"), results.dimension)
        self._reliefs = [Relief(axes, view, up) for axes, view in zip(self.axes, self.views, strict=True)]
        self.water = self._prepare_water()
        self.colour_bar = None
        self._show_gravity()

    def show(self, step):
        """Draw output `step`."""
        results = self.results
        step = results.output(step)
        position = results.positions(step)
        values, label = colour_values(results, self.field, step)
        names = names_of(results, self.field)
        limits = (0, max(len(names) - 1, 1)) if names else self.limits or colour_limits(values)
        obstacles = results.obstacles(step)
        for relief in self._reliefs:
            relief.show(faces_and_lines([o for o in obstacles if o[0] in self._grounds])[0])
        faces, lines = faces_and_lines([o for o in obstacles if o[0] not in self._grounds])
        for view, (areas, edges) in zip(self.views, self.obstacles, strict=True):
            areas.set_verts([face[:, [view.across, view.up]] for face in faces])
            edges.set_segments([line[:, [view.across, view.up]] for line in lines])
        for view, points, squares, web in zip(self.views, self.points, self.squares, self.webs, strict=True):
            order = view.nearest_last(position)
            centres = position[order][:, [view.across, view.up]]
            points.set_offsets(centres)
            if squares is not None:
                squares.set_verts(centres[:, None] + 0.52 * self.spacing * _CORNERS)
            shown = [(points, values[order]), (squares, values[order])]
            if web is not None:
                triangles = between(centres, _WEB * self.spacing)
                web.set_verts(centres[triangles])
                shown.append((web, values[order][triangles].mean(axis=1)))
            for collection, colours in ((c, v) for c, v in shown if c is not None):
                collection.set_array(np.ma.masked_invalid(colours))
                collection.set_clim(*limits)
        if self.colour_bar is None:
            self._add_colour_bar(label, values)
        self._show_water(step)
        self.axes[0].set_title(f"t = {results.times[step]:.4g} s", loc="left", color="0.2")
        outside = np.sum(np.any((position < self.extent[0]) | (position > self.extent[1]), axis=1))
        count = f"{len(position):,} points" + (f", {outside} outside the picture" if outside else "")
        self.axes[0].set_title(count, loc="right", color="0.5", fontsize=9)

    def _lay_out(self, new_figure):
        """Figure, axes of the views, all to one scale, and axes of the colour bar below; in inches.

        Two views stand below each other, or side by side if that is less tall than wide.
        """
        size = self.extent[1] - self.extent[0]
        margin = max(2 * self.spacing, 0.02 * size.max())
        size = size + 2 * margin
        across = size[self.views[0].across]
        ups = [size[view.up] for view in self.views]
        n = len(ups)
        beside = n > 1 and across < 0.8 * sum(ups)
        columns, tall = (n, max(ups)) if beside else (1, sum(ups))
        self._scale = scale = min(8.0 / (columns * across), 8.0 / tall)
        breadth = columns * (scale * across + 0.9) - 0.9
        width, height = max(breadth, 3.5) + 1.1, scale * tall + 0.65 * (n - columns) + 1.85
        figure = new_figure(figsize=(width, height))
        axes = []
        for k, (view, up) in enumerate(zip(self.views, ups, strict=True)):
            left, bottom = 0.5 * (width - breadth) + 0.3, 1.45
            if beside:
                left += k * (scale * across + 0.9)
            else:
                bottom += scale * sum(ups[k + 1:]) + 0.65 * (n - 1 - k)
            box = (left / width, bottom / height, scale * across / width, scale * up / height)
            frame = figure.add_axes(box)
            frame.set_xlim(self.extent[0, view.across] - margin, self.extent[1, view.across] + margin)
            frame.set_ylim(self.extent[0, view.up] - margin, self.extent[1, view.up] + margin)
            name = f"   ({view.name} view)" if view.name else ""
            frame.set(xlabel=f"{_AXES[view.across]} [m]{name}", ylabel=f"{_AXES[view.up]} [m]")
            axes.append(frame)
        return figure, axes, figure.add_axes((0.15, 0.5 / height, 0.7, 0.15 / height))

    def _prepare(self, axes, view):
        """The points of a view, in two dimensions squares and what lies between below them; `show` fills them."""
        from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection

        first = self.results.positions(0)
        outline = outline_segments(first[:, [view.across, view.up]], self.spacing)
        axes.add_collection(LineCollection(outline, colors="0.55", linewidths=1.1, zorder=3))
        # As large as its share: a disc of area spacing^2, a ball of volume spacing^3.
        diameter = self.spacing * (2 / np.sqrt(np.pi) if view.towards is None else np.cbrt(6 / np.pi))
        points = EllipseCollection([diameter], [diameter], [0.0], units="xy", offsets=np.empty((0, 2)),
                                   offset_transform=axes.transData, cmap=_COLOURS, linewidths=0, zorder=2)
        axes.add_collection(points)
        if view.towards is not None:
            rim = min(0.3, 0.03 * 72 * self._scale * diameter)  # points (1/72 inch)
            points.set(edgecolors=(0, 0, 0, 0.35), linewidths=rim)
            return points, None, None
        squares, web = (PolyCollection([], cmap=_COLOURS, linewidths=0, zorder=z) for z in (1, 0.9))
        for collection in (squares, web):  # soil has no holes between its points
            axes.add_collection(collection, autolim=False)
        return points, squares, web

    def _prepare_obstacles(self, axes):
        """What `show` fills with the obstacles of a view: areas, and lines."""
        from matplotlib.collections import LineCollection, PolyCollection

        areas = PolyCollection([], facecolors="0.9", edgecolors="0.45", linewidths=1.0, zorder=0)
        edges = LineCollection([], colors="0.45", linewidths=1.6, zorder=0)
        axes.add_collection(areas, autolim=False)
        axes.add_collection(edges, autolim=False)
        return areas, edges

    def _show_gravity(self):
        """An arrow above the views in which gravity is inclined, as on a chute."""
        pull = np.resize(np.asarray(self.results.configuration.get("gravity") or 0.0, float), 3)
        for axes, view in zip(self.axes, self.views, strict=True):
            down = pull[[view.across, view.up]]
            if (down != 0.0).all():
                turn = np.degrees(np.arctan2(down[1], down[0]))
                axes.text(0.5, 1.02, "gravity ", transform=axes.transAxes, ha="right", color="0.3")
                axes.text(0.52, 1.035, "\u279c", transform=axes.transAxes, rotation=turn, color="0.3", fontsize=14,
                          ha="center", va="center", rotation_mode="anchor")  # fmt: skip

    def _prepare_water(self):
        """What `show` fills with the water table, in two dimensions, and with the level of free water; or None."""
        from matplotlib.collections import LineCollection

        if "pore_pressure" not in self.results.fields or self.results.dimension == 3:
            return None
        colours = {"water table": "#1f77b4", "free water": "#17becf"}
        lines = {n: LineCollection([], colors=c, linewidths=1.4, zorder=4, label=n) for n, c in colours.items()}
        for line in lines.values():
            self.axes[0].add_collection(line, autolim=False)
        return lines

    def _show_water(self, step):
        """Draw the water table of output `step` where columns beside each other agree on it, and free water."""
        if self.water is None:
            return
        view, found = self.views[0], self.results.water_table(step)
        place = found[np.argsort(found[:, view.across])][:, [view.across, view.up]]
        beside = (np.abs(np.diff(place, axis=0)) < np.array([1.5, 3.0]) * self.spacing).all(axis=1)
        segments = {"water table": np.stack([place[:-1], place[1:]], axis=1)[beside], "free water": []}
        free = (self.results.configuration.get("pore_water") or {}).get("free_water")
        if free is not None:
            level = np.interp(self.results.times[step], free["level"]["times"], free["level"]["values"])
            segments["free water"] = [[(end, level) for end in self.axes[0].get_xlim()]]
        for name, line in self.water.items():
            line.set_segments(segments[name])
        drawn = [line for name, line in self.water.items() if len(segments[name])]
        self.axes[0].legend(handles=drawn, loc="upper right", fontsize=9) if drawn else None

    def _add_colour_bar(self, label, values):
        low, high = self.points[0].get_clim()
        below, above = (values < low).any(), (values > high).any()
        ends = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
        self.colour_bar = self.figure.colorbar(self.points[0], cax=self._bar, orientation="horizontal",
                                               extend=ends[bool(below), bool(above)])
        names = names_of(self.results, self.field)
        if names:
            self.colour_bar.set_ticks(range(len(names)), labels=names)
        else:
            self.colour_bar.formatter.set_powerlimits((-2, 4))
            self.colour_bar.formatter.set_useMathText(True)
        self.colour_bar.set_label(label)
        self.colour_bar.outline.set_visible(False)


def faces_and_lines(obstacles):
    """Flat faces, and lines, of obstacles: corners (k, 3) m of each. Lines without end go far beyond pictures."""
    faces, lines = [], []
    for _, kind, corners in obstacles:
        if kind == cells.HEXAHEDRON:
            faces += [corners[list(face)] for face in _FACES]
        elif kind not in (cells.LINE, cells.POLY_LINE):
            faces.append(corners)
        elif (corners[0] != corners[-1]).any():
            first, last = (corners[a] + _FAR * (corners[a] - corners[b]) for a, b in ((0, 1), (-1, -2)))
            lines.append(np.concatenate([[first], corners, [last]]))
        else:  # clockwise it encloses the obstacle, else the soil
            x, y = corners[:, 0], corners[:, 1]
            (faces if (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() < 0.0 else lines).append(corners)
    return faces, lines


def between(points, reach):
    """Triangles (m, 3) between points (n, 2) m whose sides are at most `reach` m long: numbers of the points."""
    from matplotlib.tri import Triangulation

    try:
        triangles = Triangulation(*points.T).triangles
    except (RuntimeError, ValueError):  # fewer than three points, or all on one line
        return np.empty((0, 3), int)
    sides = points[triangles] - points[np.roll(triangles, 1, axis=1)]
    return triangles[((sides**2).sum(axis=2) <= reach**2).all(axis=1)]


def extent_of(results, outputs):
    """Lower and upper corner (2, 3) m of the points at these outputs, apart from a few that flew far off.

    Raises ResultError if there are none.
    """
    corners = []
    for k in outputs:
        position = results.positions(k)
        if not len(position):
            continue
        low, high = position.min(axis=0), position.max(axis=0)
        inner = np.quantile(position, (0.01, 0.99), axis=0)
        room = np.max(inner[1] - inner[0])  # who is farther off would make the rest too small to see
        corners += [np.maximum(low, inner[0] - room), np.minimum(high, inner[1] + room)]
    if not corners:
        raise ResultError(f"{results.path} has no points at these outputs, so there is nothing to draw")
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def outline_segments(points, spacing):
    """Outline (m, 2, 2) of the area that points (n, 2) cover: the outer edges of the cells they stand in."""
    low = points.min(axis=0) - 0.5 * spacing
    cells = np.floor((points - low) / spacing + 1e-6).astype(int) + 1
    covered = np.zeros(cells.max(axis=0) + 2, dtype=bool)
    covered[cells[:, 0], cells[:, 1]] = True
    segments = []
    for axis in (0, 1):
        edges = np.argwhere(np.diff(covered, axis=axis)).astype(float)
        start = edges.copy()
        start[:, axis] += 1  # the edge between two cells along `axis`, seen from cell 1 being at 0
        end = start.copy()
        end[:, 1 - axis] += 1
        segments.append(np.stack([start, end], axis=1) - 1)
    return low + spacing * np.concatenate(segments)
