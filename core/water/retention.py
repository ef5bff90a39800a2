"""Water retention: what part of the pores is full at a suction.

A curve is a `kind` and its numbers, so that kernels can hold the curves of all materials in one table.

- `FULL`: pores are always full
- `VOIDS`: S = {1 + [alpha1 (v - 1)^alpha2 J s]^alpha3}^((1 - alpha3)/alpha3), s in kPa, which follows the volume by
  the present specific volume v = 1/(1 - phi) and the present over the initial volume J (Menon & Song 2022, eq. 15,
  after Gallipoli et al. 2003). They print the outer exponent with the opposite sign, which would make S > 1
- `VAN_GENUCHTEN`: S_e = [1 + (alpha s)^n]^(1/n - 1) (van Genuchten 1980)
- `EXPONENTIAL`: S_e = exp(-alpha s) (Gardner 1958)
- `TABLE`: measured pairs, by cubic Hermite pieces in the suction with the slopes of Fritsch & Butland (1984): no
  overshoot. Constant beyond the ends

with S = S_res + (1 - S_res) S_e. Conductivity falls with the saturation by the factor k_r: by the formula of Mualem
(1976) for `VAN_GENUCHTEN`, S_e for `EXPONENTIAL`, what the table says, linear between its rows, and else S^3
(Irmay 1954).
"""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.jit import inlined, kernel
from periporo.errors import InputError, Problem

FULL, VOIDS, VAN_GENUCHTEN, EXPONENTIAL, TABLE = range(5)
_KILOPASCAL = 1e3

RETENTION = {
    # as printed (section 4.2): S = 0.9996 and 0.9989 at 25 and 50 kPa and the initial porosity of 0.2
    "menon_song": (0.038, 3.49, 1.25),
    # reproduces the saturations 0.92 and 0.88 that are stated there for these suctions
    "fitted": (8.508, 3.49, 1.0893),
}
"""Named parameters alpha1 (1/kPa), alpha2, alpha3 of curves of the kind `VOIDS`."""


@dataclass(frozen=True)
class Retention:
    """A retention curve: its kind and numbers, see `packed`."""

    kind: int
    numbers: tuple[float, ...] = ()

    @property
    def residual(self) -> float:
        """Saturation that no suction takes away; of a table its last one."""
        if self.kind in (FULL, VOIDS):
            return 0.0
        value = self.numbers[int(2 * self.numbers[0])] if self.kind == TABLE else self.numbers[-1]
        return value if value < 1.0 else 0.0

    def saturation(self, suction, porosity, ratio) -> np.ndarray:
        """S (n,) at `suction` (n,) Pa, or one for all, of points of `porosity` (n,) and volume `ratio` J (n,)."""
        result = np.empty(len(porosity))
        suctions = np.broadcast_to(np.asarray(suction, float), result.shape)
        _saturations(packed([self]), np.zeros(len(result), np.int64), suctions, porosity, ratio, result)
        return result


def of_voids(alpha1: float, alpha2: float, alpha3: float) -> Retention:
    """Curve of the kind `VOIDS`; `alpha1` 1/kPa, `alpha3` > 1."""
    return Retention(VOIDS, (alpha1, alpha2, alpha3))


def van_genuchten(alpha: float, n: float, residual: float) -> Retention:
    """Curve with `alpha` 1/kPa, `n` > 1 and `residual` saturation."""
    return Retention(VAN_GENUCHTEN, (alpha / _KILOPASCAL, n, residual))


def exponential(alpha: float, residual: float) -> Retention:
    """Curve with `alpha` 1/kPa and `residual` saturation."""
    return Retention(EXPONENTIAL, (alpha / _KILOPASCAL, residual))


def tabulated(suction, saturation, conductivity=None) -> Retention:
    """Curve through measured rows of `suction` (k,) Pa, `saturation` (k,), and `conductivity` (k,) over that when full.

    Raises ValueError for what is not a retention curve.
    """
    s, y = np.asarray(suction, float), np.asarray(saturation, float)
    if len(s) < 2 or not (np.diff(s) > 0).all() or not (s >= 0).all():
        raise ValueError("retention table: needs at least two rows with increasing suctions >= 0, Pa; sort the rows")
    _refuse_rise("saturation", s, y)
    if y[0] != 1.0:
        raise ValueError(
            f"retention table: its first saturation must be 1, not {y[0]:g}: pores under pressure are full; begin with "
            "the suction at which air enters, and let the porosity be what water can fill"
        )
    h, slope = np.diff(s), np.diff(y) / np.diff(s)
    product = slope[1:] * slope[:-1]
    weighted = (2 * h[1:] + h[:-1]) * slope[1:] + (h[1:] + 2 * h[:-1]) * slope[:-1]
    inner = np.where(product > 0, 3 * (h[1:] + h[:-1]) * product / np.where(product > 0, weighted, 1.0), 0.0)
    slopes = np.concatenate([slope[:1], inner, slope[-1:]])
    kr = y**3 if conductivity is None else np.asarray(conductivity, float)
    _refuse_rise("conductivity", s, kr)
    return Retention(TABLE, (float(len(s)), *s, *y, *slopes, *kr))


def _refuse_rise(name, suction, values):
    """Raise ValueError for `values` outside of [0, 1], or that increase with suction, and say which."""
    bad = np.flatnonzero(~((values >= 0) & (values <= 1)))
    if len(bad):
        k = bad[0]
        raise ValueError(
            f"retention table: row {k + 1} has a {name} of {values[k]:g}; it must lie in [0, 1], as a part of that of "
            "full pores: are these percent?"
        )
    rises = np.flatnonzero(~(np.diff(values) <= 0))
    if len(rises):
        k = rises[0]
        raise ValueError(
            f"retention table: from row {k + 1} to row {k + 2} the {name} rises from {values[k]:g} to "
            f"{values[k + 1]:g}, while suction grows from {suction[k]:g} to {suction[k + 1]:g} Pa; it must not "
            "increase with suction: sort the rows, keep one branch of a hysteresis, or smooth them"
        )


def retention_of(model) -> Retention:
    """The curve that an `io.schema.water.Retention` describes, `FULL` for None. Raises InputError for a bad table."""
    if model is None:
        return Retention(FULL)
    if model.table is not None:
        try:
            return tabulated(*_read_table(model.table))
        except (OSError, ValueError) as error:
            problem = Problem(("pore_water", "retention", "table"), f"{model.table}: {error}")
            raise InputError("scene", [problem]) from None
    if model.van_genuchten is not None:
        return van_genuchten(model.van_genuchten.alpha, model.van_genuchten.n, model.van_genuchten.residual)
    if model.exponential is not None:
        return exponential(model.exponential.alpha, model.exponential.residual)
    return of_voids(*(RETENTION[model.set] if model.set is not None else (model.alpha1, model.alpha2, model.alpha3)))


def _read_table(name):
    """Columns of a CSV file headed suction,saturation in Pa and 1, and relative conductivity, if it has that."""
    with open(name, encoding="utf-8-sig") as file:
        header = file.readline().strip().replace(" ", "")
        if header not in ("suction,saturation", "suction,saturation,conductivity"):
            raise ValueError(f"its first line must be suction,saturation[,conductivity], not {header!r:.60}")
        columns = header.count(",") + 1
        rows = [line.split(",") for line in file if line.strip()]
    for number, row in enumerate(rows, 1):
        if len(row) != columns:
            raise ValueError(f"row {number} has {len(row)} columns, not the {columns} of its first line")
    return np.array(rows, float).reshape(-1, columns).T


def packed(curves: list[Retention]) -> np.ndarray:
    """Table of the `curves`, one a row: its kind, then its numbers."""
    table = np.zeros((len(curves), 1 + max(len(c.numbers) for c in curves)))
    for row, curve in zip(table, curves, strict=True):
        row[: 1 + len(curve.numbers)] = curve.kind, *curve.numbers
    return table


def saturations(curves: np.ndarray, material, suction, porosity, ratio) -> np.ndarray:
    """S (n,) of points with curve `material` (n,) of a packed table, at `suction` (n,) Pa."""
    result = np.empty(len(porosity))
    _saturations(curves, material, suction, porosity, ratio, result)
    return result


def conductivities(curves: np.ndarray, material, suction, porosity, ratio) -> np.ndarray:
    """k_r (n,) of points with curve `material` (n,) of a packed table, at `suction` (n,) Pa."""
    result = np.empty(len(porosity))
    _conductivities(curves, material, suction, porosity, ratio, result)
    return result


@inlined
def power(base, exponent):
    """base^exponent of what cannot be negative but for rounding; NaN stays."""
    return base**exponent if base > 0.0 else 0.0 * base


@inlined
def saturation_of(curves, m, suction, porosity, ratio):
    """S and dS/ds of curve `m`; pores under pressure are full."""
    kind = int(curves[m, 0])
    if kind == FULL or suction <= 0.0:
        return 1.0, 0.0
    if kind == VOIDS:
        alpha3 = curves[m, 3]
        scale = curves[m, 1] * power(porosity / (1.0 - porosity), curves[m, 2]) * ratio / _KILOPASCAL
        x = power(scale * suction, alpha3)
        value = (1.0 + x) ** ((1.0 - alpha3) / alpha3)
        return value, (1.0 - alpha3) * value * x / ((1.0 + x) * suction)
    if kind == VAN_GENUCHTEN:
        n, residual = curves[m, 2], curves[m, 3]
        x = (curves[m, 1] * suction) ** n
        value = (1.0 - residual) * (1.0 + x) ** (1.0 / n - 1.0)
        return residual + value, (1.0 - n) * value * x / ((1.0 + x) * suction)
    if kind == EXPONENTIAL:
        value = (1.0 - curves[m, 2]) * np.exp(-curves[m, 1] * suction)
        return curves[m, 2] + value, -curves[m, 1] * value
    return _interpolated(curves, m, suction)


@inlined
def _interpolated(curves, m, suction):
    n = int(curves[m, 1])
    if suction >= curves[m, 1 + n]:
        return curves[m, 1 + 2 * n], 0.0
    if suction < curves[m, 2]:
        return curves[m, 2 + n], 0.0
    k = 0
    while suction >= curves[m, 3 + k]:
        k += 1
    start, width = curves[m, 2 + k], curves[m, 3 + k] - curves[m, 2 + k]
    y0, y1 = curves[m, 2 + n + k], curves[m, 3 + n + k]
    m0, m1 = width * curves[m, 2 + 2 * n + k], width * curves[m, 3 + 2 * n + k]
    t = (suction - start) / width
    value = (1 + 2 * t) * (1 - t) ** 2 * y0 + t * t * (3 - 2 * t) * y1 + t * (1 - t) * ((1 - t) * m0 - t * m1)
    slope = 6 * t * (1 - t) * (y1 - y0) + (1 - t) * (1 - 3 * t) * m0 + t * (3 * t - 2) * m1
    return value, slope / width


@inlined
def conductivity_of(curves, m, suction, saturation):
    """k_r of curve `m` at `suction`, where it has this `saturation`."""
    kind = int(curves[m, 0])
    if kind == FULL or suction <= 0.0:
        return 1.0
    if kind == VAN_GENUCHTEN:
        part = curves[m, 2] / (curves[m, 2] - 1.0)  # 1/m
        effective = (saturation - curves[m, 3]) / (1.0 - curves[m, 3])
        return np.sqrt(effective) * (1.0 - (1.0 - effective**part) ** (1.0 / part)) ** 2
    if kind == EXPONENTIAL:
        return (saturation - curves[m, 2]) / (1.0 - curves[m, 2])
    if kind == TABLE:
        n = int(curves[m, 1])
        start = 2 + 3 * n
        if suction >= curves[m, 1 + n]:
            return curves[m, start + n - 1]
        if suction < curves[m, 2]:
            return curves[m, start]
        k = 0
        while suction >= curves[m, 3 + k]:
            k += 1
        t = (suction - curves[m, 2 + k]) / (curves[m, 3 + k] - curves[m, 2 + k])
        return (1.0 - t) * curves[m, start + k] + t * curves[m, start + k + 1]
    return saturation**3


@kernel
def _saturations(curves, material, suction, porosity, ratio, result):
    for i in range(porosity.shape[0]):
        result[i], _ = saturation_of(curves, material[i], suction[i], porosity[i], ratio[i])


@kernel
def _conductivities(curves, material, suction, porosity, ratio, result):
    for i in range(porosity.shape[0]):
        filled, _ = saturation_of(curves, material[i], suction[i], porosity[i], ratio[i])
        result[i] = conductivity_of(curves, material[i], suction[i], filled)
