"""Bishop's factor: how much of the pore pressure counts in the effective stress, sigma_bar = sigma + chi p I.

- `SATURATION`: chi = S, with which pressure does work on the water that pores take up
- `POWER`: chi = S_e^n of the effective saturation S_e = (S - S_res)/(1 - S_res)
- `RATIO`: chi = (s/s_e)^-0.55 at a suction s beyond that at which air enters, s_e (Khalili & Khabbaz 1998)

chi = 1 in pores under pressure. A table of them has one row for each material: its kind, then its two numbers.
"""

import numpy as np

from periporo.core.numerics.jit import inlined, kernel
from periporo.core.water.retention import FULL, Retention, power

SATURATION, POWER, RATIO = range(3)
_KHALILI_KHABBAZ = -0.55


def bishop_of(model, curve: Retention) -> tuple[float, float, float]:
    """Row of the table that an `io.schema.water.Bishop` describes, of pores with the retention `curve`; None is S."""
    if model is None or curve.kind == FULL:
        return SATURATION, 0.0, 0.0
    if model.air_entry is not None:
        return RATIO, model.air_entry, 0.0
    if model.power is not None:
        return POWER, model.power, 0.0
    return POWER, model.effective_power, curve.residual


@inlined
def factor_of(factors, m, suction, saturation, slope):
    """chi and d chi/ds of material `m` at `suction`, where it has this `saturation`, with the `slope` dS/ds."""
    kind = int(factors[m, 0])
    if kind == SATURATION or suction <= 0.0:
        return saturation, slope
    if kind == RATIO:
        ratio = suction / factors[m, 1]
        if ratio <= 1.0:
            return 1.0, 0.0
        value = ratio**_KHALILI_KHABBAZ
        return value, _KHALILI_KHABBAZ * value / suction
    n, residual = factors[m, 1], factors[m, 2]
    effective = (saturation - residual) / (1.0 - residual)
    value = power(effective, n)
    return value, n * value / effective * slope / (1.0 - residual) if effective > 0.0 else 0.0 * slope


@kernel
def fill_factors(factors, material, pressure, saturation, result):
    """chi (n,) of points of a `material` (n,) under a `pressure` (n,) Pa, with this `saturation` (n,)."""
    for i in range(pressure.shape[0]):
        result[i], _ = factor_of(factors, material[i], -pressure[i], saturation[i], 0.0)


def pore_stress(factors: np.ndarray, material, pressure, saturation) -> np.ndarray:
    """What water adds to the normal stress of the laws, -chi p (n,) Pa, see `fill_factors`."""
    result = np.empty(len(pressure))
    fill_factors(factors, material, pressure, saturation, result)
    return -result * pressure
