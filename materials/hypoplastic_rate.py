"""Rate equations of hypoplastic sand, and a substep of their integration with its error.

s' = M : D with M from L, N and the intergranular strain d (von Wolffersdorff 1996; Niemunis & Herle 1997). Tension is
positive; s^ = s/tr(s) and its deviator s* do not depend on that. Tensors are tuples of 6 here; the intergranular strain
stands over R. `sand` and `small` are constants, see `HypoplasticSand.numbers`.
"""

import math

from periporo.core.numerics.jit import inlined

NEAR = 0.02
"""Change of a base below which the series of its power is exact to 1e-11."""


@inlined
def product(a, b):
    """a : b of symmetric tensors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inlined
def plus(a, x, b):
    """a + x b."""
    return a[0] + x * b[0], a[1] + x * b[1], a[2] + x * b[2], a[3] + x * b[3], a[4] + x * b[4], a[5] + x * b[5]


@inlined
def times(x, a):
    """x a."""
    return x * a[0], x * a[1], x * a[2], x * a[3], x * a[4], x * a[5]


@inlined
def _power_from(power, old, new, exponent, quick):
    """new^exponent, of `power` = old^exponent by the binomial series if it is near, or always if `quick`; new/old - 1.
    """
    x, k = new / old - 1.0, exponent
    terms = 1.0 + (k - 4.0) / 5.0 * x * (1.0 + (k - 5.0) / 6.0 * x)
    terms = 1.0 + (k - 1.0) / 2.0 * x * (1.0 + (k - 2.0) / 3.0 * x * (1.0 + (k - 3.0) / 4.0 * x * terms))
    if quick or abs(x) <= NEAR:
        return power * (1.0 + k * x * terms), x
    return new**exponent, x


@inlined
def _exp_near(y, quick):
    """exp(y), by its series if y is near to 0, or always if `quick`."""
    if quick or abs(y) <= NEAR:
        return 1.0 + y * (1.0 + y / 2.0 * (1.0 + y / 3.0 * (1.0 + y / 4.0 * (1.0 + y / 5.0))))
    return math.exp(y)


@inlined
def density_factors(pressure, void, sand):
    """x = (3p/h_s)^n, exp(-x), (e_i/e)^beta, what f_d is a power of, f_d, and f_s, of a pressure and a void ratio."""
    hardness, n, dense, critical, loose, alpha, beta, _, constant = sand
    share = 3.0 * pressure / hardness
    x = share**n
    fade = math.exp(-x)
    limit = loose * fade
    denseness = (limit / void) ** beta
    room = (void - dense * fade) / ((critical - dense) * fade)
    stiffness = hardness / n * denseness * (1.0 + limit) / limit * share / x * constant
    return x, fade, denseness, room, room**alpha if room > 0.0 else 0.0, stiffness


@inlined
def grain_factors(grains, small):
    """rho, the size of the intergranular strain over R, rho^chi and rho^beta_r, which are at most 1."""
    size = math.sqrt(product(grains, grains))
    if size >= 1.0:
        return size, 1.0, 1.0
    return size, size ** small[4], size ** small[3]


@inlined
def _density_factors_near(before, old_pressure, old_void, pressure, void, sand, quick):
    """f_d and f_s near to a place where the factors are `before`; the largest change of a base."""
    hardness, n, dense, critical, loose, alpha, beta, _, constant = sand
    old_x, old_fade, old_denseness, old_room, old_looseness, _ = before
    x, change = _power_from(old_x, old_pressure, pressure, n, quick)
    fade = old_fade * _exp_near(old_x - x, quick)
    far = max(abs(change), abs(old_x - x))
    limit = loose * fade
    denseness, change = _power_from(old_denseness, loose * old_fade / old_void, limit / void, beta, quick)
    far = max(far, abs(change))
    room = (void - dense * fade) / ((critical - dense) * fade)
    looseness, change = _power_from(old_looseness, old_room, room, alpha, quick)
    far = max(far, abs(change))
    stiffness = denseness * (1.0 + limit) / limit * (3.0 / n * constant) * pressure / x
    return looseness if room > 0.0 else 0.0, stiffness, far


@inlined
def shape_factors(s):
    """tr(s^ : s^) and F of the stress `s`."""
    inverse = 1.0 / (s[0] + s[1] + s[2])
    square = product(s, s) * inverse * inverse
    dev = square - 1.0 / 3.0
    a, b, c = s[0] * inverse - 1.0 / 3.0, s[1] * inverse - 1.0 / 3.0, s[2] * inverse - 1.0 / 3.0
    d, e, f = s[3] * inverse, s[4] * inverse, s[5] * inverse
    third = 3.0 * (a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f))  # tr of the cube
    slope = math.sqrt(3.0 * dev)
    # sqrt(2) tan(psi) cos(3 theta), with cos(3 theta) = -sqrt(6) tr(s*^3)/(s* : s*)^(3/2) between -1 and 1
    largest = math.sqrt(2.0) * slope
    turned = min(max(-6.0 * third / dev, -largest), largest)
    inner = slope * slope / 8.0 + (2.0 - slope * slope) / (2.0 + turned)
    shape = math.sqrt(max(inner, 0.0)) - slope / (2.0 * math.sqrt(2.0))
    return square, shape if dev > 1e-20 else 1.0


@inlined
def _rate(s, grains, strain, looseness, stiffness, factors, sand, small):
    """Rates of stress and of the intergranular strain over R under the strain of a step; see `grain_factors`."""
    a2 = sand[7] * sand[7]
    radius, stiff, turned, _, _ = small
    inverse = 1.0 / (s[0] + s[1] + s[2])
    square, shape = shape_factors(s)
    scale = stiffness / square
    size, share, kept = factors
    per_size = 1.0 / size if size > 0.0 else 0.0
    along = product(grains, strain) * per_size
    forth, back = max(along, 0.0), min(along, 0.0)
    linear = share * turned + (1.0 - share) * stiff
    more = share * ((1.0 - turned) * forth + (stiff - turned) * back)
    plastic = share * looseness * sand[7] * shape * forth
    through = linear * product(strain, s) + more * per_size * product(grains, s)
    own = scale * shape * shape
    rate = plus(times(own * linear, strain), own * more * per_size, grains)
    rate = plus(rate, scale * (a2 * through * inverse + 2.0 * plastic) * inverse, s)
    less = scale * plastic / 3.0
    slip = plus(times(1.0 / radius, strain), -kept * forth * per_size / radius, grains)
    return (rate[0] - less, rate[1] - less, rate[2] - less, rate[3], rate[4], rate[5]), slip


@inlined
def substep(s, grains, void, strain, step, before, factors, sand, small, quick):
    """Changes of stress, intergranular strain and void ratio in a `step` of the strain, and the square of their error.

    Modified Euler's method, whose difference from Euler's is the error (Sloan 1987). `before` and `factors` are
    `density_factors` and `grain_factors` of the beginning. If `quick`, powers are followed by their series wherever the
    step leads; last is the largest change of a base, up to `NEAR` of which that is right.
    """
    volumetric = strain[0] + strain[1] + strain[2]
    start = -(s[0] + s[1] + s[2]) / 3.0
    first, slip = _rate(s, grains, strain, before[4], before[5], factors, sand, small)
    trial, trial_grains = plus(s, step, first), plus(grains, step, slip)
    trial_void = void + step * (1.0 + void) * volumetric
    pressure = -(trial[0] + trial[1] + trial[2]) / 3.0
    looseness, stiffness, far = _density_factors_near(before, start, void, pressure, trial_void, sand, quick)
    size = math.sqrt(product(trial_grains, trial_grains))
    share, change = _power_from(factors[1], min(factors[0], 1.0), min(size, 1.0), small[4], quick)
    kept, _ = _power_from(factors[2], min(factors[0], 1.0), min(size, 1.0), small[3], quick)
    far = max(far, abs(change))
    second, second_slip = _rate(
        trial, trial_grains, strain, looseness, stiffness, (size, share, kept), sand, small
    )  # fmt: skip
    change, turn = plus(second, -1.0, first), plus(second_slip, -1.0, slip)
    square = max(product(change, change) / product(trial, trial), 0.01 * product(turn, turn))
    half = 0.5 * step
    growth = half * (2.0 + void + trial_void) * volumetric
    change, turn = times(half, plus(first, 1.0, second)), times(half, plus(slip, 1.0, second_slip))
    return change, turn, growth, half * half * square if pressure > 0.0 else math.inf, far


@inlined
def work_lost(s, change, strain, part, stiffness, stiff, a):
    """Work per volume of the strain that unloading with the stiffness m_R L would not give back."""
    square, shape = shape_factors(s)
    scale, trace = stiff * stiffness / square * shape * shape, s[0] + s[1] + s[2]
    through = product(change, s) / trace * a * a / (shape * shape + a * a * square)
    given = (product(s, change) - through * square * trace) / scale
    return part * product(s, strain) - given
