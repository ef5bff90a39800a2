"""What the points of a picture are coloured by: values, their label and the ends of the colour scale."""

import numpy as np

from periporo.core.numerics import tensors
from periporo.io.output.results import ResultError

DEFAULT_FIELD = "equivalent_shear_strain"


def choose_field(results, name=None):
    """The field to colour by: `name`, or equivalent shear strain, or displacement if the file lacks that."""
    if name is not None:
        return name
    return DEFAULT_FIELD if DEFAULT_FIELD in results.fields else "displacement"


def colour_values(results, name, step=-1):
    """Values (n,) to colour points by, and their label.

    name: a field, 'field.component', or 'displacement'. Vectors give their magnitude, symmetric tensors
    q = sqrt(3/2) |s| for a stress and the norm sqrt(2/3) |e| for a strain, s and e being the deviators.
    """
    base, _, component = name.partition(".")
    if base == "displacement" and base not in results.fields:
        rows, components, unit = _displacement(results, step), tensors.VECTOR, "m"
    else:
        rows, components, unit = results.field(base, step), results.components(base), results.unit(base)
    if component:
        if component not in components:
            raise ResultError(f"field {base!r} has no component {component!r}; "
                              f"there are: {', '.join(components) or 'none, it is a number'}")
        values, label = rows[:, components.index(component)], f"{base} {component}"
    elif len(components) == 6:
        strain = "strain" in base
        values = tensors.deviator_norm(rows) * np.sqrt(2 / 3 if strain else 3 / 2)
        label = f"equivalent {base}" if strain else f"equivalent shear {base}"
    elif len(components) == 3:
        values, label = np.linalg.norm(rows, axis=1), f"{base} magnitude"
    else:
        values, label = rows, base
    return values, f"{label.replace('_', ' ')}{f' [{unit}]' if unit and unit not in ('-', '1') else ''}"


def _displacement(results, step):
    """Displacement (n, 3) since the first output; NaN for points that were not there."""
    first, ids = results.ids(0), results.ids(step)
    rows = np.full((len(ids), 3), np.nan)
    _, now, then = np.intersect1d(ids, first, assume_unique=True, return_indices=True)
    rows[now] = results.positions(step)[now] - results.positions(0)[then]
    return rows


def colour_limits(values):
    """Lower and upper end of the colour scale: all but the outermost percent, so that no outlier rules it."""
    finite = values[np.isfinite(values)]
    if not finite.any():
        return 0.0, 1.0
    low, high = np.percentile(finite, (1, 99))
    low = 0.0 if 0 <= low < 0.25 * high else low
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def names_of(results, field):
    """Names of the materials, or bodies, that the numbers of a field stand for; none for other fields."""
    scene = results.configuration
    if field == "material":
        return list(scene.get("materials", ()))
    return [body["name"] for body in scene.get("bodies", ())] if field == "body" else []
